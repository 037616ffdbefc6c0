//! Promises of the CPU tracer beyond the laws of light: the same picture however it is cut,
//! threaded or vectorised, and the scalar tracer's picture sample for sample.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use carom_tracer::compiled::BvhUse;
use carom_tracer::film::{Film, trace_image};
use carom_tracer::metrics::rel_mse;
use carom_tracer::{
    Camera, CompiledScene, CpuTracer, Environment, Error, ImageSize, Lens, RenderSettings,
    ScalarTracer, Scene, Tile, TileGrid, TraceJob, TraceStats, Tracer,
};
use glam::Vec3;

const SIZE: ImageSize = ImageSize::new(160, 90);

fn asset(name: &str) -> CompiledScene {
    let scenes = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/scenes/");
    CompiledScene::new(&Scene::load(format!("{scenes}{name}")).unwrap()).unwrap()
}

fn pool() -> CompiledScene {
    asset("pool.json")
}

fn settings(first_sample: u32, samples: u32) -> RenderSettings {
    RenderSettings {
        first_sample,
        samples,
        ..RenderSettings::default()
    }
}

/// All pixels of a picture of [`SIZE`], row by row.
fn picture(
    tracer: &dyn Tracer,
    scene: &CompiledScene,
    settings: RenderSettings,
    tiles: &[Tile],
) -> (Vec<[f32; 3]>, TraceStats) {
    let pixels = Mutex::new(vec![[f32::NAN; 3]; SIZE.pixels()]);
    let job = TraceJob {
        size: SIZE,
        tiles,
        settings,
        cancelled: &AtomicBool::new(false),
    };
    let stats = tracer.trace(scene, &job, &|traced| {
        assert_eq!(traced.dropped_samples, 0);
        let tile = tiles[traced.index];
        let mut pixels = pixels.lock().unwrap();
        for (y, row) in traced.radiance.chunks(tile.width as usize).enumerate() {
            let start = (tile.y as usize + y) * SIZE.width as usize + tile.x as usize;
            pixels[start..start + row.len()].copy_from_slice(row);
        }
    });
    (pixels.into_inner().unwrap(), stats.unwrap())
}

fn tiles(edge: u16) -> Vec<Tile> {
    let grid = TileGrid::new(SIZE, edge);
    grid.tiles(grid.all()).collect()
}

/// The share of pixels that differ by more than 1e-3 of their brightest channel.
fn share_different(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let different = |(a, b): &(&[f32; 3], &[f32; 3])| {
        let scale = a.iter().chain(*b).fold(1e-3f32, |max, c| max.max(*c));
        // Not `>`: a NaN is a difference.
        !a.iter().zip(*b).all(|(a, b)| (a - b).abs() <= 1e-3 * scale)
    };
    a.iter().zip(b).filter(different).count() as f64 / a.len() as f64
}

/// Ten thousand balls that touch, on every instruction set.
#[test]
fn bvh_of_balls_makes_the_picture_of_a_linear_scan() {
    let mut scene = asset("pyramid.json");
    for level in CpuTracer::levels_available() {
        let tracer = CpuTracer::with_level(0, level).unwrap();
        let [each, bvh] = [BvhUse::Never, BvhUse::Always].map(|bvh_use| {
            scene.bvh_use = bvh_use;
            let (pixels, stats) = picture(&tracer, &scene, settings(0, 1), &tiles(32));
            (pixels, stats.rays)
        });
        assert!(each == bvh, "{level:?}");
    }
}

#[test]
fn picture_is_independent_of_tiles_and_threads() {
    let scene = pool();
    let one = CpuTracer::with_threads(1).unwrap();
    let (whole, stats) = picture(&one, &scene, settings(3, 5), &tiles(160));
    assert_eq!(stats.samples, SIZE.pixels() as u64 * 5);
    for (threads, edge) in [(1, 64), (1, 7), (2, 160), (3, 33), (5, 16)] {
        let tracer = CpuTracer::with_threads(threads).unwrap();
        let (cut, cut_stats) = picture(&tracer, &scene, settings(3, 5), &tiles(edge));
        assert!(cut == whole, "{threads} threads, tiles of {edge}");
        assert_eq!(cut_stats, stats, "{threads} threads, tiles of {edge}");
    }
}

#[test]
fn every_instruction_set_gives_the_same_picture() {
    let scene = pool();
    let best = CpuTracer::new().unwrap();
    let (expected, _) = picture(&best, &scene, settings(0, 1), &tiles(64));
    for level in CpuTracer::levels_available() {
        let tracer = CpuTracer::with_level(2, level).unwrap();
        let (pixels, _) = picture(&tracer, &scene, settings(0, 1), &tiles(64));
        // Rounding turns a path where it passes an edge or the choice of a lobe by an ulp.
        let different = share_different(&pixels, &expected);
        assert!(different < 1e-3, "{level:?}: {different}");
    }
}

#[test]
fn every_sample_agrees_with_scalar() {
    let scene = pool();
    let (expected, _) = picture(&ScalarTracer, &scene, settings(0, 1), &tiles(64));
    for level in CpuTracer::levels_available() {
        let tracer = CpuTracer::with_level(0, level).unwrap();
        let (pixels, stats) = picture(&tracer, &scene, settings(0, 1), &tiles(64));
        let different = share_different(&pixels, &expected);
        assert!(different < 1e-3, "{level:?}: {different}");
        let rays_per_sample = stats.rays as f64 / stats.samples as f64;
        assert!((2.0..4.0).contains(&rays_per_sample), "{rays_per_sample}");
    }
}

#[test]
fn a_sample_range_is_the_mean_of_its_parts() {
    let scene = pool();
    let tracer = CpuTracer::new().unwrap();
    let (whole, _) = picture(&tracer, &scene, settings(0, 8), &tiles(64));
    let (first, _) = picture(&tracer, &scene, settings(0, 3), &tiles(64));
    let (second, _) = picture(&tracer, &scene, settings(3, 5), &tiles(64));
    let merged =
        |(a, b): (&[f32; 3], &[f32; 3])| std::array::from_fn(|c| (a[c] * 3.0 + b[c] * 5.0) / 8.0);
    let merged: Vec<[f32; 3]> = first.iter().zip(&second).map(merged).collect();
    for (whole, merged) in whole.iter().zip(&merged) {
        for (a, b) in whole.iter().zip(merged) {
            assert!((a - b).abs() <= 1e-6 * a.abs(), "{whole:?} {merged:?}");
        }
    }
}

/// What is shown while nothing moves: frames of other samples, added up.
#[test]
fn disjoint_sample_ranges_converge_to_scalar() {
    let (scene, size) = (pool(), ImageSize::new(64, 36));
    let mut truth = settings(0, 256);
    truth.seed = 1; // noise of its own
    let truth = trace_image(&ScalarTracer, &scene, size, truth)
        .unwrap()
        .image();
    let tracer = CpuTracer::new().unwrap();
    let whole = Tile {
        x: 0,
        y: 0,
        width: size.width,
        height: size.height,
    };
    let mut film = Film::new(size);
    let mut errors = Vec::new();
    for frame in 0..16 {
        let frame = trace_image(&tracer, &scene, size, settings(4 * frame, 4)).unwrap();
        film.add(whole, &frame.image().pixels, 4).unwrap();
        errors.push(rel_mse(&film.image(), &truth).unwrap());
    }
    assert_eq!(film.samples_min(), 64);
    // The scalar tracer's own noise is a part of what is left.
    assert!(errors[3] < 0.3 * errors[0], "{errors:?}");
    assert!(errors[15] < 0.12 * errors[0], "{errors:?}");
    assert!(
        errors[15] < errors[7] && errors[7] < errors[3],
        "{errors:?}"
    );
}

#[test]
fn slivers_and_single_pixels_are_parts_of_the_picture() {
    let scene = pool();
    let tracer = CpuTracer::with_threads(2).unwrap();
    let (whole, _) = picture(&tracer, &scene, settings(0, 2), &tiles(64));
    let tile = |x, y, width, height| Tile {
        x,
        y,
        width,
        height,
    };
    for tile in [
        tile(80, 45, 1, 1),
        tile(159, 89, 1, 1),
        tile(77, 0, 1, 90),
        tile(0, 60, 160, 1),
    ] {
        let (part, stats) = picture(&tracer, &scene, settings(0, 2), &[tile]);
        assert_eq!(stats.samples, tile.pixels() as u64 * 2);
        for y in tile.y..tile.y + tile.height {
            for x in tile.x..tile.x + tile.width {
                let index = (y * SIZE.width + x) as usize;
                assert_eq!(part[index], whole[index], "({x}, {y})");
            }
        }
    }
}

#[test]
fn no_tiles_are_no_work() {
    let tracer = CpuTracer::with_threads(2).unwrap();
    let (_, stats) = picture(&tracer, &pool(), settings(0, 1), &[]);
    assert_eq!(stats, TraceStats::default());
}

#[test]
fn an_empty_scene_shows_its_environment() {
    let radiance = Vec3::new(0.25, 0.5, 1e30);
    let scene = Scene {
        camera: Camera {
            eye: Vec3::ZERO,
            target: Vec3::X,
            up: Vec3::Z,
            fov_x_deg: 90.0,
            lens: Lens::default(),
            near_m: 0.0,
        },
        environment: Environment { radiance },
        materials: BTreeMap::new(),
        objects: Vec::new(),
        area_lights: Vec::new(),
        ..Scene::new()
    };
    let scene = CompiledScene::new(&scene).unwrap();
    for level in CpuTracer::levels_available() {
        let tracer = CpuTracer::with_level(2, level).unwrap();
        let (pixels, stats) = picture(&tracer, &scene, settings(0, 4), &tiles(64));
        assert!(pixels.iter().all(|&pixel| pixel == radiance.to_array()));
        assert_eq!(stats.rays, stats.samples);
    }
}

#[test]
fn a_cancelled_job_ends_early() {
    let scene = pool();
    let tracer = CpuTracer::with_threads(2).unwrap();
    let tiles = tiles(16);
    let cancelled = AtomicBool::new(false);
    let handed_over = AtomicUsize::new(0);
    let job = TraceJob {
        size: SIZE,
        tiles: &tiles,
        settings: settings(0, 1),
        cancelled: &cancelled,
    };
    let stats = tracer.trace(&scene, &job, &|_| {
        handed_over.fetch_add(1, Ordering::Relaxed);
        cancelled.store(true, Ordering::Relaxed);
    });
    // A tile that the other thread had begun may still come.
    let handed_over = handed_over.into_inner();
    assert!((1..=2).contains(&handed_over), "{handed_over}");
    assert!(stats.unwrap().samples <= 2 * 16 * 16);

    let stats = tracer.trace(&scene, &job, &|_| panic!("the job was cancelled"));
    assert_eq!(stats.unwrap(), TraceStats::default());
}

#[test]
fn tiles_outside_the_image_are_refused() {
    let tracer = CpuTracer::with_threads(1).unwrap();
    let tile = Tile {
        x: SIZE.width - 1,
        y: 0,
        width: 2,
        height: 1,
    };
    let job = TraceJob {
        size: SIZE,
        tiles: &[tile],
        settings: settings(0, 1),
        cancelled: &AtomicBool::new(false),
    };
    let refused = tracer.trace(&pool(), &job, &|_| panic!("nothing is traced"));
    assert!(matches!(refused, Err(Error::InvalidSettings(_))));
}
