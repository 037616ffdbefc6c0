//! The GPU against the scalar tracer, and against itself however its work is cut.
//!
//! Any adapter will do, software Vulkan too (`mesa-vulkan-drivers`); without one the tests are
//! skipped, unless `CAROM_REQUIRE_GPU` is set.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{LazyLock, Mutex};
use std::thread;

use carom_tracer::gpu::AdapterChoice;
use carom_tracer::{
    Axis, CompiledScene, CpuTracer, CsgSolid, Error, GpuTracer, ImageSize, Object, ObjectPose,
    RenderSettings, ScalarTracer, Scene, SceneUpdate, Shape, Tile, TileGrid, TileRadiance,
    TraceJob, TraceStats, Tracer,
};
use glam::{Quat, Vec3};

use crate::scenes::{diffuse, plastic, still_life, subtraction, with};

static GPU: LazyLock<Result<GpuTracer, Error>> =
    LazyLock::new(|| GpuTracer::new(&AdapterChoice::Any));

/// The GPU that all tests share, or none and a reason.
fn gpu() -> Option<&'static GpuTracer> {
    match &*GPU {
        Ok(tracer) => Some(tracer),
        Err(error) if std::env::var_os("CAROM_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            eprintln!("skipped: {error}");
            None
        }
    }
}

fn asset(name: &str) -> Scene {
    let scenes = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/scenes/");
    Scene::load(format!("{scenes}{name}")).unwrap()
}

fn pool() -> Scene {
    asset("pool.json")
}

fn compiled(scene: &Scene) -> CompiledScene {
    CompiledScene::new(scene).unwrap()
}

fn settings(samples: u32) -> RenderSettings {
    RenderSettings {
        samples,
        ..RenderSettings::default()
    }
}

/// A picture, row-major, put together from `tiles`; pixels of none are NaN.
struct Picture {
    pixels: Vec<[f32; 3]>,
    stats: TraceStats,
    tiles: usize,
}

fn trace(
    tracer: &dyn Tracer,
    scene: &CompiledScene,
    size: ImageSize,
    tiles: &[Tile],
    settings: RenderSettings,
) -> Picture {
    let film = Mutex::new((vec![[f32::NAN; 3]; size.pixels()], 0));
    let job = TraceJob {
        size,
        tiles,
        settings,
        cancelled: &AtomicBool::new(false),
    };
    let stats = tracer.trace(scene, &job, &|done| {
        let tile = tiles[done.index];
        assert_eq!(done.radiance.len(), tile.pixels());
        assert_eq!(done.dropped_samples, 0);
        let mut film = film.lock().unwrap();
        film.1 += 1;
        for (row, line) in (tile.y..).zip(done.radiance.chunks(tile.width as usize)) {
            let begin = (row * size.width + tile.x) as usize;
            film.0[begin..begin + line.len()].copy_from_slice(line);
        }
    });
    let (pixels, tiles) = film.into_inner().unwrap();
    let stats = stats.unwrap();
    Picture {
        pixels,
        stats,
        tiles,
    }
}

fn whole(
    tracer: &dyn Tracer,
    scene: &CompiledScene,
    size: ImageSize,
    settings: RenderSettings,
) -> Picture {
    let grid = TileGrid::new(size, 16);
    let tiles: Vec<_> = grid.tiles(grid.all()).collect();
    trace(tracer, scene, size, &tiles, settings)
}

/// Same random numbers, same estimator: paths agree to the rounding of f32, about 1e-6, but for the
/// few whose edge passes an edge, or whose lobe is chosen, on the other side of a rounding.
/// Those are below 1 in 100, and unbiased: the means differ by less than 1 %.
#[track_caller]
fn assert_agrees(picture: &Picture, truth: &Picture) {
    assert_agrees_but_for(0.01, picture, truth);
}

/// [`assert_agrees`], but for a given share of pixels.
#[track_caller]
fn assert_agrees_but_for(share: f64, picture: &Picture, truth: &Picture) {
    let differs = |(a, b): &(&[f32; 3], &[f32; 3])| {
        let (a, b) = (Vec3::from(**a), Vec3::from(**b));
        !(a - b).abs().cmple(1e-3 * (0.1 + b)).all()
    };
    let pairs = picture.pixels.iter().zip(&truth.pixels);
    let differing = pairs.filter(differs).count();
    assert!(
        differing as f64 <= share * truth.pixels.len() as f64,
        "{differing} of {} pixels differ",
        truth.pixels.len()
    );
    let (mean, expected) = (mean(picture), mean(truth));
    assert!(
        (mean - expected).abs().cmple(0.01 * expected).all(),
        "mean {mean} instead of {expected}"
    );
    let rays = picture.stats.rays.abs_diff(truth.stats.rays);
    assert!(
        rays * 1000 <= truth.stats.rays,
        "{} rays instead of {}",
        picture.stats.rays,
        truth.stats.rays
    );
    assert_eq!(picture.stats.samples, truth.stats.samples);
}

fn mean(picture: &Picture) -> Vec3 {
    let sum: Vec3 = picture.pixels.iter().copied().map(Vec3::from).sum();
    sum / picture.pixels.len() as f32
}

/// Ten thousand balls that touch. Mirrors among them magnify rounding: twice as many paths may turn.
#[test]
fn bvh_of_balls_agrees_with_scalar_per_sample() {
    let Some(gpu) = gpu() else { return };
    let (scene, size) = (compiled(&asset("pyramid.json")), ImageSize::new(48, 27));
    let picture = whole(gpu, &scene, size, settings(1));
    let truth = whole(&ScalarTracer, &scene, size, settings(1));
    assert_agrees_but_for(0.02, &picture, &truth);
}

/// Pillars and boxes that lie together, far from balls among which rays begin: their bounds are tested before them.
#[test]
fn clusters_of_boxes_agree_with_scalar_per_sample() {
    let Some(gpu) = gpu() else { return };
    let mut scene = still_life();
    for place in 0..12_u8 {
        let min = Vec3::new(0.3 * f32::from(place) - 1.8, 2.5, 0.0);
        let max = min + Vec3::new(0.2, 0.3, 0.2 + 0.1 * f32::from(place));
        scene = with(scene, diffuse(0.7), Shape::Box { min, max });
        let (min, max) = (min + 1.2 * Vec3::Y, max + 1.2 * Vec3::Y + Vec3::Z);
        let post = CsgSolid::ConeExterior {
            axis: Axis::Z,
            center: 0.5 * (min + max),
            radius: 0.1,
            taper: 0.02,
            beyond: Vec3::ZERO,
        };
        let shape = Shape::CsgBox {
            min,
            max,
            subtractions: vec![subtraction(post, None)],
        };
        scene = with(scene, plastic(0.5, 1.5), shape);
    }
    let (scene, size) = (compiled(&scene), ImageSize::new(96, 54));
    let picture = whole(gpu, &scene, size, settings(2));
    let truth = whole(&ScalarTracer, &scene, size, settings(2));
    assert_agrees(&picture, &truth);
}

#[test]
fn pool_table_agrees_with_scalar_per_sample() {
    let Some(gpu) = gpu() else { return };
    let (scene, size) = (compiled(&pool()), ImageSize::new(96, 54));
    let first_sample = u32::MAX; // the index wraps
    for settings in [
        settings(1),
        RenderSettings {
            first_sample,
            samples: 2,
            seed: 77,
            denoise: false,
            max_depth: 2,
        },
    ] {
        let picture = whole(gpu, &scene, size, settings);
        assert_agrees(&picture, &whole(&ScalarTracer, &scene, size, settings));
    }
}

#[test]
fn longest_and_shortest_paths_agree_with_scalar() {
    let Some(gpu) = gpu() else { return };
    let (scene, size) = (compiled(&pool()), ImageSize::new(48, 27));
    for max_depth in [0, 1, RenderSettings::DEPTH_MAX] {
        let settings = RenderSettings {
            max_depth,
            ..settings(2)
        };
        let picture = whole(gpu, &scene, size, settings);
        assert_agrees(&picture, &whole(&ScalarTracer, &scene, size, settings));
    }
}

/// Software Vulkan ends loops after so many turns, wherever they are.
#[test]
fn light_of_long_loops_is_all_there_or_refused() {
    let Some(gpu) = gpu() else { return };
    let mut scene = pool();
    let object = scene.objects[0].clone();
    for (boxes, samples) in [(0, 4096), (900, 16), (20_000, 1)] {
        let row = |i: usize| {
            let min = Vec3::new(60.0, 300.0 + 0.01 * i as f32, 60.0);
            let max = min + 0.005;
            let shape = Shape::Box { min, max };
            Object {
                shape,
                ..object.clone()
            }
        };
        scene.objects.extend((0..boxes).map(row));
        let (scene, size) = (compiled(&scene), ImageSize::new(6, 4));
        let tile = Tile {
            x: 0,
            y: 0,
            width: size.width,
            height: size.height,
        };
        let job = TraceJob {
            size,
            tiles: &[tile],
            settings: settings(samples),
            cancelled: &AtomicBool::new(false),
        };
        let mean = |tracer: &dyn Tracer| {
            let sum = Mutex::new(Vec3::ZERO);
            let add = |done: TileRadiance| {
                *sum.lock().unwrap() += done.radiance.iter().copied().map(Vec3::from).sum::<Vec3>();
            };
            tracer.trace(&scene, &job, &add)?;
            Ok(sum.into_inner().unwrap() / tile.pixels() as f32)
        };
        match mean(gpu) {
            Ok(picture) => {
                let truth = mean(&CpuTracer::new().unwrap()).unwrap();
                assert!(
                    ((picture - truth) / truth).abs().max_element() < 2e-3,
                    "{boxes} boxes: {picture} {truth}"
                );
            }
            Err(Error::Device { message, .. }) => {
                assert!(boxes == 20_000 && message.contains("loops"), "{message}");
            }
            Err(error) => panic!("{error}"),
        }
    }
}

#[test]
fn posed_and_hidden_balls_agree_with_scalar() {
    let Some(gpu) = gpu() else { return };
    let (mut scene, size) = (compiled(&pool()), ImageSize::new(64, 36));
    let is_ball = |shape: &Shape| matches!(shape, Shape::Sphere { .. });
    let balls = pool().objects.into_iter().enumerate();
    let balls = balls.filter(|(_, object)| is_ball(&object.shape));
    let poses = balls.map(|(object, _)| ObjectPose {
        object: object as u32,
        position: Vec3::new(
            -0.9 + 0.09 * object as f32,
            0.03 * object as f32 - 0.2,
            0.0286,
        ),
        rotation: Quat::from_rotation_x(object as f32),
        visible: object % 3 > 0,
    });
    let update = SceneUpdate {
        camera: None,
        poses: poses.collect(),
        ..SceneUpdate::default()
    };
    scene.apply(&update).unwrap();
    let picture = whole(gpu, &scene, size, settings(2));
    assert_agrees(&picture, &whole(&ScalarTracer, &scene, size, settings(2)));
}

#[test]
fn every_subset_of_a_scene_agrees_with_scalar() {
    let Some(gpu) = gpu() else { return };
    let size = ImageSize::new(32, 18);
    for left_out in 0..6 {
        let mut scene = pool();
        match left_out {
            0 => scene.area_lights.clear(),
            1 => scene.area_lights.truncate(1),
            2 => scene.objects.clear(),
            kind => scene.objects.retain(|object| match object.shape {
                Shape::Sphere { .. } => kind != 3,
                Shape::Box { .. } | Shape::CsgBox { .. } | Shape::TruncatedCone { .. } => kind != 4,
                Shape::Disc { .. } | Shape::Rectangle { .. } => kind != 5,
                _ => true,
            }),
        }
        let scene = compiled(&scene);
        let picture = whole(gpu, &scene, size, settings(1));
        let truth = whole(&ScalarTracer, &scene, size, settings(1));
        assert_agrees(&picture, &truth);
    }
}

#[test]
fn scene_beyond_uniform_memory_agrees_with_scalar() {
    let Some(gpu) = gpu() else { return };
    let mut scene = pool();
    let ball = scene
        .objects
        .iter()
        .find(|object| matches!(object.shape, Shape::Sphere { .. }))
        .unwrap()
        .clone();
    // 2500 spheres of 32 bytes are more than the 64 KiB of a uniform buffer.
    for i in 0..2500 {
        let (row, column) = (i / 50, i % 50);
        let mut ball = ball.clone();
        ball.shape = Shape::Sphere {
            center: Vec3::new(0.05 * row as f32 - 1.2, 0.025 * column as f32 - 0.6, 0.01),
            radius: 0.01,
            rotation: Quat::IDENTITY,
        };
        scene.objects.push(ball);
    }
    let (scene, size) = (compiled(&scene), ImageSize::new(24, 16));
    let picture = whole(gpu, &scene, size, settings(1));
    assert_agrees(&picture, &whole(&ScalarTracer, &scene, size, settings(1)));
}

#[test]
fn picture_is_independent_of_the_partition() {
    let Some(gpu) = gpu() else { return };
    let (scene, size) = (compiled(&pool()), ImageSize::new(61, 37));
    let expected = whole(gpu, &scene, size, settings(3));
    for edge in [1, 7, 8, 61] {
        let grid = TileGrid::new(size, edge);
        let mut tiles: Vec<_> = grid.tiles(grid.all()).collect();
        tiles.reverse();
        let picture = trace(gpu, &scene, size, &tiles, settings(3));
        assert_eq!(picture.tiles, tiles.len());
        assert_eq!(picture.pixels, expected.pixels, "tiles of {edge}");
        assert_eq!(picture.stats.rays, expected.stats.rays);
    }
}

#[test]
fn picture_is_the_mean_of_its_sample_halves() {
    let Some(gpu) = gpu() else { return };
    let (scene, size) = (compiled(&pool()), ImageSize::new(40, 24));
    let all = whole(gpu, &scene, size, settings(8));
    let halves = [0, 4].map(|first_sample| {
        let settings = RenderSettings {
            first_sample,
            ..settings(4)
        };
        whole(gpu, &scene, size, settings)
    });
    let rays = halves.iter().map(|half| half.stats.rays).sum::<u64>();
    assert_eq!(all.stats.rays, rays);
    for (pixel, whole) in all.pixels.iter().enumerate() {
        let [a, b] = [0, 1].map(|half| Vec3::from(halves[half].pixels[pixel]));
        let error = (0.5 * (a + b) - Vec3::from(*whole)).abs();
        // Three additions and a division round differently.
        assert!(error.cmple(1e-6 * (1e-3 + Vec3::from(*whole))).all());
    }
}

#[test]
fn frames_in_flight_at_once_do_not_disturb_each_other() {
    let Some(gpu) = gpu() else { return };
    let size = ImageSize::new(48, 27);
    let mut unlit = pool();
    unlit.area_lights.clear();
    let scenes = [compiled(&pool()), compiled(&unlit)];
    let frame = |i: u32| {
        let settings = RenderSettings {
            seed: i,
            ..settings(1 + i % 3)
        };
        whole(gpu, &scenes[i as usize % 2], size, settings).pixels
    };
    let expected: Vec<_> = (0..6).map(frame).collect();
    let concurrent: Vec<_> = thread::scope(|scope| {
        let threads: Vec<_> = (0..6).map(|i| scope.spawn(move || frame(i))).collect();
        threads.into_iter().map(|t| t.join().unwrap()).collect()
    });
    assert_eq!(concurrent, expected);
}

#[test]
fn scenes_may_alternate() {
    let Some(gpu) = gpu() else { return };
    let size = ImageSize::new(24, 16);
    let (lit, mut other) = (compiled(&pool()), pool());
    other.objects.truncate(5);
    let other = compiled(&other);
    let first = whole(gpu, &lit, size, settings(1)).pixels;
    let second = whole(gpu, &other, size, settings(1)).pixels;
    assert_ne!(first, second);
    assert_eq!(whole(gpu, &lit, size, settings(1)).pixels, first);
    assert_eq!(whole(gpu, &other, size, settings(1)).pixels, second);
}

#[test]
fn no_tile_and_one_pixel_are_traced_as_they_are() {
    let Some(gpu) = gpu() else { return };
    let (scene, size) = (compiled(&pool()), ImageSize::new(40, 24));
    let nothing = trace(gpu, &scene, size, &[], settings(1));
    assert_eq!((nothing.tiles, nothing.stats), (0, TraceStats::default()));
    let pixel = Tile {
        x: 17,
        y: 11,
        width: 1,
        height: 1,
    };
    let one = trace(gpu, &scene, size, &[pixel], settings(2));
    let all = whole(gpu, &scene, size, settings(2));
    let place = 11 * 40 + 17;
    assert_eq!(one.pixels[place], all.pixels[place]);
    assert_eq!(one.stats.samples, 2);
}

#[test]
fn cancelled_job_ends_early_with_right_tiles() {
    let Some(gpu) = gpu() else { return };
    let (scene, size) = (compiled(&pool()), ImageSize::new(1024, 512));
    let grid = TileGrid::new(size, 64);
    let tiles: Vec<_> = grid.tiles(grid.all()).collect();
    let settings = RenderSettings {
        samples: RenderSettings::SAMPLES_MAX,
        ..settings(1)
    };
    let cancelled = AtomicBool::new(true);
    let job = TraceJob {
        size,
        tiles: &tiles,
        settings,
        cancelled: &cancelled,
    };
    let stats = gpu.trace(&scene, &job, &|_| panic!("cancelled before it began"));
    assert_eq!(stats.unwrap().samples, 0);

    // 34 billion samples would take hours: the test ends because the call does.
    cancelled.store(false, Ordering::Relaxed);
    thread::scope(|scope| {
        let tracing = scope.spawn(|| gpu.trace(&scene, &job, &|_| panic!("no tile can be done")));
        // Another job is done meanwhile, so that the first is under way.
        whole(gpu, &scene, ImageSize::new(8, 8), self::settings(1));
        cancelled.store(true, Ordering::Relaxed);
        let stats = tracing.join().unwrap().unwrap();
        assert!(stats.samples < size.pixels() as u64 * u64::from(settings.samples));
    });
}

#[test]
fn the_longest_sum_loses_nothing() {
    let Some(gpu) = gpu() else { return };
    let mut scene = pool();
    scene.objects.clear();
    scene.area_lights.clear();
    scene.environment.radiance = Vec3::new(0.1, 0.3, 1e-3);
    let settings = settings(RenderSettings::SAMPLES_MAX);
    let picture = whole(gpu, &compiled(&scene), ImageSize::new(2, 2), settings);
    for pixel in picture.pixels {
        let error = (Vec3::from(pixel) - scene.environment.radiance).abs();
        assert!(
            error.cmple(2e-7 * scene.environment.radiance).all(),
            "{pixel:?}"
        );
    }
}

#[test]
fn samples_that_are_not_finite_are_counted_and_black() {
    let Some(gpu) = gpu() else { return };
    let mut scene = compiled(&pool());
    for spoilt in [f32::INFINITY, f32::NAN] {
        // Paths that end on an area light or within the table stay finite.
        scene.environment = Vec3::new(0.0, spoilt, 0.0);
        let grid = TileGrid::new(ImageSize::new(32, 18), 32);
        let job = TraceJob {
            size: grid.size,
            tiles: &[grid.tile(0)],
            settings: settings(4),
            cancelled: &AtomicBool::new(false),
        };
        let tiles = [gpu as &dyn Tracer, &ScalarTracer].map(|tracer| {
            let tile = Mutex::new(None);
            let keep = |done| *tile.lock().unwrap() = Some(done);
            tracer.trace(&scene, &job, &keep).unwrap();
            tile.into_inner().unwrap().unwrap()
        });
        let [traced, truth] = tiles.map(|tile| {
            assert!(tile.radiance.as_flattened().iter().all(|c| c.is_finite()));
            tile.dropped_samples
        });
        assert!(truth > 0);
        assert!(
            traced.abs_diff(truth) * 100 <= truth,
            "{traced}, not {truth}"
        );
    }
}

#[test]
fn a_job_outside_its_image_is_refused() {
    let Some(gpu) = gpu() else { return };
    let tile = Tile {
        x: u32::MAX,
        y: 0,
        width: 2,
        height: 1,
    };
    let job = TraceJob {
        size: ImageSize::new(8, 8),
        tiles: &[tile],
        settings: settings(1),
        cancelled: &AtomicBool::new(false),
    };
    let refused = gpu.trace(&compiled(&pool()), &job, &|_| panic!("nothing to trace"));
    assert!(
        matches!(refused, Err(Error::InvalidSettings(_))),
        "{refused:?}"
    );
}

#[test]
fn a_material_that_does_not_exist_is_refused() {
    let Some(gpu) = gpu() else { return };
    let mut scene = compiled(&pool());
    scene.spheres[0].material = 1000;
    let grid = TileGrid::new(ImageSize::new(8, 8), 8);
    let job = TraceJob {
        size: grid.size,
        tiles: &[grid.tile(0)],
        settings: settings(1),
        cancelled: &AtomicBool::new(false),
    };
    let refused = gpu.trace(&scene, &job, &|_| panic!("nothing to trace"));
    assert!(
        matches!(refused, Err(Error::InvalidScene(_))),
        "{refused:?}"
    );
}

#[test]
fn balls_far_from_the_origin_agree_with_scalar() {
    let Some(gpu) = gpu() else { return };
    let (mut scene, size) = (pool(), ImageSize::new(48, 27));
    // Multiples of 1/64 m: the spacing of f32 there, so that all coordinates stay exact.
    let shift = Vec3::new(1024.0, -2048.0, 512.0);
    let snap = |v: Vec3| (v * 64.0).round() / 64.0 + shift;
    scene.camera.eye = snap(scene.camera.eye);
    scene.camera.target = snap(scene.camera.target);
    scene
        .objects
        .retain(|object| matches!(object.shape, Shape::Sphere { .. }));
    for object in &mut scene.objects {
        let Shape::Sphere { center, .. } = &mut object.shape else {
            unreachable!()
        };
        *center = snap(*center);
    }
    for light in &mut scene.area_lights {
        light.center = snap(light.center);
    }
    let scene = compiled(&scene);
    let picture = whole(gpu, &scene, size, settings(1));
    assert_agrees(&picture, &whole(&ScalarTracer, &scene, size, settings(1)));
}
