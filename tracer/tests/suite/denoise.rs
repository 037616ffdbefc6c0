//! Promises of the denoiser: less error, the same picture however it is cut, nothing blurred that
//! has an edge, and no change where there is no noise.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use crate::thin_walls::thin_wall_still_life;
use crate::tracers::tracers;
use carom_tracer::film::{trace_image, trace_tiles};
use carom_tracer::metrics::rel_mse;
use carom_tracer::{
    Aovs, CompiledScene, CpuTracer, Film, ImageSize, RadianceImage, RenderSettings, ScalarTracer,
    Scene, Tile, TileGrid, TileRange, TraceJob, Tracer,
};

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

fn pool() -> CompiledScene {
    CompiledScene::new(&Scene::load(repository("assets/scenes/pool.json")).unwrap()).unwrap()
}

fn thin_walls() -> CompiledScene {
    CompiledScene::new(&thin_wall_still_life()).unwrap()
}

fn reference() -> RadianceImage {
    RadianceImage::read_exr(repository("tests/references/pool_480x270.exr")).unwrap()
}

fn denoised(samples: u32) -> RenderSettings {
    RenderSettings {
        samples,
        denoise: true,
        ..RenderSettings::default()
    }
}

fn aovs(tracer: &dyn Tracer, scene: &CompiledScene, samples: u32) -> Vec<Aovs> {
    let tile = Tile {
        x: 0,
        y: 0,
        width: 97,
        height: 61,
    };
    let job = TraceJob {
        size: ImageSize::new(97, 61),
        tiles: &[tile],
        settings: RenderSettings {
            samples,
            ..RenderSettings::default()
        },
        cancelled: &AtomicBool::new(false),
    };
    let pixels = Mutex::new(Vec::new());
    let sink = |done: carom_tracer::TileAovs| pixels.lock().unwrap().extend(done.pixels);
    tracer.aovs(scene, &job, &sink).unwrap();
    pixels.into_inner().unwrap()
}

/// Largest difference in any of the numbers.
fn apart(a: &Aovs, b: &Aovs) -> f32 {
    let numbers = |hit: &Aovs| {
        let [albedo, normal, emission] = [hit.albedo, hit.normal, hit.emission];
        [albedo, normal, emission, [hit.inverse_depth, 0.0, 0.0]].concat()
    };
    let pairs = numbers(a).into_iter().zip(numbers(b));
    pairs
        .map(|(a, b)| (a - b).abs() / (1.0 + b.abs()))
        .fold(0.0, f32::max)
}

#[test]
fn aovs_agree_between_all_tracers() {
    for scene in [pool(), thin_walls()] {
        assert_aovs_agree(&scene);
    }
}

#[test]
fn a_near_plane_with_nothing_before_it_changes_no_aovs() {
    let whole = pool();
    let mut cut = pool();
    cut.camera.near_m = 0.3;
    for tracer in tracers() {
        let [whole, cut] = [&whole, &cut].map(|scene| aovs(&**tracer, scene, 1));
        let pairs = whole.iter().zip(&cut);
        let off = pairs.filter(|(a, b)| apart(a, b) > 1e-3).count();
        assert!(
            off * 200 <= whole.len(),
            "{}: {off} differ",
            tracer.info().name
        );
    }
}

fn assert_aovs_agree(scene: &CompiledScene) {
    let truth = aovs(&ScalarTracer, scene, 3);
    let shines = |hit: &&Aovs| hit.emission[0] > 0.1 && hit.albedo != [0.0; 3];
    assert!(
        truth.iter().any(|hit| shines(&hit)),
        "no area light is reflected"
    );
    for tracer in tracers() {
        let found = aovs(&**tracer, scene, 3);
        assert_eq!(found.len(), truth.len());
        // Rounding sends a ray past the other side of an edge now and then.
        let off = truth
            .iter()
            .zip(&found)
            .filter(|(a, b)| apart(a, b) > 1e-4)
            .count();
        assert!(
            off * 500 <= truth.len(),
            "{}: {off} differ",
            tracer.info().name
        );
    }
}

#[test]
fn paths_and_aovs_add_up_to_the_whole_picture() {
    for scene in [pool(), thin_walls()] {
        assert_paths_and_aovs_add_up(&scene);
    }
}

fn assert_paths_and_aovs_add_up(scene: &CompiledScene) {
    let size = ImageSize::new(96, 54);
    for tracer in tracers() {
        let settings = denoised(32);
        let plain = RenderSettings {
            denoise: false,
            ..settings
        };
        let a = trace_image(&**tracer, scene, size, settings)
            .unwrap()
            .image();
        let b = trace_image(&**tracer, scene, size, plain).unwrap().image();
        let mean = |image: &RadianceImage| {
            image
                .pixels
                .iter()
                .flatten()
                .map(|&c| f64::from(c))
                .sum::<f64>()
        };
        let ratio = mean(&a) / mean(&b);
        assert!(
            (ratio - 1.0).abs() < 3e-3,
            "{}: {ratio}",
            tracer.info().name
        );
    }
}

#[test]
fn any_partition_gives_the_same_bits() {
    let scene = pool();
    let grid = TileGrid::new(ImageSize::new(203, 117), 32);
    for tracer in tracers() {
        for samples in [1, 5] {
            let trace = |run: TileRange| {
                let tiles: Vec<Tile> = grid.tiles(run).collect();
                trace_tiles(&**tracer, &scene, grid.size, denoised(samples), &tiles)
                    .unwrap()
                    .image()
            };
            let whole = trace(grid.all());
            let mut joined = vec![[0.0; 3]; grid.size.pixels()];
            for (first, end) in [(0, 1), (1, 9), (9, 10), (10, grid.len())] {
                let part = trace(TileRange {
                    first,
                    count: end - first,
                });
                for (sum, part) in joined.iter_mut().zip(part.pixels) {
                    (0..3).for_each(|c| sum[c] += part[c]);
                }
            }
            assert!(
                joined == whole.pixels,
                "{}: {samples} samples",
                tracer.info().name
            );
        }
    }
}

/// A path that rounding sends another way changes its pixel, and by the filter those around it.
#[test]
fn every_tracer_filters_alike() {
    let scene = pool();
    let size = ImageSize::new(203, 117);
    for samples in [1, 2, 5] {
        let picture = |tracer: &dyn Tracer| {
            let film = trace_image(tracer, &scene, size, denoised(samples));
            film.unwrap().image()
        };
        let truth = picture(&ScalarTracer);
        for tracer in tracers() {
            let image = picture(&**tracer);
            let far = |(a, b): &(&[f32; 3], &[f32; 3])| {
                let pairs = a.iter().zip(*b);
                !pairs
                    .into_iter()
                    .all(|(a, b)| (a - b).abs() <= 1e-3 * (1.0 + b.abs()))
            };
            let off = image.pixels.iter().zip(&truth.pixels).filter(far).count();
            let error = rel_mse(&image, &truth).unwrap();
            eprintln!(
                "{}: {samples} samples, {off} off, {error:e}",
                tracer.info().name
            );
            assert!(
                off * 100 <= size.pixels() && error < 1e-5,
                "{}: {off} pixels differ at {samples} samples, relMSE {error:e}",
                tracer.info().name
            );
        }
    }
}

/// A long run is filtered part by part, each with a guard band of its own.
#[test]
fn a_long_run_has_no_seams() {
    let (scene, tracer) = (pool(), CpuTracer::new().unwrap());
    let grid = TileGrid::new(ImageSize::new(203, 117), 32);
    let settings = denoised(300);
    let whole = trace_image(&tracer, &scene, grid.size, settings).unwrap();
    let mut parts = Film::new(grid.size);
    for tile in grid.tiles(grid.all()) {
        let part = trace_tiles(&tracer, &scene, grid.size, settings, &[tile]).unwrap();
        let image = part.image();
        let row = |y: u32| (y * grid.size.width + tile.x) as usize;
        let rows = (tile.y..tile.y + tile.height).map(row);
        let pixels = rows.flat_map(|i| &image.pixels[i..i + tile.width as usize]);
        let pixels: Vec<[f32; 3]> = pixels.copied().collect();
        parts.add(tile, &pixels, 300).unwrap();
    }
    assert!(parts.image() == whole.image());
}

#[test]
fn the_error_falls_until_hardly_any_is_left() {
    let (scene, reference) = (pool(), reference());
    let tracer = CpuTracer::new().unwrap();
    // How much of the error is left: measured with `examples/noise.rs`, and a tenth above. Of 64
    // samples nothing can be taken: what differs is below a hundredth of the error of one.
    for (samples, share) in [(1, 0.1), (4, 0.5), (16, 0.8), (64, 1.05)] {
        let error = |denoise| {
            let settings = RenderSettings {
                denoise,
                ..denoised(samples)
            };
            let image = trace_image(&tracer, &scene, reference.size, settings).unwrap();
            rel_mse(&image.image(), &reference).unwrap()
        };
        let (noisy, smooth) = (error(false), error(true));
        assert!(
            smooth <= share * noisy,
            "{samples} samples: {smooth} of {noisy}"
        );
    }
}

/// Mean squared difference of neighbours across the edges that the reference has: where blur would
/// lower it.
#[test]
fn stripes_and_reflected_lights_stay_sharp() {
    let (scene, reference) = (pool(), reference());
    let tracer = CpuTracer::new().unwrap();
    let image = trace_image(&tracer, &scene, reference.size, denoised(4))
        .unwrap()
        .image();
    let balls: Vec<usize> = {
        let grid = TileGrid::new(reference.size, 128);
        let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
        let job = TraceJob {
            size: reference.size,
            tiles: &tiles,
            settings: denoised(4),
            cancelled: &AtomicBool::new(false),
        };
        let lit = Mutex::new(Vec::new());
        let sink = |done: carom_tracer::TileAovs| {
            let tile = tiles[done.index];
            for (i, hit) in (0..).zip(&done.pixels) {
                let (x, y) = (tile.x + i % tile.width, tile.y + i / tile.width);
                // Only a coat both reflects light and has an albedo.
                if hit.emission[0] > 1e-3 && hit.albedo.iter().any(|&c| c > 0.0) && x > 0 {
                    lit.lock()
                        .unwrap()
                        .push((y * reference.size.width + x) as usize);
                }
            }
        };
        tracer.aovs(&scene, &job, &sink).unwrap();
        lit.into_inner().unwrap()
    };
    let luminance = |image: &RadianceImage, i: usize| {
        let [r, g, b] = image.pixels[i];
        // As seen on a screen, so that the area lights' own brightness is not all that counts.
        (0.2126 * r + 0.7152 * g + 0.0722 * b).min(1.0)
    };
    let (mut truth, mut along) = (0.0, 0.0);
    let mut edges = 0;
    for i in balls {
        let step = |image| f64::from(luminance(image, i) - luminance(image, i - 1));
        let (there, here) = (step(&reference), step(&image));
        if there.abs() > 0.1 {
            truth += there * there;
            along += there * here;
            edges += 1;
        }
    }
    assert!(edges > 100, "{edges} edges");
    let contrast = along / truth;
    assert!(
        (0.93..1.07).contains(&contrast),
        "{contrast} of the contrast is left"
    );
}

#[test]
fn odd_pictures_are_denoised_too() {
    let scene = pool();
    for tracer in tracers() {
        for size in [
            ImageSize::new(1, 1),
            ImageSize::new(3, 40),
            ImageSize::new(65, 2),
        ] {
            for samples in [1, 2, 3] {
                let film = trace_image(&**tracer, &scene, size, denoised(samples)).unwrap();
                assert_eq!(
                    (film.samples_min(), film.dropped_samples()),
                    (u64::from(samples), 0)
                );
            }
        }
    }
}
