//! Laws of a farm of in-process nodes, on real threads: what a picture may depend on, and what may
//! happen to nodes while it is traced.

mod device_agreement;
mod film;
mod live;
mod multi_device;
mod progressive;
mod refusals;
mod samples;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use carom_farm::{
    Algorithm, Balancing, Error, Farm, FarmConfig, Frame, FrameSpec, Pixels, Submission,
};
use carom_protocol::PixelFormat;
use carom_tracer::{
    CompiledScene, DeviceInfo, ImageSize, ObjectPose, RenderSettings, Scene, SceneUpdate, Tile,
    TileRadiance, TraceJob, TraceStats, Tracer,
};

use carom_testkit::pattern_tracer::{self, DeviceFault, Gate, PatternTracer, scene};

/// Far longer than anything here takes; a test that needs it has failed.
const PATIENCE: Duration = Duration::from_secs(120);

fn config() -> FarmConfig {
    FarmConfig {
        tile_edge: 16,
        frames_in_flight: 3,
        ..FarmConfig::default()
    }
}

fn farm(tracers: Vec<PatternTracer>) -> Farm {
    let tracers = tracers
        .into_iter()
        .map(|tracer| Arc::new(tracer) as Arc<dyn Tracer>);
    let mut farm = Farm::with_tracers(config(), tracers.collect()).unwrap();
    farm.set_scene(&scene()).unwrap();
    wait_until_ready(&farm);
    farm
}

fn spec(seed: u32) -> FrameSpec {
    FrameSpec {
        update: SceneUpdate::default(),
        size: ImageSize::new(250, 141),
        settings: RenderSettings {
            seed,
            ..RenderSettings::default()
        },
        format: PixelFormat::LinearF32,
    }
}

fn linear(frame: &Frame) -> &[[f32; 3]] {
    match &frame.pixels {
        Pixels::Linear(pixels) => pixels,
        Pixels::Srgb8(_) => panic!("linear pixels were asked for"),
    }
}

fn trace(farm: &mut Farm, seed: u32) -> Frame {
    let id = farm.submit(spec(seed)).unwrap();
    let frame = farm.wait_frame(PATIENCE).expect("a frame");
    assert_eq!(frame.id, id);
    frame
}

fn assert_right(frame: &Frame, seed: u32) {
    assert_eq!(
        linear(frame),
        pattern_tracer::picture(&spec(seed)),
        "seed {seed}"
    );
}

#[test]
fn the_picture_does_not_depend_on_the_partition() {
    let mut one = farm(vec![PatternTracer::new()]);
    let paces = [0, 20, 100, 400];
    let mut four = farm(
        paces
            .map(|micros| PatternTracer::new().with_pace(micros))
            .into(),
    );
    for seed in 0..12 {
        let (alone, together) = (trace(&mut one, seed), trace(&mut four, seed));
        assert_right(&alone, seed);
        assert_eq!(linear(&alone), linear(&together));
        let delivered: u32 = together.stats.tiles_by_node.iter().sum();
        assert_eq!(delivered, 16 * 9);
    }
}

/// One node at one frame: what it works on is tracing, in however many requests it was asked.
#[test]
fn the_stages_of_a_frame_add_up_to_its_response() {
    let mut farm = farm(vec![PatternTracer::new().with_pace(200)]);
    for seed in 0..5 {
        let stats = trace(&mut farm, seed).stats;
        let split = stats.last_split().expect("a node delivered");
        let sum = split.request_secs
            + split.network_secs
            + split.queue_secs
            + split.trace_secs
            + split.encode_secs
            + split.decode_secs;
        assert!((sum - stats.response_max_secs()).abs() < 1e-9, "{split:?}");
        // 144 tiles of 0.2 ms each.
        assert!(split.trace_secs > 0.0288, "{split:?}");
        assert!(split.decode_secs > 0.0, "{split:?}");
    }
}

#[test]
fn eight_bit_and_half_float_pictures_do_not_depend_on_the_partition() {
    let mut one = farm(vec![PatternTracer::new()]);
    let mut three = farm(vec![
        PatternTracer::new(),
        PatternTracer::new().with_pace(50),
        PatternTracer::new(),
    ]);
    for format in [PixelFormat::Srgb8 { exposure: 0.7 }, PixelFormat::LinearF16] {
        let spec = FrameSpec { format, ..spec(3) };
        let mut pictures = [&mut one, &mut three].map(|farm| {
            farm.submit(spec.clone()).unwrap();
            farm.wait_frame(PATIENCE).expect("a frame").pixels
        });
        assert_eq!(pictures[0], pictures[1]);
        pictures[0] = Pixels::Linear(Vec::new());
        assert_ne!(pictures[0], pictures[1]);
    }
}

#[test]
fn a_node_that_fails_mid_frame_costs_no_tile() {
    for fault in [DeviceFault::Error, DeviceFault::Panic] {
        let faulty = PatternTracer::new().with_fault(fault, 20);
        let mut farm = farm(vec![faulty, PatternTracer::new().with_pace(30)]);
        for seed in 0..4 {
            assert_right(&trace(&mut farm, seed), seed);
        }
    }
}

#[test]
fn a_node_that_hangs_mid_frame_costs_no_tile() {
    let gate = Gate::closed();
    let hanging = PatternTracer::new().with_fault(DeviceFault::Hang(gate.clone()), 20);
    let mut farm = farm(vec![hanging, PatternTracer::new().with_pace(30)]);
    let frame = trace(&mut farm, 0);
    assert_right(&frame, 0);
    assert!(frame.stats.reissued_tiles > 0);
    assert_right(&trace(&mut farm, 1), 1);
    gate.open();
}

#[test]
fn a_picture_that_must_be_shown_comes_as_it_is_and_again_when_it_is_whole() {
    let gate = Gate::closed();
    let hanging = PatternTracer::new().with_fault(DeviceFault::Hang(gate.clone()), 20);
    let mut farm = farm(vec![hanging, PatternTracer::new()]);
    farm.set_balancing(Algorithm::Equal.unhedged());
    let submission = Submission {
        deadline: Some(Duration::from_millis(40)),
        ..Submission::default()
    };
    let id = farm.submit_with(spec(3), submission).unwrap();
    let part = farm.wait_frame(PATIENCE).expect("a part");
    assert_eq!((part.id, farm.in_flight()), (id, 1));
    let late: usize = part.missing.iter().map(|tile| tile.pixels()).sum();
    assert!(late > 0 && part.stats.late_tiles as usize == part.missing.len());
    let right = pattern_tracer::picture(&spec(3));
    for (place, pixel) in linear(&part).iter().enumerate() {
        let (x, y) = (place as u32 % 250, place as u32 / 250);
        let is_in = |tile: &Tile| {
            (tile.x..tile.x + tile.width).contains(&x)
                && (tile.y..tile.y + tile.height).contains(&y)
        };
        let missing = part.missing.iter().any(is_in);
        assert_eq!(*pixel, if missing { [0.0; 3] } else { right[place] });
    }
    gate.open();
    let whole = farm.wait_frame(PATIENCE).expect("the whole");
    assert_eq!((whole.id, farm.in_flight()), (id, 0));
    assert!(whole.missing.is_empty());
    assert_eq!(whole.stats.late_tiles, part.stats.late_tiles);
    assert_right(&whole, 3);
}

#[test]
fn a_frame_without_nodes_waits_for_one() {
    let mut farm = farm(Vec::new());
    let id = farm.submit(spec(5)).unwrap();
    assert!(farm.poll_frame().is_none());
    assert!(farm.nodes().is_empty());
    farm.add_tracer(Arc::new(PatternTracer::new()));
    let frame = farm.wait_frame(PATIENCE).expect("a frame");
    assert_eq!(frame.id, id);
    assert_right(&frame, 5);
    wait_until_ready(&farm);
}

#[test]
fn a_node_that_joins_gets_work() {
    let mut farm = farm(vec![PatternTracer::new().with_pace(300)]);
    assert_right(&trace(&mut farm, 0), 0);
    farm.add_tracer(Arc::new(PatternTracer::new()));
    let joined = |seed| trace(&mut farm, seed).stats.tiles_by_node.get(1).copied();
    let most = (1..40).map(joined).max().flatten();
    assert!(
        most.is_some_and(|tiles| tiles > 72),
        "{most:?} of 144 tiles"
    );
}

#[test]
fn algorithms_switch_while_frames_are_in_flight() {
    let mut farm = farm(vec![
        PatternTracer::new(),
        PatternTracer::new().with_pace(50),
        PatternTracer::new(),
    ]);
    let balancers: Vec<Balancing> = Balancing::all().collect();
    let mut seeds = std::collections::VecDeque::new();
    for seed in 0..54 {
        farm.set_balancing(balancers[seed as usize % balancers.len()]);
        farm.submit(spec(seed)).unwrap();
        seeds.push_back(seed);
        if farm.in_flight() == 3 {
            assert_right(
                &farm.wait_frame(PATIENCE).unwrap(),
                seeds.pop_front().unwrap(),
            );
        }
    }
}

#[test]
fn frames_come_in_the_order_of_submission() {
    let mut farm = farm(vec![
        PatternTracer::new(),
        PatternTracer::new().with_pace(100),
    ]);
    let ids: Vec<_> = (0..3)
        .map(|seed| farm.submit(spec(seed)).unwrap())
        .collect();
    for (seed, id) in ids.into_iter().enumerate() {
        let frame = farm.wait_frame(PATIENCE).unwrap();
        assert_eq!(frame.id, id);
        assert_right(&frame, seed as u32);
    }
}

#[test]
fn frames_in_flight_are_limited_until_they_are_taken() {
    let mut farm = farm(vec![PatternTracer::new()]);
    let most = config().frames_in_flight;
    for seed in 0..most as u32 {
        farm.submit(spec(seed)).unwrap();
    }
    match farm.submit(spec(0)) {
        Err(Error::FramesInFlight { in_flight }) => assert_eq!(in_flight, most),
        other => panic!("{other:?}"),
    }
    farm.wait_frame(PATIENCE).unwrap();
    farm.submit(spec(0)).unwrap();
    assert_eq!(farm.in_flight(), most);
}

#[test]
fn cancelled_frames_never_come() {
    let mut farm = farm(vec![PatternTracer::new().with_pace(200)]);
    for seed in 0..2 {
        farm.submit(spec(seed)).unwrap();
    }
    let third = farm.submit(spec(2)).unwrap();
    farm.cancel_before(third);
    assert_eq!(farm.in_flight(), 1);
    let frame = farm.wait_frame(PATIENCE).unwrap();
    assert_eq!(frame.id, third);
    assert_right(&frame, 2);
    assert!(farm.wait_frame(PATIENCE).is_none(), "nothing is in flight");
}

#[test]
fn a_cancelled_frame_frees_a_node_that_is_stuck_with_it() {
    let gate = Gate::closed();
    let mut farm = farm(vec![
        PatternTracer::new().with_fault(DeviceFault::Hang(gate.clone()), 10),
    ]);
    farm.submit(spec(0)).unwrap();
    gate.wait_until_reached();
    let next = farm.submit(spec(1)).unwrap();
    farm.cancel_before(next);
    gate.open();
    assert_right(&farm.wait_frame(PATIENCE).unwrap(), 1);
}

#[test]
fn dropping_a_busy_farm_does_not_hang() {
    let gate = Gate::closed();
    let slow = PatternTracer::new().with_pace(1000);
    let hanging = PatternTracer::new().with_fault(DeviceFault::Hang(gate.clone()), 0);
    let mut farm = farm(vec![slow, hanging]);
    for seed in 0..3 {
        farm.submit(spec(seed)).unwrap();
    }
    gate.wait_until_reached();
    drop(farm);
    gate.open();
}

#[test]
fn a_farm_that_is_gone_has_let_go_of_its_devices() {
    /// A device whose driver takes a while to shut down.
    struct Slow(PatternTracer, Arc<AtomicBool>);
    impl Tracer for Slow {
        fn info(&self) -> DeviceInfo {
            self.0.info()
        }
        fn trace(
            &self,
            scene: &CompiledScene,
            job: &TraceJob<'_>,
            sink: &(dyn Fn(TileRadiance) + Sync),
        ) -> Result<TraceStats, carom_tracer::Error> {
            self.0.trace(scene, job, sink)
        }
    }
    impl Drop for Slow {
        fn drop(&mut self) {
            // Gives a farm that does not wait its chance.
            (0..10_000).for_each(|_| std::thread::yield_now());
            self.1.store(true, Ordering::SeqCst);
        }
    }
    let gone = Arc::new(AtomicBool::new(false));
    let tracer = Arc::new(Slow(PatternTracer::new(), Arc::clone(&gone)));
    let mut farm = Farm::with_tracers(config(), vec![tracer]).unwrap();
    farm.set_scene(&scene()).unwrap();
    assert_right(&trace(&mut farm, 1), 1);
    drop(farm);
    assert!(gone.load(Ordering::SeqCst));
}

#[test]
fn a_scene_that_changes_is_drawn_from_the_next_frame_on() {
    let mut farm = farm(vec![
        PatternTracer::new(),
        PatternTracer::new().with_pace(20),
    ]);
    for change in 1..8 {
        let before = farm.submit(spec(0)).unwrap();
        let mut other = scene();
        other.camera.eye.z += change as f32;
        farm.set_scene(&other).unwrap();
        let after = farm.submit(spec(0)).unwrap();
        let (first, second) = (
            farm.wait_frame(PATIENCE).unwrap(),
            farm.wait_frame(PATIENCE).unwrap(),
        );
        assert_eq!((first.id, second.id), (before, after));
        assert_eq!(
            linear(&second),
            pattern_tracer::picture_of(&other, &spec(0))
        );
        assert_ne!(linear(&first), linear(&second));
    }
}

#[test]
fn mistakes_of_the_caller_are_errors_and_change_nothing() {
    let mut farm = Farm::with_tracers(config(), vec![Arc::new(PatternTracer::new())]).unwrap();
    assert!(matches!(farm.submit(spec(0)), Err(Error::NoScene)));
    let broken = Scene {
        objects: vec![carom_tracer::Object {
            name: "ball".into(),
            material: "missing".into(),
            shape: scene().objects[0].shape.clone(),
        }],
        ..scene()
    };
    let tracer_error = |result: Result<(), Error>| matches!(result, Err(Error::Tracer(_)));
    assert!(tracer_error(farm.set_scene(&broken)));
    farm.set_scene(&scene()).unwrap();
    let mut wrong_pose = spec(0);
    wrong_pose.update.poses = vec![ObjectPose {
        object: 99,
        position: glam::Vec3::ZERO,
        rotation: glam::Quat::IDENTITY,
        visible: true,
    }];
    assert!(tracer_error(farm.submit(wrong_pose).map(drop)));
    let mut many_poses = spec(0);
    many_poses.update.poses = vec![
        ObjectPose {
            object: 0,
            position: glam::Vec3::ZERO,
            rotation: glam::Quat::IDENTITY,
            visible: true,
        };
        65
    ];
    assert!(tracer_error(farm.submit(many_poses).map(drop)));
    let mut no_samples = spec(0);
    no_samples.settings.samples = 0;
    assert!(tracer_error(farm.submit(no_samples).map(drop)));
    let no_pixels = FrameSpec {
        size: ImageSize::new(0, 5),
        ..spec(0)
    };
    assert!(tracer_error(farm.submit(no_pixels).map(drop)));
    for exposure in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let format = PixelFormat::Srgb8 { exposure };
        assert!(tracer_error(
            farm.submit(FrameSpec { format, ..spec(0) }).map(drop)
        ));
    }
    assert_eq!(farm.in_flight(), 0);
    assert_right(&trace(&mut farm, 1), 1);
}

#[test]
fn configurations_out_of_range_are_refused() {
    for config in [
        FarmConfig {
            tile_edge: 7,
            ..config()
        },
        FarmConfig {
            tile_edge: 129,
            ..config()
        },
        FarmConfig {
            frames_in_flight: 0,
            ..config()
        },
        FarmConfig {
            frames_in_flight: 9,
            ..config()
        },
        FarmConfig {
            nodes: vec!["no port".into()],
            ..config()
        },
    ] {
        assert!(Farm::with_tracers(config, Vec::new()).is_err());
    }
}

/// Waits until all nodes hold the scene: one that is ready first gets the whole first frame.
fn wait_until_ready(farm: &Farm) {
    let ready = |farm: &Farm| {
        let mut nodes = farm.nodes().into_iter();
        nodes.all(|node| node.state.is_ready())
    };
    while !ready(farm) {
        std::thread::yield_now();
    }
}
