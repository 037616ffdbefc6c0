//! Tiles of the CPU and of a GPU, as spot checks compare them: honest devices agree.

use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use carom_farm::coordinator::{differing_share, tiles_agree};
use carom_protocol::PixelFormat;
use carom_protocol::tile_codec::TilePixels;
use carom_tracer::gpu::AdapterChoice;
use carom_tracer::{
    CompiledScene, CpuTracer, GpuTracer, ImageSize, RenderSettings, Scene, TileGrid, TraceJob,
    Tracer,
};

const GRID: TileGrid = TileGrid::new(ImageSize::new(256, 144), 32);
const FORMATS: [PixelFormat; 2] = [PixelFormat::LinearF32, PixelFormat::Srgb8 { exposure: 1.0 }];

fn tiles(
    tracer: &dyn Tracer,
    scene: &CompiledScene,
    settings: RenderSettings,
) -> Vec<Vec<[f32; 3]>> {
    let tiles: Vec<_> = GRID.tiles(GRID.all()).collect();
    let job = TraceJob {
        size: GRID.size,
        tiles: &tiles,
        settings,
        cancelled: &AtomicBool::new(false),
    };
    let done = Mutex::new(vec![Vec::new(); tiles.len()]);
    let sink = |tile: carom_tracer::TileRadiance| {
        done.lock().unwrap()[tile.index] = tile.radiance;
    };
    tracer.trace(scene, &job, &sink).unwrap();
    done.into_inner().unwrap()
}

/// The largest share of a tile's pixels that differs, and whether all tiles agree.
fn compared(a: &[Vec<[f32; 3]>], b: &[Vec<[f32; 3]>], format: PixelFormat) -> (f64, bool) {
    let mut most = (0.0_f64, true);
    for ((tile, a), b) in GRID.tiles(GRID.all()).zip(a).zip(b) {
        let [a, b] = [a, b].map(|light| TilePixels::of(format, &[(tile, &light[..])]));
        most.0 = most.0.max(differing_share(tile, &a, &b, false));
        most.1 &= tiles_agree(tile, &a, &b, false);
    }
    most
}

#[test]
fn tiles_of_cpu_and_gpu_agree() {
    let gpu = match GpuTracer::new(&AdapterChoice::Any) {
        Ok(gpu) => gpu,
        Err(error) if std::env::var_os("CAROM_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => return eprintln!("skipped: {error}"),
    };
    let cpu = CpuTracer::new().unwrap();
    for name in ["pool.json", "materials.json", "pyramid.json"] {
        let scenes = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/scenes/");
        let scene = Scene::load(format!("{scenes}{name}")).unwrap();
        let scene = CompiledScene::new(&scene).unwrap();
        for (samples, denoise) in [(1, false), (1, true), (4, false), (16, false), (64, false)] {
            let settings = RenderSettings {
                samples,
                denoise,
                ..RenderSettings::default()
            };
            let [a, b] = [&cpu as &dyn Tracer, &gpu].map(|device| tiles(device, &scene, settings));
            for format in FORMATS {
                let (share, agrees) = compared(&a, &b, format);
                println!("{name} {samples} spp, denoised {denoise}, {format:?}: {share:.3}");
                assert!(
                    agrees,
                    "{name}, {samples} spp, {format:?}: {share} of a tile's pixels differ"
                );
            }
        }
    }
}
