//! Laws of progressive renders: pictures that are accumulated beside frames of other kinds.

use carom_farm::{AccumulatedRender, Priority};
use carom_tracer::film::Film;

use super::*;

const SAMPLES: u32 = 64;

fn still() -> FrameSpec {
    let mut still = spec(0);
    still.settings.samples = SAMPLES;
    still
}

/// A render of four frames.
fn render(priority: Priority) -> AccumulatedRender {
    let mut render = AccumulatedRender::new(still(), priority);
    render.set_frame_samples(SAMPLES / 4);
    render
}

/// The rest of a render on a farm that may have frames of other kinds in flight.
fn finish(farm: &mut Farm, render: &mut AccumulatedRender, film: &mut Film) {
    let watch = &mut |_: &Film, _| Ok::<(), Error>(());
    render.finish(farm, film, watch).unwrap();
}

fn picture(farm: &mut Farm, priority: Priority) -> Vec<u8> {
    let mut film = Film::new(still().size);
    finish(farm, &mut render(priority), &mut film);
    film.to_bytes()
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
        for priority in [Priority::Interactive, Priority::Background] {
            assert!(picture(&mut farm, priority) == expected(&scene()));
        }
    }
}

#[test]
fn an_interactive_frame_overtakes_a_render() {
    let gate = Gate::closed();
    let hanging = DeviceFault::Hang(gate.clone());
    let mut farm = farm(vec![PatternTracer::new().with_fault(hanging, 3)]);
    let mut still = render(Priority::Background);
    still.submit_to(&mut farm).unwrap();
    gate.wait_until_reached();
    let asked = farm.submit(spec(1)).unwrap();
    gate.open();
    let first = farm.wait_frame(PATIENCE).unwrap();
    assert_eq!(first.id, asked);
    assert_right(&first, 1);
    let mut film = Film::new(first.size);
    finish(&mut farm, &mut still, &mut film);
    assert!(film.to_bytes() == expected(&scene()));
}

#[test]
fn a_cancelled_render_frees_its_nodes() {
    let gate = Gate::closed();
    let hanging = DeviceFault::Hang(gate.clone());
    let mut farm = farm(vec![PatternTracer::new().with_fault(hanging, 3)]);
    let mut still = render(Priority::Background);
    still.submit_to(&mut farm).unwrap();
    gate.wait_until_reached();
    still.cancel(&mut farm);
    gate.open();
    assert_right(&trace(&mut farm, 1), 1);
    assert!(farm.wait_frame(PATIENCE).is_none(), "nothing is in flight");
    assert_eq!(still.samples_done(), 0);
    let mut film = Film::new(still.spec().size);
    finish(&mut farm, &mut still, &mut film);
    assert!(film.to_bytes() == expected(&scene()));
}

#[test]
fn a_render_outlives_its_nodes_and_its_scene() {
    for fault in [DeviceFault::Error, DeviceFault::Panic] {
        let mut farm = farm(vec![
            PatternTracer::new().with_fault(fault, 40),
            PatternTracer::new().with_pace(20),
        ]);
        let mut still = render(Priority::Background);
        still.submit_to(&mut farm).unwrap();
        let mut other = scene();
        other.camera.eye.z += 1.0;
        farm.set_scene(&other).unwrap();
        farm.add_tracer(Arc::new(PatternTracer::new()));
        let mut film = Film::new(still.spec().size);
        finish(&mut farm, &mut still, &mut film);
        assert!(film.to_bytes() == expected(&scene()));
    }
}

#[test]
fn renders_share_what_is_left_to_them() {
    let mut farm = farm(vec![PatternTracer::new().with_pace(20)]);
    let mut renders = [render(Priority::Background), render(Priority::Background)];
    while !renders.iter().all(AccumulatedRender::is_done) {
        for render in &mut renders {
            render.submit_to(&mut farm).unwrap();
        }
        let frame = farm.wait_frame(PATIENCE).unwrap();
        let owner = renders.iter_mut().find(|render| render.owns(frame.id));
        owner.and_then(|render| render.accept(frame)).unwrap();
        let [a, b] = [0, 1].map(|render: usize| renders[render].samples_done());
        assert!(a.abs_diff(b) <= SAMPLES / 2, "{a} and {b}");
    }
}
