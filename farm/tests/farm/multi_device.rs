//! Several devices of one node: what one of them leaves is traced by the others.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use carom_farm::Farm;
use carom_farm::multi_device::MultiDeviceTracer;
use carom_tracer::gpu::AdapterChoice;
use carom_tracer::{
    CompiledScene, CpuTracer, DeviceInfo, Error, GpuTracer, ImageSize, RenderSettings, Scene,
    TileGrid, TileRadiance, TraceJob, TraceStats, Tracer,
};

use crate::{assert_right, config, trace};
use carom_testkit::pattern_tracer::{DeviceFault, Gate, PatternTracer, scene};

const GRID: TileGrid = TileGrid::new(ImageSize::new(96, 64), 8);

/// Tiles of radiance, each asserted to come once.
fn tiles(tracer: &dyn Tracer, scene: &Scene, samples: u32) -> Result<Vec<Vec<[f32; 3]>>, Error> {
    let scene = CompiledScene::new(scene)?;
    let tiles: Vec<_> = GRID.tiles(GRID.all()).collect();
    let job = TraceJob {
        size: GRID.size,
        tiles: &tiles,
        settings: RenderSettings {
            samples,
            ..RenderSettings::default()
        },
        cancelled: &AtomicBool::new(false),
    };
    let done = Mutex::new(vec![None; tiles.len()]);
    tracer.trace(&scene, &job, &|tile| {
        let before = done.lock().unwrap()[tile.index].replace(tile.radiance);
        assert_eq!(before, None, "tile {} came twice", tile.index);
    })?;
    let done = done.into_inner().unwrap();
    Ok(done
        .into_iter()
        .map(|tile| tile.expect("every tile comes"))
        .collect())
}

fn hybrid(devices: Vec<PatternTracer>) -> MultiDeviceTracer {
    let shared = |device| Arc::new(device) as Arc<dyn Tracer>;
    MultiDeviceTracer::new(devices.into_iter().map(shared).collect(), Vec::new())
}

#[test]
fn what_a_failed_device_leaves_is_traced_by_another() {
    let expected = tiles(&PatternTracer::new(), &scene(), 1).unwrap();
    for fault in [DeviceFault::Error, DeviceFault::Panic] {
        // Enough tiles that it fails while the work is divided.
        let failing = PatternTracer::new()
            .with_pace(20)
            .with_fault(fault, 96 * 12 + 30);
        let hybrid = hybrid(vec![failing, PatternTracer::new().with_pace(20)]);
        for _ in 0..40 {
            assert_eq!(tiles(&hybrid, &scene(), 1).unwrap(), expected);
        }
        let name = hybrid.info().name;
        assert!(name.starts_with("pattern; not used: pattern:"), "{name}");
    }
}

#[test]
fn a_machine_whose_devices_all_fail_says_why() {
    let failing = || PatternTracer::new().with_fault(DeviceFault::Error, 0);
    let error = tiles(&hybrid(vec![failing(), failing()]), &scene(), 1).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("every device"), "{text}");
    assert!(text.contains("it was told to fail"), "{text}");
}

#[test]
fn a_device_that_is_absent_is_named_with_its_reason() {
    let cpu = Arc::new(PatternTracer::new());
    let hybrid = MultiDeviceTracer::new(vec![cpu], vec!["a GPU: it traces wrongly".to_owned()]);
    assert_eq!(
        hybrid.info().name,
        "pattern; not used: a GPU: it traces wrongly"
    );
    let long = MultiDeviceTracer::new(vec![Arc::new(PatternTracer::new())], vec!["é".repeat(400)]);
    assert!(long.info().name.len() <= 255);
}

#[test]
fn a_farm_s_frames_are_whole_while_a_device_of_its_node_fails() {
    let failing = PatternTracer::new()
        .with_pace(20)
        .with_fault(DeviceFault::Error, 200);
    let node = Arc::new(hybrid(vec![failing, PatternTracer::new().with_pace(20)]));
    let mut farm = Farm::with_tracers(config(), vec![node.clone()]).unwrap();
    farm.set_scene(&scene()).unwrap();
    for seed in 0..20 {
        let frame = trace(&mut farm, seed);
        assert_right(&frame, seed);
    }
    assert!(node.info().name.contains("not used"));
    let is_ready = |status: carom_farm::NodeStatus| status.state.is_ready();
    assert!(farm.nodes().into_iter().all(is_ready), "{:?}", farm.nodes());
}

/// A device that is ready when a job of it has ended, and counts its tiles.
struct Unready {
    tracer: PatternTracer,
    is_ready: AtomicBool,
    tiles: AtomicUsize,
}

impl Unready {
    fn new(tracer: PatternTracer) -> Arc<Self> {
        Arc::new(Self {
            tracer,
            is_ready: AtomicBool::new(false),
            tiles: AtomicUsize::new(0),
        })
    }

    fn tiles(&self) -> usize {
        self.tiles.load(Ordering::Relaxed)
    }
}

impl Tracer for Unready {
    fn info(&self) -> DeviceInfo {
        self.tracer.info()
    }

    fn is_ready(&self, _scene: &CompiledScene, _settings: &RenderSettings) -> bool {
        self.is_ready.load(Ordering::Relaxed)
    }

    fn trace(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error> {
        let stats = self.tracer.trace(scene, job, &|tile| {
            self.tiles.fetch_add(1, Ordering::Relaxed);
            sink(tile);
        })?;
        self.is_ready.store(true, Ordering::Relaxed);
        Ok(stats)
    }
}

fn is_ready(tracer: &dyn Tracer) -> bool {
    let scene = CompiledScene::new(&scene()).unwrap();
    tracer.is_ready(&scene, &RenderSettings::default())
}

#[test]
fn a_device_that_is_not_ready_is_prepared_while_another_traces() {
    let expected = tiles(&PatternTracer::new(), &scene(), 1).unwrap();
    let gate = Gate::closed();
    let hangs = DeviceFault::Hang(gate.clone());
    let gpu = Unready::new(PatternTracer::new().with_fault(hangs, 0));
    let hybrid = MultiDeviceTracer::new(
        vec![gpu.clone(), Arc::new(PatternTracer::new())],
        Vec::new(),
    );
    // No job waits for it,
    for _ in 0..3 {
        assert_eq!(tiles(&hybrid, &scene(), 1).unwrap(), expected);
        assert!(!is_ready(&hybrid));
    }
    gate.wait_until_reached();
    assert_eq!(gpu.tiles(), 0);
    gate.open();
    while !is_ready(&hybrid) {
        assert_eq!(tiles(&hybrid, &scene(), 1).unwrap(), expected);
    }
    // and it is first as if the other were not known.
    let before = gpu.tiles();
    assert_eq!(tiles(&hybrid, &scene(), 1).unwrap(), expected);
    assert_eq!(gpu.tiles(), before + expected.len());
}

#[test]
fn a_job_goes_over_to_a_device_that_has_become_ready() {
    let expected = tiles(&PatternTracer::new(), &scene(), 1).unwrap();
    let gpu = Unready::new(PatternTracer::new());
    let slow = Arc::new(PatternTracer::new().with_pace(100_000));
    let hybrid = MultiDeviceTracer::new(vec![gpu.clone(), slow], Vec::new());
    assert_eq!(tiles(&hybrid, &scene(), 1).unwrap(), expected);
    // One tile prepares it.
    assert!(gpu.tiles() > 1, "{}", gpu.tiles());
}

#[test]
fn a_device_that_cannot_be_prepared_is_named_with_its_reason() {
    let expected = tiles(&PatternTracer::new(), &scene(), 1).unwrap();
    for fault in [DeviceFault::Error, DeviceFault::Panic] {
        let gpu = Unready::new(PatternTracer::new().with_fault(fault, 0));
        let cpu = Arc::new(PatternTracer::new().with_pace(1000));
        let hybrid = MultiDeviceTracer::new(vec![gpu, cpu], Vec::new());
        while !hybrid.info().name.contains("not used: pattern:") {
            assert_eq!(tiles(&hybrid, &scene(), 1).unwrap(), expected);
        }
    }
}

#[test]
fn a_lost_gpu_s_tiles_are_traced_by_the_cpu() {
    let gpu = match GpuTracer::new(&AdapterChoice::Any) {
        Ok(gpu) => Arc::new(gpu),
        Err(error) if std::env::var_os("CAROM_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => return eprintln!("skipped: {error}"),
    };
    let cpu = Arc::new(CpuTracer::with_threads(1).unwrap());
    let truth = tiles(&*cpu, &scene(), 2).unwrap();
    let hybrid = MultiDeviceTracer::new(vec![gpu.clone(), cpu], Vec::new());
    // The first device is used alone, as soon as it is ready, until the others are tried.
    while !is_ready(&hybrid) {
        tiles(&hybrid, &scene(), 2).unwrap();
    }
    tiles(&hybrid, &scene(), 2).unwrap();
    gpu.destroy();
    assert_eq!(tiles(&hybrid, &scene(), 2).unwrap(), truth);
    assert!(
        hybrid.info().name.contains("lost"),
        "{}",
        hybrid.info().name
    );
}
