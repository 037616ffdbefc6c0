use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use super::*;
use crate::{ImageSize, RenderSettings, TileGrid};

const GRID: TileGrid = TileGrid::new(ImageSize::new(40, 24), 16);

fn tracer() -> Option<GpuTracer> {
    match GpuTracer::new(&AdapterChoice::Any) {
        Ok(tracer) => Some(tracer),
        Err(error) if std::env::var_os("CAROM_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            eprintln!("skipped: {error}");
            None
        }
    }
}

/// Traces the probe's scene with more samples than a batch of camera rays in workgroups of several
/// blocks holds.
fn trace(tracer: &GpuTracer) -> Result<(Vec<TileRadiance>, TraceStats), Error> {
    let scene = CompiledScene::new(&probe::scene())?;
    let tiles: Vec<_> = GRID.tiles(GRID.all()).collect();
    let job = TraceJob {
        size: GRID.size,
        tiles: &tiles,
        settings: RenderSettings {
            samples: 37,
            ..RenderSettings::default()
        },
        cancelled: &AtomicBool::new(false),
    };
    let done = Mutex::new(Vec::new());
    let stats = tracer.trace(&scene, &job, &|tile| done.lock().unwrap().push(tile))?;
    Ok((done.into_inner().unwrap(), stats))
}

#[test]
fn picture_is_independent_of_dispatches() {
    let Some(mut tracer) = tracer() else { return };
    let (tiles, stats) = trace(&tracer).unwrap();
    // A device that seems slow gets one sample per pixel at a time.
    tracer.pacer = Pacer::new();
    tracer.pacer.learn(1, 1.0, 1e12);
    let (cut_tiles, cut_stats) = trace(&tracer).unwrap();
    assert_eq!(cut_tiles, tiles);
    assert_eq!(
        (cut_stats.samples, cut_stats.rays),
        (stats.samples, stats.rays)
    );
}

#[test]
fn pictures_as_they_are_shown_are_those_of_the_radiance() {
    let Some(tracer) = tracer() else { return };
    let scene = CompiledScene::new(&probe::scene()).unwrap();
    let tiles: Vec<_> = GRID.tiles(GRID.all()).collect();
    // Dark, and far up the shoulder of the tone curve.
    for (exposure, denoise) in [(0.05, true), (1.0, true), (40.0, true), (1.0, false)] {
        let job = TraceJob {
            size: GRID.size,
            tiles: &tiles,
            settings: RenderSettings {
                samples: 3,
                denoise,
                ..RenderSettings::default()
            },
            cancelled: &AtomicBool::new(false),
        };
        let [expected, shown] = [(), ()].map(|()| Mutex::new(Vec::new()));
        let stats = tracer.trace(&scene, &job, &|tile| {
            expected.lock().unwrap().push(tile.srgb8(exposure));
        });
        let shown_stats = tracer.trace_srgb8(&scene, &job, exposure, &|tile| {
            shown.lock().unwrap().push(tile);
        });
        assert_eq!(shown_stats.unwrap().rays, stats.unwrap().rays);
        let [expected, shown] = [expected, shown].map(|tiles| {
            let mut tiles = tiles.into_inner().unwrap();
            tiles.sort_by_key(|tile: &TileSrgb8| tile.index);
            let indices: Vec<usize> = tiles.iter().map(|tile| tile.index).collect();
            assert_eq!(indices, (0..GRID.len() as usize).collect::<Vec<_>>());
            tiles
                .into_iter()
                .flat_map(|tile| tile.pixels)
                .flatten()
                .collect::<Vec<u8>>()
        });
        let apart = expected.iter().zip(&shown).map(|(a, b)| a.abs_diff(*b));
        assert_eq!(expected.len(), shown.len());
        assert!(apart.clone().all(|steps| steps <= 1), "exposure {exposure}");
        let different = apart.filter(|steps| *steps > 0).count();
        assert!(
            different * 100 < shown.len(),
            "exposure {exposure}: {different}"
        );
        assert!(shown.iter().any(|step| *step > 20), "exposure {exposure}");
    }
}

#[test]
fn the_device_s_clock_is_read_where_there_is_one() {
    let Some(tracer) = tracer() else { return };
    let (_, stats) = trace(&tracer).unwrap();
    assert_eq!(stats.device_nanos > 0, tracer.device.tick_nanos.is_some());
}

#[test]
fn it_is_ready_for_what_its_kernels_are_compiled_for() {
    let Some(tracer) = tracer() else { return };
    let scene = CompiledScene::new(&probe::scene()).unwrap();
    let denoised = RenderSettings {
        denoise: true,
        ..RenderSettings::default()
    };
    // The probe has compiled the kernels of its scene without denoising.
    assert!(tracer.is_ready(&scene, &RenderSettings::default()));
    assert!(!tracer.is_ready(&scene, &denoised));
    let tiles: Vec<_> = GRID.tiles(GRID.all()).take(1).collect();
    let job = TraceJob {
        size: GRID.size,
        tiles: &tiles,
        settings: denoised,
        cancelled: &AtomicBool::new(false),
    };
    tracer.trace(&scene, &job, &|_| {}).unwrap();
    assert!(tracer.is_ready(&scene, &denoised));
}

#[test]
fn a_device_that_has_not_proved_itself_does_so_with_its_first_job() {
    let Some(mut tracer) = tracer() else { return };
    let scene = CompiledScene::new(&probe::scene()).unwrap();
    tracer.proof = OnceLock::new();
    assert!(!tracer.is_ready(&scene, &RenderSettings::default()));
    trace(&tracer).unwrap();
    assert_eq!(tracer.proof.get(), Some(&Ok(())));
    tracer.proof = OnceLock::from(Err("it traces the probe wrongly".to_owned()));
    let error = trace(&tracer).unwrap_err().to_string();
    assert!(error.contains("the probe wrongly"), "{error}");
    // Ready, so that the next job reports the error.
    assert!(tracer.is_ready(&scene, &RenderSettings::default()));
}

#[test]
fn a_lost_device_is_an_error() {
    let Some(tracer) = tracer() else { return };
    tracer.destroy();
    for _ in 0..2 {
        let lost = trace(&tracer);
        assert!(matches!(lost, Err(Error::Device { .. })), "{lost:?}");
    }
}

#[test]
fn a_kernel_that_does_not_compile_is_an_error() {
    let Some(tracer) = tracer() else { return };
    let scene = CompiledScene::new(&probe::scene()).unwrap();
    let features = layout::features(&scene, 65_536);
    for text in ["nonsense", "@compute @workgroup_size(1) fn other() {}"] {
        let broken = pipeline::compile(&tracer.device, &features, text.to_owned());
        assert!(matches!(broken, Err(Error::Device { .. })), "{text}");
    }
    trace(&tracer).unwrap();
}

#[test]
fn workgroups_of_several_blocks_trace_the_same_bits() {
    let Some(mut tracer) = tracer() else { return };
    let (tiles, stats) = trace(&tracer).unwrap();
    for blocks in [2, 4] {
        tracer.device.workgroup_blocks = blocks;
        tracer.pacer = Pacer::new();
        assert_eq!(trace(&tracer).unwrap().0, tiles, "{blocks} blocks");
        // One sample at a time.
        tracer.pacer.learn(1, 1.0, 1e12);
        let (cut_tiles, cut_stats) = trace(&tracer).unwrap();
        assert_eq!(cut_tiles, tiles, "{blocks} blocks");
        assert_eq!(cut_stats.rays, stats.rays, "{blocks} blocks");
    }
}

#[test]
fn a_tile_that_no_buffer_holds_is_an_error() {
    let Some(mut tracer) = tracer() else { return };
    tracer.pixels_max = 255;
    let refused = trace(&tracer);
    assert!(matches!(refused, Err(Error::Device { .. })), "{refused:?}");
}

#[test]
fn memory_that_the_device_has_not_is_an_error() {
    let Some(tracer) = tracer() else { return };
    let refused = tracer.device.guarded(|device| {
        device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: device.limits().max_buffer_size.saturating_add(16),
            usage: wgpu::BufferUsages::STORAGE,
            mapped_at_creation: false,
        })
    });
    assert!(matches!(refused, Err(Error::Device { .. })));
    trace(&tracer).unwrap();
}

#[test]
fn wrong_tracer_fails_the_probe() {
    /// The scalar tracer with a different seed: right on average, but different in every sample.
    struct Wrong;
    impl Tracer for Wrong {
        fn info(&self) -> DeviceInfo {
            crate::ScalarTracer.info()
        }
        fn trace(
            &self,
            scene: &CompiledScene,
            job: &TraceJob<'_>,
            sink: &(dyn Fn(TileRadiance) + Sync),
        ) -> Result<TraceStats, Error> {
            let mut job = *job;
            job.settings.seed += 1;
            crate::ScalarTracer.trace(scene, &job, sink)
        }
    }
    probe::prove(&crate::ScalarTracer).unwrap();
    let error = probe::prove(&Wrong).unwrap_err().to_string();
    assert!(error.contains("start-up probe"), "{error}");
}
