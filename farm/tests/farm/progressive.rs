//! Laws of stills: pictures that are accumulated beside frames of other kinds.

use carom_farm::{Still, StillJob};
use carom_tracer::film::Film;

use super::*;

const SAMPLES: u32 = 64;

fn still() -> FrameSpec {
    let mut still = spec(0);
    still.settings.samples = SAMPLES;
    still
}

/// A still of four frames in the background.
fn start(farm: &mut Farm) -> StillJob {
    farm.still(&scene(), description().background()).unwrap()
}

fn description() -> Still {
    Still::of(still()).frame_samples(SAMPLES / 4)
}

fn sums(job: StillJob) -> Vec<u8> {
    job.wait().unwrap().film().to_bytes()
}

/// The sum of four pictures of other samples each.
fn expected(scene: &Scene) -> Vec<u8> {
    let mut film = Film::new(still().size);
    let whole = Tile {
        x: 0,
        y: 0,
        width: film.size().width,
        height: film.size().height,
    };
    for batch in 0..4 {
        let mut spec = still();
        spec.settings.samples = SAMPLES / 4;
        spec.settings.first_sample = batch * SAMPLES / 4;
        let pixels = pattern_tracer::picture_of(scene, &spec);
        film.add(whole, &pixels, SAMPLES / 4).unwrap();
    }
    film.to_bytes()
}

#[test]
fn priority_and_partition_leave_the_bits_alone() {
    let paces = [0, 30, 200];
    for nodes in 1..=paces.len() {
        let tracers = paces[..nodes].iter();
        let tracers = tracers.map(|micros| PatternTracer::new().with_pace(*micros));
        let mut farm = farm(tracers.collect());
        for still in [description(), description().background()] {
            assert!(sums(farm.still(&scene(), still).unwrap()) == expected(&scene()));
        }
    }
}

#[test]
fn an_interactive_frame_overtakes_a_render() {
    let gate = Gate::closed();
    let hanging = DeviceFault::Hang(gate.clone());
    let mut farm = farm(vec![PatternTracer::new().with_fault(hanging, 3)]);
    let still = start(&mut farm);
    gate.wait_until_reached();
    let asked = farm.submit(spec(1)).unwrap();
    gate.open();
    let first = farm.wait_frame(PATIENCE).unwrap();
    assert_eq!(first.id, asked);
    assert_right(&first, 1);
    assert!(sums(still) == expected(&scene()));
}

#[test]
fn a_cancelled_render_frees_its_nodes() {
    let gate = Gate::closed();
    let hanging = DeviceFault::Hang(gate.clone());
    let mut farm = farm(vec![PatternTracer::new().with_fault(hanging, 3)]);
    let still = start(&mut farm);
    gate.wait_until_reached();
    still.cancel();
    let cancelled = still.wait();
    assert!(matches!(
        cancelled,
        Err(Error::Cancelled { samples_done: 0 })
    ));
    gate.open();
    assert_right(&trace(&mut farm, 1), 1);
    assert!(farm.wait_frame(PATIENCE).is_none(), "nothing is in flight");
    assert!(sums(start(&mut farm)) == expected(&scene()));
}

#[test]
fn a_render_outlives_its_nodes_and_its_scene() {
    for fault in [DeviceFault::Error, DeviceFault::Panic] {
        let mut farm = farm(vec![
            PatternTracer::new().with_fault(fault, 40),
            PatternTracer::new().with_pace(20),
        ]);
        let still = start(&mut farm);
        let mut other = scene();
        other.camera.eye.z += 1.0;
        farm.set_scene(&other).unwrap();
        farm.add_tracer(Arc::new(PatternTracer::new()));
        assert!(sums(still) == expected(&scene()));
    }
}

#[test]
fn renders_beside_each_other_keep_their_bits() {
    let mut farm = farm(vec![PatternTracer::new().with_pace(20)]);
    let stills = [start(&mut farm), start(&mut farm)];
    assert_right(&trace(&mut farm, 3), 3);
    for still in stills {
        assert!(sums(still) == expected(&scene()));
    }
}

#[test]
fn a_render_ends_with_its_farm() {
    let gate = Gate::closed();
    let hanging = DeviceFault::Hang(gate.clone());
    let mut farm = farm(vec![PatternTracer::new().with_fault(hanging, 3)]);
    let still = start(&mut farm);
    gate.wait_until_reached();
    gate.open();
    drop(farm);
    assert!(matches!(still.wait(), Ok(_) | Err(Error::FarmClosed)));
}

#[test]
fn progress_is_seen_within_a_frame() {
    let gate = Gate::closed();
    let hanging = DeviceFault::Hang(gate.clone());
    let mut farm = farm(vec![PatternTracer::new().with_fault(hanging, 3)]);
    let still = start(&mut farm);
    gate.wait_until_reached();
    let deadline = std::time::Instant::now() + PATIENCE;
    while still.progress().tiles_done == 0 {
        assert!(
            std::time::Instant::now() < deadline,
            "{:?}",
            still.progress()
        );
        std::thread::sleep(Duration::from_millis(5));
    }
    let progress = still.progress();
    assert_eq!((progress.samples_done, progress.samples), (0, SAMPLES));
    assert!((0.0..0.5).contains(&progress.fraction()), "{progress:?}");
    gate.open();
    assert!(sums(still) == expected(&scene()));
}
