//! Laws of light that every tracer keeps, on scenes whose radiance is known.

use std::f64::consts::PI;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use carom_tracer::film::{Film, trace_image, trace_tiles};
use carom_tracer::metrics::mean;
use carom_tracer::{
    CompiledScene, ImageSize, Lens, ObjectPose, RadianceImage, RenderSettings, ScalarTracer, Scene,
    SceneUpdate, Tile, TileGrid, TileRadiance, TraceJob, Tracer,
};
use glam::{Quat, Vec3};

use crate::scenes::{
    area_light_seen_from, ball, diffuse, empty, lit_floor, plastic, still_life, with,
};
use crate::tracers::tracers;

/// What f32 arithmetic over a path of depth five may lose.
const ROUNDING: f64 = 1e-5;

const SIZE: ImageSize = ImageSize::new(24, 16);

fn settings(samples: u32) -> RenderSettings {
    RenderSettings {
        samples,
        ..RenderSettings::default()
    }
}

fn image(tracer: &dyn Tracer, scene: &Scene, settings: RenderSettings) -> RadianceImage {
    film(tracer, scene, settings).image()
}

fn film(tracer: &dyn Tracer, scene: &Scene, settings: RenderSettings) -> Film {
    let scene = CompiledScene::new(scene).unwrap();
    let film = trace_image(tracer, &scene, SIZE, settings).unwrap();
    assert_eq!(film.dropped_samples(), 0);
    assert_eq!(film.samples_min(), u64::from(settings.samples));
    film
}

fn assert_near(value: f64, expected: f64, relative: f64, what: &str) {
    let difference = (value - expected).abs();
    assert!(
        difference <= relative * expected.abs(),
        "{what}: {value} is not {expected}"
    );
}

#[test]
fn an_empty_scene_shows_its_environment() {
    for tracer in tracers() {
        let image = image(tracer.as_ref(), &empty(0.25), settings(3));
        assert!(
            image.pixels.iter().all(|&pixel| pixel == [0.25; 3]),
            "{:?}",
            tracer.info()
        );
    }
}

/// White furnace: a white convex body in uniform light cannot be seen.
#[test]
fn a_white_diffuse_ball_vanishes_in_uniform_light() {
    let scene = with(empty(1.0), diffuse(1.0), ball());
    for tracer in tracers() {
        for pixel in image(tracer.as_ref(), &scene, settings(4)).pixels {
            for channel in pixel {
                assert_near(f64::from(channel), 1.0, ROUNDING, &tracer.info().name);
            }
        }
    }
}

/// With the exact internal reflectance a coat over a white base takes nothing either. The Monte
/// Carlo error of these 400,000 samples is 2e-4.
#[test]
fn a_white_plastic_ball_vanishes_in_uniform_light() {
    for ior in [1.0, 1.3, 1.5, 3.0] {
        let scene = with(empty(1.0), plastic(1.0, ior), ball());
        for tracer in tracers() {
            let mean = mean(&image(tracer.as_ref(), &scene, settings(1024)));
            assert_near(
                mean[1],
                1.0,
                1e-3,
                &format!("{} at index {ior}", tracer.info().name),
            );
        }
    }
}

#[test]
fn plastic_of_index_1_is_diffuse() {
    let mut scene = still_life();
    for material in scene.materials.values_mut() {
        *material = diffuse(0.6);
    }
    let expected = scene.clone();
    for material in scene.materials.values_mut() {
        *material = plastic(0.6, 1.0);
    }
    for tracer in tracers() {
        let plastic = image(tracer.as_ref(), &scene, settings(4));
        let diffuse = image(tracer.as_ref(), &expected, settings(4));
        assert_same(&plastic, &diffuse, ROUNDING, &tracer.info().name);
    }
}

/// A black base leaves the mirror: the picture of a ball in uniform light is `F(cos θ)`.
#[test]
fn a_black_plastic_ball_shows_the_fresnel_term() {
    let mut scene = with(empty(1.0), plastic(0.0, 1.5), ball());
    scene.camera.fov_x_deg = 0.01;
    for tracer in tracers() {
        let mean = mean(&image(tracer.as_ref(), &scene, settings(1)));
        assert_near(mean[0], 0.04, 1e-4, &tracer.info().name);
    }
}

/// Form factor from a point of a floor to the quarter `[0, a] × [0, b]` of a parallel rectangle at
/// unit height above it (Howell, "A Catalog of Radiation Heat Transfer Configuration Factors",
/// B-3); odd in both, so that other rectangles are sums of four.
fn form_factor(a: f64, b: f64) -> f64 {
    let side = |a: f64, b: f64| {
        let slant = (1.0 + a * a).sqrt();
        a / slant * (b / slant).atan()
    };
    (side(a, b) + side(b, a)) / (2.0 * PI)
}

#[test]
fn floor_radiance_equals_form_factor() {
    for (x, y) in [(0.0f32, 0.0f32), (0.7, -0.3), (2.5, 1.0)] {
        let scene = lit_floor(Vec3::new(x, y, 0.0), true);
        let (x, y) = (f64::from(x), f64::from(y));
        let corner = |sx: f64, sy: f64| form_factor((1.0 + sx * x) / 1.5, (0.5 + sy * y) / 1.5);
        let factor = corner(1.0, 1.0) + corner(-1.0, 1.0) + corner(1.0, -1.0) + corner(-1.0, -1.0);
        for tracer in tracers() {
            let mean = mean(&image(tracer.as_ref(), &scene, settings(2048)));
            let what = format!("{} at ({x}, {y})", tracer.info().name);
            assert_near(mean[0], 0.5 * 10.0 * factor, 2e-3, &what);
        }
    }
}

#[test]
fn area_light_emits_from_one_side() {
    for tracer in tracers() {
        let dark = image(tracer.as_ref(), &lit_floor(Vec3::ZERO, false), settings(16));
        assert_eq!(
            mean(&dark),
            [0.0; 3],
            "the floor behind an area light stays black"
        );

        for (eye_z, radiance) in [(-1.0, 10.0), (1.0, 0.0)] {
            let scene = area_light_seen_from(eye_z);
            let seen = image(tracer.as_ref(), &scene, settings(2));
            assert!(
                seen.pixels.iter().all(|&pixel| pixel == [radiance; 3]),
                "{eye_z}"
            );
        }
    }
}

/// Light of a picture, and the mean square of its distance from the middle, in pixels.
fn light_and_mean_square(image: &RadianceImage) -> (f64, f64) {
    let ImageSize { width, height } = image.size;
    let (mut light, mut moment) = (0.0, 0.0);
    for (pixel, index) in image.pixels.iter().zip(0..) {
        let from_middle = |at: u32, edge: u32| f64::from(at) + 0.5 - 0.5 * f64::from(edge);
        let (x, y) = (
            from_middle(index % width, width),
            from_middle(index / width, height),
        );
        light += f64::from(pixel[0]);
        moment += f64::from(pixel[0]) * (x * x + y * y);
    }
    (light, moment / light)
}

#[test]
fn a_lens_blurs_a_point_to_the_disc_of_geometrical_optics() {
    const SIZE: ImageSize = ImageSize::new(65, 65);
    const APERTURE_RADIUS_M: f32 = 0.05;
    const DISTANCE_M: f32 = 2.0;
    let mut scene = area_light_seen_from(-DISTANCE_M);
    scene.environment.radiance = Vec3::ZERO;
    scene.area_lights[0].half_u *= 0.01;
    scene.area_lights[0].half_v *= 0.02;
    scene.camera.fov_x_deg = 10.0;
    let pixel = 2.0 * 5f64.to_radians().tan() / f64::from(SIZE.width);
    for tracer in tracers() {
        let mut seen_at = |focus_distance_m: f32| {
            scene.camera.lens = Lens {
                aperture_radius_m: APERTURE_RADIUS_M,
                focus_distance_m,
            };
            let scene = CompiledScene::new(&scene).unwrap();
            let film = trace_image(tracer.as_ref(), &scene, SIZE, settings(256)).unwrap();
            light_and_mean_square(&film.image())
        };
        let (light, sharp) = seen_at(DISTANCE_M);
        for focus_distance_m in [1.0, 8.0] {
            let (spread, blurred) = seen_at(focus_distance_m);
            assert_near(spread, light, 0.02, "light is spread, not lost");
            let defocus = 1.0 / f64::from(DISTANCE_M) - 1.0 / f64::from(focus_distance_m);
            let radius = f64::from(APERTURE_RADIUS_M) * defocus / pixel;
            assert_near(
                blurred - sharp,
                0.5 * radius * radius,
                0.03,
                "a disc's mean square",
            );
        }
    }
}

#[test]
fn what_lies_before_the_near_plane_is_not_seen() {
    let mut scene = with(empty(0.25), diffuse(0.5), ball());
    scene.camera.near_m = 2.0 * scene.camera.eye.distance(scene.camera.target);
    for tracer in tracers() {
        let image = image(tracer.as_ref(), &scene, settings(3));
        assert!(image.pixels.iter().all(|&pixel| pixel == [0.25; 3]));
    }
}

#[test]
fn a_hidden_ball_is_as_if_it_were_not_there() {
    let scene = still_life();
    let hide = SceneUpdate {
        camera: None,
        poses: vec![ObjectPose {
            object: 1,
            position: Vec3::new(0.0, 0.0, 0.3),
            rotation: Quat::IDENTITY,
            visible: false,
        }],
        ..SceneUpdate::default()
    };
    let mut without = scene.clone();
    without.objects.remove(1);
    let mut hidden = CompiledScene::new(&scene).unwrap();
    hidden.apply(&hide).unwrap();
    for tracer in tracers() {
        let expected = image(tracer.as_ref(), &without, settings(2));
        let traced = trace_image(tracer.as_ref(), &hidden, SIZE, settings(2))
            .unwrap()
            .image();
        assert_eq!(traced, expected);
        assert_ne!(traced, image(tracer.as_ref(), &scene, settings(2)));
    }
}

#[test]
fn radiance_is_linear_in_emitters() {
    let scene = still_life();
    let mut brighter = scene.clone();
    brighter.environment.radiance *= 4.0;
    for light in &mut brighter.area_lights {
        light.radiance *= 4.0;
    }
    for tracer in tracers() {
        let mut expected = image(tracer.as_ref(), &scene, settings(4));
        for channel in expected.pixels.as_flattened_mut() {
            *channel *= 4.0;
        }
        let traced = image(tracer.as_ref(), &brighter, settings(4));
        assert_same(&traced, &expected, 1e-6, &tracer.info().name);
    }
}

#[test]
fn longer_paths_only_add_light() {
    let scene = still_life();
    for tracer in tracers() {
        let at = |max_depth| {
            let settings = RenderSettings {
                max_depth,
                ..settings(4)
            };
            image(tracer.as_ref(), &scene, settings)
        };
        let pictures = [0, 1, 2, 5].map(at);
        for pair in pictures.windows(2) {
            let (short, long) = (pair[0].pixels.as_flattened(), pair[1].pixels.as_flattened());
            assert!(
                short
                    .iter()
                    .zip(long)
                    .all(|(short, long)| *short <= long * 1.000_01)
            );
            assert!(mean(&pair[0])[0] < mean(&pair[1])[0]);
        }
    }
}

#[test]
fn paths_without_scattering_show_lights_alone() {
    let settings = RenderSettings {
        max_depth: 0,
        ..settings(1)
    };
    for tracer in tracers() {
        let picture = image(tracer.as_ref(), &still_life(), settings);
        let light = |pixel: &[f32; 3]| [[0.0; 3], [0.05; 3], [8.0; 3], [20.0; 3]].contains(pixel);
        assert!(picture.pixels.iter().all(light), "{}", tracer.info().name);
    }
}

/// Tiles of another size, in another order, in several calls: the same bits.
#[test]
fn picture_is_independent_of_the_partition() {
    let scene = CompiledScene::new(&still_life()).unwrap();
    for tracer in tracers() {
        let whole = Tile {
            x: 0,
            y: 0,
            width: SIZE.width,
            height: SIZE.height,
        };
        let trace = |tiles: &[Tile]| {
            trace_tiles(tracer.as_ref(), &scene, SIZE, settings(3), tiles).unwrap()
        };
        let expected = trace(&[whole]).image();
        for edge in [1, 5, 7, 16] {
            let grid = TileGrid::new(SIZE, edge);
            let mut tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
            tiles.reverse();
            assert_eq!(
                trace(&tiles).image(),
                expected,
                "{} in {edge}",
                tracer.info().name
            );

            let mut film = Film::new(SIZE);
            for part in tiles.chunks(tiles.len().div_ceil(2)) {
                let pixels = trace(part).image().pixels;
                for &tile in part {
                    film.add(tile, &cut(&pixels, tile), 3).unwrap();
                }
            }
            assert_same(&film.image(), &expected, 1e-7, &tracer.info().name);
        }
    }
}

/// A tile's pixels of a whole picture.
fn cut(pixels: &[[f32; 3]], tile: Tile) -> Vec<[f32; 3]> {
    let row = |y: u32| {
        let start = (y * SIZE.width + tile.x) as usize;
        pixels[start..start + tile.width as usize].iter().copied()
    };
    (tile.y..tile.y + tile.height).flat_map(row).collect()
}

/// The same random numbers lead through the same paths: pixels differ by rounding, but for the few
/// whose path rounding sends past the other side of an edge.
#[test]
fn each_tracer_agrees_with_scalar_per_sample() {
    let scene = still_life();
    let expected = image(&ScalarTracer, &scene, settings(4));
    let is_off = |a: &[f32; 3], b: &[f32; 3]| {
        let channels = a.iter().zip(b);
        channels
            .into_iter()
            .any(|(a, b)| (a - b).abs() > 1e-3 * (1.0 + b))
    };
    for tracer in tracers() {
        let traced = image(tracer.as_ref(), &scene, settings(4));
        let pairs = traced.pixels.iter().zip(&expected.pixels);
        let off = pairs.filter(|(a, b)| is_off(a, b)).count();
        assert!(
            off * 50 <= SIZE.pixels(),
            "{}: {off} pixels",
            tracer.info().name
        );
    }
}

#[test]
fn ranges_of_samples_merge_to_the_whole() {
    let scene = still_life();
    for tracer in tracers() {
        let range = |first_sample, samples| {
            let settings = RenderSettings {
                first_sample,
                ..settings(samples)
            };
            image(tracer.as_ref(), &scene, settings)
        };
        let (whole, first, second) = (range(0, 8), range(0, 4), range(4, 4));
        assert_ne!(first, second);
        let mut merged = first;
        let pairs = merged
            .pixels
            .as_flattened_mut()
            .iter_mut()
            .zip(second.pixels.as_flattened());
        pairs.for_each(|(a, b)| *a = 0.5 * (*a + b));
        assert_same(&merged, &whole, 1e-6, &tracer.info().name);
    }
}

#[test]
fn the_seed_chooses_another_picture_of_the_same_light() {
    let scene = still_life();
    for tracer in tracers() {
        let seeded = |seed| {
            let settings = RenderSettings {
                seed,
                ..settings(256)
            };
            image(tracer.as_ref(), &scene, settings)
        };
        let (a, b) = (seeded(1), seeded(2));
        assert_ne!(a, b);
        assert_near(mean(&a)[1], mean(&b)[1], 0.02, &tracer.info().name);
    }
}

#[test]
fn each_tile_is_handed_over_once_and_whole() {
    let scene = CompiledScene::new(&still_life()).unwrap();
    let grid = TileGrid::new(SIZE, 5);
    let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
    for tracer in tracers() {
        for cancelled_after_first in [false, true] {
            let cancelled = AtomicBool::new(false);
            let job = TraceJob {
                size: SIZE,
                tiles: &tiles,
                settings: settings(2),
                cancelled: &cancelled,
            };
            let seen = Mutex::new(vec![0; tiles.len()]);
            let sink = |done: TileRadiance| {
                assert_eq!(done.radiance.len(), tiles[done.index].pixels());
                seen.lock().unwrap()[done.index] += 1;
                cancelled.store(cancelled_after_first, Ordering::Relaxed);
            };
            tracer.trace(&scene, &job, &sink).unwrap();
            let allowed = if cancelled_after_first { 0..=1 } else { 1..=1 };
            assert!(
                seen.into_inner()
                    .unwrap()
                    .iter()
                    .all(|count| allowed.contains(count))
            );
        }
    }
}

#[test]
fn work_that_makes_no_sense_is_refused() {
    let scene = CompiledScene::new(&empty(1.0)).unwrap();
    let tile = Tile {
        x: 20,
        y: 0,
        width: 5,
        height: 1,
    };
    for tracer in tracers() {
        let trace = |size, tiles: &[Tile], settings| {
            let job = TraceJob {
                size,
                tiles,
                settings,
                cancelled: &AtomicBool::new(false),
            };
            tracer
                .trace(&scene, &job, &|_| panic!("nothing is traced"))
                .is_err()
        };
        let nothing = Tile { width: 0, ..tile };
        assert!(trace(SIZE, &[tile], settings(1)));
        assert!(trace(SIZE, &[nothing], settings(1)));
        assert!(trace(
            SIZE,
            &[Tile {
                x: u32::MAX,
                ..tile
            }],
            settings(1)
        ));
        assert!(trace(ImageSize::new(0, 16), &[], settings(1)));
        assert!(trace(SIZE, &[], settings(0)));
        let long = RenderSettings {
            max_depth: 65,
            ..settings(1)
        };
        assert!(trace(SIZE, &[], long));
    }
}

/// Channel by channel, relative to the larger of the value and a hundredth of white.
fn assert_same(a: &RadianceImage, b: &RadianceImage, relative: f64, what: &str) {
    assert_eq!(a.size, b.size);
    for (i, (a, b)) in a
        .pixels
        .as_flattened()
        .iter()
        .zip(b.pixels.as_flattened())
        .enumerate()
    {
        let difference = (f64::from(*a) - f64::from(*b)).abs();
        assert!(
            difference <= relative * f64::from(b.max(0.01)),
            "{what}: {a} is not {b} at value {i}"
        );
    }
}
