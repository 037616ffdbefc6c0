//! Scenes and views at the edge of what numbers hold, on the scalar tracer, on every instruction set
//! of the processor and on the GPU.
//!
//! | # | extreme | where |
//! |---|---|---|
//! | 1 | a ball from 1 m to 10⁷ m | `cpu::geometry`, `gpu::leaf_tests`: `balls_are_met_…`; `scalar::intersect` |
//! | 2 | grazing rays, by the ulp | `cpu::geometry`, `gpu::leaf_tests`: `rays_that_graze_a_ball_…` |
//! | 3 | from a surface outwards and inwards | `laws`: white furnace; `materials`: Beer's law over the chord |
//! | 4 | the eye inside a ball | here |
//! | 5 | rays along the faces of a box | `cpu::geometry`, `gpu::leaf_tests`: `rays_in_the_planes_of_a_box_…`; `scalar::intersect` |
//! | 6 | denormal directions | the same |
//! | 7 | poses and rays that are no numbers | `compiled`: `a_refused_update_…`; `scalar::intersect`; `gpu`: `samples_that_are_not_finite_…` |
//! | 8 | balls that touch, overlap, coincide | here |
//! | 9 | contact shadows | here |
//! | 10 | degenerate area lights | here; without area: `scene::validate` |
//! | 11 | area lights of 10³⁰ and of 0 | here |
//! | 12 | roughness 0, tiny, 1 | `materials`, `scalar::microfacet` |
//! | 13 | indices 1, nearly 1, 1000 | here; `fresnel`; `laws` |
//! | 14 | albedo 0, 1, above | `laws`; `scene::validate` |
//! | 15 | fireflies | here |
//! | 16 | a million frames | `film` |
//! | 17 | pictures of one pixel, of a line; sample indices that wrap | here; `tile`; `sampling`; `gpu` |
//! | 18 | the same random numbers everywhere | `cpu::sampling`, `gpu::leaf_tests`; `laws` |
//! | 19 | seams between devices | `laws`: `each_tracer_follows_…`; `images` |
//! | 20 | fields of view of 0.01° and 179° | here; views that see nothing: `scene::validate` |

use std::collections::BTreeMap;
use std::f64::consts::PI;

use crate::tracers::tracers;
use carom_tracer::film::trace_image;
use carom_tracer::metrics::mean;
use carom_tracer::{
    AreaLight, Camera, CompiledScene, CpuTracer, Environment, ImageSize, Lens, Material, Object,
    RadianceImage, RenderSettings, ScalarTracer, Scene, Shape, Tracer,
};
use glam::{Quat, Vec3};

const SIZE: ImageSize = ImageSize::new(24, 16);

/// Each tracer of [`tracers`], and the CPU's weaker instruction sets.
fn each(test: impl Fn(&dyn Tracer, &str)) {
    for tracer in tracers() {
        test(tracer.as_ref(), &tracer.info().name);
    }
    for level in CpuTracer::levels_available().into_iter().skip(1) {
        let tracer = CpuTracer::with_level(0, level).unwrap();
        test(&tracer, &tracer.info().name);
    }
}

fn picture(tracer: &dyn Tracer, scene: &Scene, size: ImageSize, samples: u32) -> RadianceImage {
    let scene = CompiledScene::new(scene).unwrap();
    let settings = RenderSettings {
        samples,
        ..RenderSettings::default()
    };
    let film = trace_image(tracer, &scene, size, settings).unwrap();
    assert_eq!(film.dropped_samples(), 0, "{}", tracer.info().name);
    film.image()
}

/// Looks from `eye` at `target` with a field of view so small that one point is seen.
fn view(eye: Vec3, target: Vec3, environment: f32) -> Scene {
    Scene {
        camera: Camera {
            eye,
            target,
            up: Vec3::Z,
            fov_x_deg: 0.05,
            lens: Lens::default(),
            near_m: 0.0,
        },
        environment: Environment {
            radiance: Vec3::splat(environment),
        },
        materials: BTreeMap::from([("grey".to_owned(), diffuse(0.5))]),
        objects: Vec::new(),
        area_lights: Vec::new(),
        ..Scene::new()
    }
}

fn diffuse(albedo: f32) -> Material {
    Material::Diffuse {
        albedo: Vec3::splat(albedo),
    }
}

fn with(mut scene: Scene, shape: Shape) -> Scene {
    scene.objects.push(Object {
        name: "object".to_owned(),
        material: "grey".to_owned(),
        shape,
    });
    scene
}

fn ball(center: Vec3, radius: f32) -> Shape {
    Shape::Sphere {
        center,
        radius,
        rotation: Quat::IDENTITY,
    }
}

fn floor() -> Shape {
    Shape::Rectangle {
        center: Vec3::ZERO,
        half_u: Vec3::new(5.0, 0.0, 0.0),
        half_v: Vec3::new(0.0, 5.0, 0.0),
    }
}

fn light(center: Vec3, half_u: Vec3, half_v: Vec3, radiance: f32) -> AreaLight {
    AreaLight {
        name: "lamp".to_owned(),
        center,
        half_u,
        half_v,
        radiance: Vec3::splat(radiance),
        ..AreaLight::new(1.0, 1.0)
    }
}

fn assert_near(value: f64, expected: f64, relative: f64, what: &str) {
    assert!(
        (value - expected).abs() <= relative * expected.abs(),
        "{what}: {value} is not {expected}"
    );
}

/// Paths agree to rounding, but for those few that rounding sends past an edge.
fn assert_follows(picture: &RadianceImage, truth: &RadianceImage, off_max: usize, what: &str) {
    let is_off = |(a, b): &(&[f32; 3], &[f32; 3])| {
        !(0..3).all(|i| (a[i] - b[i]).abs() <= 2e-3 * (0.01 + b[i]))
    };
    let off = picture.pixels.iter().zip(&truth.pixels);
    let off = off.filter(is_off).count();
    assert!(off <= off_max, "{what}: {off} pixels differ");
}

/// Whatever leaves an opaque ball's inside has left it for good: all of it sees the environment.
#[test]
fn inside_an_opaque_ball_its_wall_is_seen_all_round() {
    for eye in [
        Vec3::ZERO,
        Vec3::new(0.0, 0.3, 0.9),
        Vec3::new(0.0, -0.999, 0.0),
    ] {
        let mut scene = with(view(eye, eye + Vec3::Y, 2.0), ball(Vec3::ZERO, 1.0));
        scene.camera.fov_x_deg = 120.0;
        each(|tracer, name| {
            for pixel in picture(tracer, &scene, SIZE, 1).pixels {
                assert_near(f64::from(pixel[1]), 1.0, 1e-5, name);
            }
        });
    }
}

#[test]
fn overlapping_balls_conserve_energy() {
    let touching = 2.0 * 0.028_575;
    for distance in [touching, touching - 1e-6, 0.0] {
        let center = |x: f32| Vec3::new(x, 0.0, 0.0);
        let mut scene = view(Vec3::new(0.02, -0.5, 0.1), center(0.5 * distance), 1.0);
        scene.camera.fov_x_deg = 12.0;
        scene = with(scene, ball(center(0.0), 0.028_575));
        scene = with(scene, ball(center(distance), 0.028_575));
        let truth = picture(&ScalarTracer, &scene, SIZE, 4);
        each(|tracer, name| {
            let seen = picture(tracer, &scene, SIZE, 4);
            let in_range = |c: &f32| (0.0..=1.000_01).contains(c);
            assert!(
                seen.pixels.as_flattened().iter().all(in_range),
                "{name} {distance}"
            );
            assert_eq!(seen, picture(tracer, &scene, SIZE, 4), "{name} {distance}");
            if distance > 0.0 {
                assert_follows(&seen, &truth, 8, name);
            }
        });
    }
}

/// A point of a floor at `s` from where a ball of radius `r` rests sees the ball under the form
/// factor `cos θ · sin² α = (1 + s²/r²)^(−3/2)`: the shadow goes down to the point of contact.
#[test]
fn shadow_reaches_the_contact_point() {
    const RADIUS: f32 = 0.028_575;
    for (ratio, tolerance) in [(0.05, 0.06), (0.3, 0.02), (2.0, 0.01)] {
        let point = Vec3::new(ratio * RADIUS, 0.0, 0.0);
        let eye = point + Vec3::new(0.03, 0.0, 0.001);
        let mut scene = with(view(eye, point, 1.0), floor());
        scene.camera.fov_x_deg = 0.01;
        scene = with(scene, ball(Vec3::new(0.0, 0.0, RADIUS), RADIUS));
        let size = ImageSize::new(32, 32);
        let settings = RenderSettings {
            samples: 256,
            max_depth: 1,
            ..RenderSettings::default()
        };
        let compiled = CompiledScene::new(&scene).unwrap();
        let ratio = f64::from(ratio);
        let expected = 0.5 * (1.0 - (1.0 + ratio * ratio).powf(-1.5));
        each(|tracer, name| {
            let film = trace_image(tracer, &compiled, size, settings).unwrap();
            let what = format!("{name} at {ratio} radii");
            assert_near(mean(&film.image())[0], expected, tolerance, &what);
        });
    }
}

/// Irradiance of a small area light: `L A cos θ cos θ' / d²`.
#[test]
fn micrometre_lights_shine_by_their_area() {
    for (half, radiance) in [(1e-2f32, 1e4f32), (1e-4, 1e8), (1e-6, 1e12)] {
        for (x, z) in [(0.0f32, 1.0f32), (0.7, 0.5), (3.0, 0.2)] {
            let point = Vec3::new(-1.0, 0.5, 0.0);
            let mut scene = with(
                view(point + Vec3::new(0.0, -0.1, 0.05), point, 0.0),
                floor(),
            );
            let center = point + Vec3::new(x, 0.0, z);
            scene
                .area_lights
                .push(light(center, half * Vec3::X, -half * Vec3::Y, radiance));
            let (x, z) = (f64::from(x), f64::from(z));
            let (area, distance2) = (4.0 * f64::from(half).powi(2), x * x + z * z);
            let expected = 0.5 / PI * f64::from(radiance) * area * z * z / distance2.powi(2);
            each(|tracer, name| {
                let seen = mean(&picture(tracer, &scene, SIZE, 16))[0];
                assert_near(seen, expected, 0.01, &format!("{name}: {half} m, {x}, {z}"));
            });
        }
    }
}

#[test]
fn edge_on_lights_give_finite_radiance() {
    let point = Vec3::new(0.3, 0.2, 0.0);
    let area_lights = [
        // In the plane of the floor, under the point and beside it; upright, the point in its plane;
        // a hair above the floor.
        light(Vec3::ZERO, Vec3::X, Vec3::Y, 5.0),
        light(Vec3::new(2.0, 0.0, 0.0), Vec3::X, Vec3::NEG_Y, 5.0),
        light(Vec3::new(0.3, 1.0, 0.5), 0.2 * Vec3::Y, 0.2 * Vec3::Z, 5.0),
        light(Vec3::new(0.0, 0.0, 1e-6), Vec3::X, Vec3::NEG_Y, 5.0),
    ];
    for (index, light) in area_lights.into_iter().enumerate() {
        let mut scene = with(view(point + Vec3::new(0.0, -1.5, 1.0), point, 0.0), floor());
        scene.area_lights.push(light);
        each(|tracer, name| {
            let seen = picture(tracer, &scene, SIZE, 8);
            let in_range = |c: &f32| (0.0..=5.001).contains(c);
            assert!(
                seen.pixels.as_flattened().iter().all(in_range),
                "{name}, area light {index}"
            );
        });
    }
}

#[test]
fn radiance_is_linear_up_to_1e30() {
    let eye = Vec3::new(0.0, -2.0, 1.0);
    let mut scene = with(
        with(view(eye, Vec3::ZERO, 0.1), floor()),
        ball(0.3 * Vec3::Z, 0.3),
    );
    scene.camera.fov_x_deg = 40.0;
    let one = light(Vec3::new(0.2, 0.0, 1.5), 0.5 * Vec3::X, -0.3 * Vec3::Y, 1.0);
    scene.area_lights = vec![
        one.clone(),
        light(
            Vec3::new(-1.0, 0.0, 1.0),
            0.2 * Vec3::X,
            -0.2 * Vec3::Y,
            0.3,
        ),
    ];
    let scaled = |scale: f32| {
        let mut scaled = scene.clone();
        scaled.environment.radiance *= scale;
        for light in &mut scaled.area_lights {
            light.radiance *= scale;
        }
        scaled
    };
    each(|tracer, name| {
        let truth = picture(tracer, &scene, SIZE, 4);
        for scale in [1e6f32, 1e30, 1e-20] {
            let seen = picture(tracer, &scaled(scale), SIZE, 4);
            for (a, b) in seen
                .pixels
                .as_flattened()
                .iter()
                .zip(truth.pixels.as_flattened())
            {
                let b = f64::from(*b) * f64::from(scale);
                assert!(
                    (f64::from(*a) - b).abs() <= 3e-6 * b,
                    "{name} {scale}: {a} is not {b}"
                );
            }
        }
        let dark = picture(tracer, &scaled(0.0), SIZE, 4);
        assert!(
            dark.pixels.as_flattened().iter().all(|c| *c == 0.0),
            "{name}"
        );
    });
}

/// A coat that is no coat, and one that lets nothing in or out but by its mirror.
#[test]
fn coats_of_every_index_keep_the_furnace_white() {
    for ior in [1.0f32, 1.000_001, 1.000_1, 2.5] {
        let eye = Vec3::new(0.0, -3.0, 0.0);
        let mut scene = with(view(eye, Vec3::ZERO, 1.0), ball(Vec3::ZERO, 1.0));
        scene.camera.fov_x_deg = 20.0;
        let coated = Material::SmoothPlastic {
            albedo: Vec3::ONE,
            ior,
            internal_reflectance: None,
            stripe: None,
        };
        scene.materials.insert("grey".to_owned(), coated);
        each(|tracer, name| {
            let seen = mean(&picture(tracer, &scene, SIZE, 512))[1];
            assert_near(seen, 1.0, 1e-3, &format!("{name} at index {ior}"));
        });
    }
}

/// No estimate of a sample exceeds the brightest area light: nothing needs to be clamped.
#[test]
fn no_sample_is_brighter_than_brightest_light() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/scenes/pool.json");
    let scene = Scene::load(path).unwrap();
    each(|tracer, name| {
        let seen = picture(tracer, &scene, ImageSize::new(160, 90), 1);
        let brightest = seen
            .pixels
            .as_flattened()
            .iter()
            .fold(0.0f32, |a, b| a.max(*b));
        assert!(brightest <= 17.0 * 1.001, "{name}: {brightest}");
    });
}

#[test]
fn pictures_of_a_pixel_and_of_a_line_are_traced() {
    let eye = Vec3::new(0.0, -2.0, 1.0);
    let mut scene = with(
        with(view(eye, Vec3::ZERO, 1.0), floor()),
        ball(0.3 * Vec3::Z, 0.3),
    );
    scene.camera.fov_x_deg = 60.0;
    for size in [
        ImageSize::new(1, 1),
        ImageSize::new(16_384, 1),
        ImageSize::new(1, 16_384),
    ] {
        let truth = picture(&ScalarTracer, &scene, size, 1);
        each(|tracer, name| {
            let seen = picture(tracer, &scene, size, 1);
            assert_follows(&seen, &truth, size.pixels() / 200, name);
        });
    }
}

/// At 0.01° and 480 pixels an f32 direction has steps of a sixth of a pixel: edges move by that.
#[test]
fn extreme_fields_of_view_agree_with_scalar() {
    for (fov, off_max) in [(0.01f32, 24), (179.0, 8)] {
        let eye = Vec3::new(0.0, -3.0, 0.5);
        let mut scene = with(view(eye, Vec3::new(0.3, 0.0, 0.3), 1.0), floor());
        scene.camera.fov_x_deg = fov;
        scene = with(scene, ball(0.3 * Vec3::Z, 0.3));
        let truth = picture(&ScalarTracer, &scene, SIZE, 2);
        each(|tracer, name| {
            let seen = picture(tracer, &scene, SIZE, 2);
            assert_follows(&seen, &truth, off_max, &format!("{name} at {fov}°"));
        });
    }
}
