//! Glass, gold and wax: against the independent renderer's picture, and laws of light.

use std::path::{Path, PathBuf};

use carom_tracer::film::{trace_estimate, trace_image};
use carom_tracer::metrics::{Estimate, Region, mean, region};
use carom_tracer::regularisation;
use carom_tracer::sampling::uniforms;
use carom_tracer::scalar::scatter::Scatter;
use carom_tracer::scalar::{Ray, intersect};
use carom_tracer::{
    Axis, CompiledScene, CsgSolid, ImageSize, Material, Medium, ObjectPose, ProceduralTexture,
    RadianceImage, RenderSettings, ScalarTracer, Scene, SceneUpdate, Shape, Tile, Tracer,
};
use glam::{DVec3, Quat, Vec3, Vec3Swizzles as _};

use crate::scenes::{
    furnace, glass, glass_box, gold, object, subtraction, textured_still_life, white_csg_block,
};
use crate::tracers::tracers;

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

fn picture(name: &str) -> RadianceImage {
    RadianceImage::read_exr(repository("tests/references").join(name)).unwrap()
}

/// Squares of 16 pixels on the wax, the gold and the glass, their edges, their shadows and the
/// caustic.
const PLACES: [(u32, u32); 14] = [
    (72, 120),
    (110, 160),
    (40, 160),
    (80, 196),
    (200, 120),
    (270, 170),
    (232, 196),
    (240, 96),
    (388, 110),
    (350, 168),
    (430, 176),
    (400, 204),
    (356, 222),
    (192, 88),
];

/// Without bias, |z| passes 4.5 once in 150,000 cases; the samples are fixed, so that a tracer
/// that passes once always does.
#[test]
fn glass_gold_and_wax_agree_with_mitsuba() {
    let reference = Estimate {
        mean: picture("materials_480x270.exr"),
        stderr: picture("materials_480x270_stderr.exr"),
    };
    let scene = Scene::load(repository("assets/scenes/materials.json")).unwrap();
    let scene = CompiledScene::new(&scene).unwrap();
    let tile = |&(x, y): &(u32, u32)| Tile {
        x,
        y,
        width: 16,
        height: 16,
    };
    let tiles: Vec<Tile> = PLACES.iter().map(tile).collect();
    let settings = RenderSettings {
        samples: 8,
        first_sample: regularisation::SAMPLES,
        max_depth: 63,
        ..RenderSettings::default()
    };
    for tracer in tracers() {
        let name = tracer.info().name;
        let size = reference.mean.size;
        let traced = trace_estimate(tracer.as_ref(), &scene, size, settings, &tiles, 8).unwrap();
        let regions: Vec<Region> = tiles
            .iter()
            .map(|&tile| region(&traced, &reference, tile).unwrap())
            .collect();
        for region in &regions {
            assert!(region.z.iter().all(|z| z.abs() < 4.5), "{name}: {region:?}");
        }
        let sum = |value: fn(&Region) -> [f64; 3]| regions.iter().flat_map(value).sum::<f64>();
        let ratio = sum(|r| r.mean) / sum(|r| r.reference);
        assert!(
            (ratio - 1.0).abs() < 0.01,
            "{name}: {ratio} of the reference's light"
        );
    }
}

/// Aiming at area lights through the boundary of a ball takes and adds no light, and leaves less than a sixth of
/// the variance on the wax.
#[test]
fn refracted_nee_is_unbiased_and_quiet() {
    let scene = Scene::load(repository("assets/scenes/materials.json")).unwrap();
    let aiming = CompiledScene::new(&scene).unwrap();
    let mut by_chance = aiming.clone();
    assert_eq!(
        aiming
            .spheres
            .iter()
            .map(|ball| ball.allows_refracted_nee)
            .sum::<u32>(),
        1
    );
    for ball in &mut by_chance.spheres {
        ball.allows_refracted_nee = 0;
    }
    let size = ImageSize::new(480, 270);
    let tiles = [(72, 120), (110, 160)].map(|(x, y)| Tile {
        x,
        y,
        width: 16,
        height: 16,
    });
    let settings = RenderSettings {
        samples: 8,
        first_sample: regularisation::SAMPLES,
        max_depth: 63,
        ..RenderSettings::default()
    };
    for tracer in tracers() {
        let name = tracer.info().name;
        let estimate =
            |scene| trace_estimate(tracer.as_ref(), scene, size, settings, &tiles, 16).unwrap();
        let (aiming, by_chance) = (estimate(&aiming), estimate(&by_chance));
        for tile in tiles {
            let region = region(&aiming, &by_chance, tile).unwrap();
            assert!(region.z.iter().all(|z| z.abs() < 4.5), "{name}: {region:?}");
        }
        let variance = |estimate: &Estimate| {
            let errors = estimate.stderr.pixels.as_flattened().iter();
            errors.map(|&error| f64::from(error).powi(2)).sum::<f64>()
        };
        let share = variance(&aiming) / variance(&by_chance);
        assert!(share < 1.0 / 6.0, "{name}: {share} of the variance");
    }
}

fn trace(tracer: &dyn Tracer, scene: &Scene, settings: RenderSettings) -> RadianceImage {
    let scene = CompiledScene::new(scene).unwrap();
    let film = trace_image(tracer, &scene, ImageSize::new(24, 16), settings).unwrap();
    assert_eq!(film.dropped_samples(), 0);
    film.image()
}

fn long_paths(samples: u32) -> RenderSettings {
    RenderSettings {
        samples,
        max_depth: 63,
        ..RenderSettings::default()
    }
}

/// Whatever its index, clear glass takes no light: each path ends in the environment, and leaves
/// out at most what total reflection keeps beyond the longest path.
#[test]
fn glass_ball_vanishes_in_uniform_light() {
    for ior in [1.0, 1.0 + 1e-6, 1.3, 1.5, 2.5] {
        for tracer in tracers() {
            let image = trace(
                tracer.as_ref(),
                &furnace(glass(ior, 0.0, None)),
                long_paths(16),
            );
            for pixel in image.pixels {
                let error = (Vec3::from(pixel) - Vec3::ONE).abs().max_element();
                assert!(
                    error < 2e-5,
                    "{} at index {ior}: {pixel:?}",
                    tracer.info().name
                );
            }
        }
    }
}

/// Single scattering on microfacets loses what would be reflected twice; it never gains.
#[test]
fn rough_ball_conserves_energy() {
    for alpha in [0.05, 0.3] {
        let mirror = Material::Conductor {
            eta: Vec3::splat(0.01),
            k: Vec3::splat(1000.0),
            alpha,
            number: 0,
        };
        for material in [glass(1.5, alpha, None), mirror] {
            for tracer in tracers() {
                let mean = mean(&trace(tracer.as_ref(), &furnace(material), long_paths(256)))[1];
                let what = format!("{} {material:?}: {mean}", tracer.info().name);
                assert!(mean < 1.0 + 2e-3, "{what}");
                assert!(mean > 1.0 - 0.6 * f64::from(alpha), "{what}");
            }
        }
    }
}

/// A medium that scatters and does not absorb, of one mean free path: depth 63 loses less than
/// 1e-3 of the light.
#[test]
fn a_medium_that_does_not_absorb_takes_no_light() {
    let medium = Some(Medium {
        extinction: Vec3::splat(1.0),
        albedo: Vec3::ONE,
    });
    for ior in [1.0, 1.3] {
        for tracer in tracers() {
            let scene = furnace(glass(ior, 0.0, medium));
            let mean = mean(&trace(tracer.as_ref(), &scene, long_paths(64)))[0];
            assert!((mean - 1.0).abs() < 2e-3, "{}: {mean}", tracer.info().name);
        }
    }
}

/// Seen through its middle, a ball of index 1 that only absorbs leaves e^(−σ · 2R).
#[test]
fn tinted_glass_keeps_beer_s_law() {
    let medium = Some(Medium {
        extinction: Vec3::new(0.1, 0.5, 2.0),
        albedo: Vec3::ZERO,
    });
    let mut scene = furnace(glass(1.0, 0.0, medium));
    scene.camera.fov_x_deg = 0.01;
    for tracer in tracers() {
        let mean = mean(&trace(tracer.as_ref(), &scene, long_paths(1)));
        for (mean, extinction) in mean.into_iter().zip([0.1f64, 0.5, 2.0]) {
            let expected = (-2.0 * extinction).exp();
            assert!(
                (mean / expected - 1.0).abs() < 1e-4,
                "{}: {mean}",
                tracer.info().name
            );
        }
    }
}

#[test]
fn a_polished_ball_of_gold_shows_its_reflectance() {
    let mut scene = furnace(gold(0.0));
    scene.camera.fov_x_deg = 0.01;
    let Material::Conductor { eta, k, .. } = gold(0.0) else {
        unreachable!("gold is a metal");
    };
    let expected = ((eta - 1.0) * (eta - 1.0) + k * k) / ((eta + 1.0) * (eta + 1.0) + k * k);
    for tracer in tracers() {
        let pixel = Vec3::from(trace(tracer.as_ref(), &scene, long_paths(1)).pixels[0]);
        assert!((pixel - expected).abs().max_element() < 1e-4, "{pixel}");
    }
}

/// A glass box bends and reflects but takes nothing either; its edges make long paths.
#[test]
fn glass_box_vanishes_in_uniform_light() {
    let scene = glass_box();
    for tracer in tracers() {
        let mean = mean(&trace(tracer.as_ref(), &scene, long_paths(64)))[2];
        // Total reflection keeps some paths in the box beyond the longest.
        assert!(
            mean < 1.0 + 1e-4 && mean > 0.97,
            "{}: {mean}",
            tracer.info().name
        );
    }
}

/// With the same random numbers the fast tracers follow the scalar tracer's paths until a rounding
/// turns one: lenses and long walks magnify it, so that more pixels differ than on a pool table.
#[test]
fn every_tracer_follows_scalar_paths() {
    let scene = Scene::load(repository("assets/scenes/materials.json")).unwrap();
    let scene = CompiledScene::new(&scene).unwrap();
    let settings = RenderSettings {
        samples: 1,
        max_depth: 16,
        ..RenderSettings::default()
    };
    let size = ImageSize::new(96, 54);
    let picture =
        |tracer: &dyn Tracer| trace_image(tracer, &scene, size, settings).unwrap().image();
    let expected = picture(&ScalarTracer);
    for tracer in tracers() {
        let pixels = picture(tracer.as_ref()).pixels;
        let pairs = pixels.iter().zip(&expected.pixels);
        let differs = |(a, b): &(&[f32; 3], &[f32; 3])| {
            let (a, b) = (Vec3::from(**a), Vec3::from(**b));
            !(a - b).abs().cmple(2e-3 * (0.1 + b)).all()
        };
        let share = pairs.filter(differs).count() as f64 / size.pixels() as f64;
        assert!(
            share < 0.03,
            "{}: {share} of the pixels differ",
            tracer.info().name
        );
    }
}

#[test]
fn csg_and_textures_agree_with_scalar_per_sample() {
    let scene = CompiledScene::new(&textured_still_life()).unwrap();
    let settings = RenderSettings::default();
    let size = ImageSize::new(160, 90);
    let picture =
        |tracer: &dyn Tracer| trace_image(tracer, &scene, size, settings).unwrap().image();
    let expected = picture(&ScalarTracer);
    for tracer in tracers() {
        let image = picture(tracer.as_ref());
        let pairs = image.pixels.iter().zip(&expected.pixels);
        let differs = |(a, b): &(&[f32; 3], &[f32; 3])| {
            let (a, b) = (Vec3::from(**a), Vec3::from(**b));
            !(a - b).abs().cmple(2e-3 * (0.1 + b)).all()
        };
        let share = pairs.filter(differs).count() as f64 / size.pixels() as f64;
        assert!(
            share < 0.01,
            "{}: {share} of the pixels differ",
            tracer.info().name
        );
        let ratio = mean(&image)[1] / mean(&expected)[1];
        assert!(
            (ratio - 1.0).abs() < 2e-3,
            "{}: {ratio}",
            tracer.info().name
        );
    }
}

/// White furnace of a concave body: light that is caught in a bore gets out again.
#[test]
fn white_csg_box_vanishes_in_uniform_light() {
    let scene = white_csg_block();
    for tracer in tracers() {
        let image = trace(tracer.as_ref(), &scene, long_paths(16));
        for pixel in image.pixels {
            assert!(
                (pixel[0] - 1.0).abs() < 1e-4,
                "{}: {pixel:?}",
                tracer.info().name
            );
        }
    }
}

#[test]
fn cloth_conserves_energy_and_is_brightest_at_grazing() {
    let cloth = Material::Cloth {
        albedo: Vec3::new(1.0, 0.5, 0.0),
        sheen: Vec3::splat(0.4),
        sheen_roughness: 0.3,
        marks: None,
    };
    let scene = furnace(cloth);
    for tracer in tracers() {
        let name = tracer.info().name;
        let whole = mean(&trace(tracer.as_ref(), &scene, long_paths(256)));
        assert!(whole[0] < 1.0 + 1e-3 && whole[0] > 0.6, "{name}: {whole:?}");
        assert!(
            whole[2] > 0.02,
            "{name}: the sheen of black cloth shows: {whole:?}"
        );
        let mut middle = scene.clone();
        middle.camera.fov_x_deg = 0.1;
        let middle = mean(&trace(tracer.as_ref(), &middle, long_paths(64)))[2];
        assert!(middle < 0.8 * whole[2], "{name}: {middle} {}", whole[2]);
    }
}

/// The `i`-th of random rays towards points of a box.
fn ray_into_box(min: Vec3, max: Vec3, i: u32) -> Ray {
    let [a, b, c, d] = uniforms(i, 1, 2, 3);
    let [e, f, ..] = uniforms(i, 1, 2, 4);
    let target = Vec3::new(c, d, e) * (max - min) + min;
    // Some come from above and below, nearly along the axis.
    let origin = if f < 0.3 {
        target + Vec3::new(0.05 * (a - 0.5), 0.05 * (b - 0.5), (f - 0.15).signum())
    } else {
        Vec3::new(2.0 * a - 1.0, -0.8, 2.0 * b - 1.0)
    };
    let direction = (target - origin).normalize();
    Ray {
        origin: origin.as_dvec3(),
        direction: direction.as_dvec3().normalize(),
    }
}

type Turn = fn(Vec3) -> Vec3;

/// Marches along rays in small steps until they are in what the subtractions leave.
#[test]
fn cones_are_hit_where_ray_marching_finds_them() {
    const STEP: f64 = 2e-4;
    let cone = (Vec3::new(0.1, 0.0, -0.1), 0.2, -0.4, Vec3::ZERO);
    let apex = (Vec3::new(-0.1, 0.1, 0.0), 0.15, 1.0, Vec3::ZERO);
    let beyond = Vec3::new(0.05, -0.05, 7.0);
    let edge = (Vec3::new(0.2, -0.1, 0.0), 0.1, 0.0, beyond);
    let open_edge = (Vec3::new(0.1, 0.05, 0.0), 0.1, 0.0, beyond);
    // How vectors with z along the axis lie in the world, and back.
    let axes: [(Axis, Turn, Turn); 3] = [
        (Axis::X, Vec3::zxy, Vec3::yzx),
        (Axis::Y, Vec3::yzx, Vec3::zxy),
        (Axis::Z, |v| v, |v| v),
    ];
    let all = axes
        .into_iter()
        .flat_map(|axis| [cone, apex, edge, open_edge].map(|cone| (axis, cone)));
    for ((axis, to_world, from_world), (center, radius, taper, beyond)) in all {
        let solid = CsgSolid::ConeExterior {
            axis,
            center: to_world(center),
            radius,
            taper,
            beyond: to_world(beyond),
        };
        let subtraction = subtraction(solid, None);
        let [min, max] = [Vec3::new(-0.3, -0.2, -0.5), Vec3::new(0.3, 0.2, 0.5)].map(to_world);
        let is_body = |p: Vec3| {
            let from_center = from_world(p) - center;
            let (from_axis, beyond) = (from_center.truncate(), beyond.truncate());
            let is_outside = from_axis.length() > radius + taper * from_center.z;
            let is_cut = is_outside && from_axis.dot(beyond) >= beyond.length_squared();
            p.cmpge(min).all() && p.cmple(max).all() && !is_cut
        };
        let subtractions = vec![subtraction];
        let mut scene = furnace(Material::Diffuse { albedo: Vec3::ONE });
        scene.objects = vec![object(
            "cone",
            "m",
            Shape::CsgBox {
                min,
                max,
                subtractions,
            },
        )];
        let scene = CompiledScene::new(&scene).unwrap();
        let (mut hits, mut wrong) = (0, 0);
        for i in 0..600 {
            let ray = ray_into_box(min, max, i);
            let walked = (1..10_000)
                .map(|step| f64::from(step) * STEP)
                .find(|t| is_body((ray.origin + *t * ray.direction).as_vec3()));
            let met = intersect(&scene, &ray).map(|hit| hit.t);
            hits += u32::from(met.is_some());
            let is_same = match (walked, met) {
                (Some(walked), Some(met)) => (walked - met).abs() < 2.0 * STEP,
                (None, None) => true,
                _ => false,
            };
            wrong += u32::from(!is_same);
        }
        assert!(hits > 200, "{hits}");
        // Corners that a step passes over.
        assert!(wrong <= 6, "{wrong} of {hits}");
    }
}

#[test]
fn truncated_cones_are_hit_where_marching_finds_them() {
    const STEP: f64 = 2e-4;
    let rotation = Quat::from_rotation_x(0.7) * Quat::from_rotation_y(-0.4);
    let (center, length, radii) = (Vec3::new(0.1, 0.2, -0.2), 0.4, [0.05, 0.15]);
    let is_body = |p: Vec3| {
        let local = rotation.inverse() * (p - center);
        let radius = radii[0] + (radii[1] - radii[0]) * local.z / length;
        (0.0..=length).contains(&local.z) && local.truncate().length() <= radius
    };
    let mut scene = furnace(Material::Diffuse { albedo: Vec3::ONE });
    let far = Shape::TruncatedCone {
        center: Vec3::splat(5.0),
        rotation: Quat::IDENTITY,
        length,
        radii,
    };
    scene.objects = vec![object("cone", "m", far)];
    let mut scene = CompiledScene::new(&scene).unwrap();
    let pose = ObjectPose {
        object: 0,
        position: center,
        rotation,
        visible: true,
    };
    let update = |pose| SceneUpdate {
        camera: None,
        poses: vec![pose],
        ..SceneUpdate::default()
    };
    scene.apply(&update(pose)).unwrap();
    let (mut hits, mut wrong) = (0, 0);
    for i in 0..600 {
        let ray = ray_into_box(Vec3::splat(-0.3), Vec3::splat(0.4), i);
        let walked = (1..10_000)
            .map(|step| f64::from(step) * STEP)
            .find(|t| is_body((ray.origin + *t * ray.direction).as_vec3()));
        let met = intersect(&scene, &ray);
        hits += u32::from(met.is_some());
        let is_same = match (walked, met) {
            (Some(walked), Some(met)) => (walked - met.t).abs() < 2.0 * STEP,
            (None, None) => true,
            _ => false,
        };
        wrong += u32::from(!is_same);
        assert!(
            met.is_none_or(|hit| hit.n.dot(ray.direction) < 1e-9),
            "{met:?}"
        );
    }
    assert!(hits > 100, "{hits}");
    assert!(wrong <= 6, "{wrong} of {hits}");
    let hidden = ObjectPose {
        visible: false,
        ..pose
    };
    scene.apply(&update(hidden)).unwrap();
    let is_met = |i| {
        intersect(
            &scene,
            &ray_into_box(Vec3::splat(-0.3), Vec3::splat(0.4), i),
        )
    };
    assert!((0..600).all(|i| is_met(i).is_none()));
}

#[test]
fn invalid_subtractions_are_refused_with_reasons() {
    let refusal = |solid: CsgSolid, material: Option<&str>| {
        let mut scene = furnace(Material::Diffuse { albedo: Vec3::ONE });
        scene.objects[0].shape = Shape::CsgBox {
            min: Vec3::NEG_ONE,
            max: Vec3::ONE,
            subtractions: vec![subtraction(solid, material)],
        };
        CompiledScene::new(&scene).unwrap_err().to_string()
    };
    let (center, point) = (Vec3::ZERO, Vec3::ZERO);
    for (form, material, sentence) in [
        (
            CsgSolid::Cylinder {
                center,
                radius: 0.0,
            },
            None,
            "subtraction 0: its radius is 0 m",
        ),
        (
            CsgSolid::Cylinder {
                center,
                radius: 1.0,
            },
            Some("n"),
            "its material `n` is not among",
        ),
        (
            CsgSolid::HalfSpace {
                point,
                normal: Vec3::ZERO,
            },
            None,
            "subtraction 0: its normal [0, 0, 0] must not be 0",
        ),
        (
            CsgSolid::ConeExterior {
                axis: Axis::Z,
                center,
                radius: 1.0,
                taper: 1.5,
                beyond: Vec3::ZERO,
            },
            None,
            "subtraction 0: its taper is 1.5: it must be from -1 to 1",
        ),
        (
            CsgSolid::Box {
                min: Vec3::ONE,
                max: Vec3::ONE,
            },
            None,
            "subtraction 0: its min [1, 1, 1] must be below its max",
        ),
    ] {
        let refusal = refusal(form, material);
        assert!(
            refusal.contains(sentence),
            "`{sentence}` is not in `{refusal}`"
        );
    }
}

#[test]
fn numbers_of_metals_and_glass_stand_on_discs_seen_from_outside() {
    for (mut material, is_glass) in [(gold(0.1), false), (glass(1.5, 0.0, None), true)] {
        if let Material::Conductor { number, .. } | Material::Dielectric { number, .. } =
            &mut material
        {
            *number = 7;
        }
        let scene = CompiledScene::new(&furnace(material)).unwrap();
        let scatter = |n: DVec3, wo: DVec3| {
            let ray = Ray {
                origin: 10.0 * n,
                direction: -n,
            };
            Scatter::new(&scene, &intersect(&scene, &ray).unwrap(), wo, 0.0)
        };
        for side in [DVec3::X, DVec3::NEG_X] {
            let Scatter::Layered(disc) = scatter(side, side) else {
                panic!("the disc is of {material:?}")
            };
            assert!(disc.ior == 1.5 && disc.albedo != DVec3::ZERO);
            let from_within = scatter(side, -side);
            assert_eq!(matches!(from_within, Scatter::Dielectric(_)), is_glass);
        }
        let aside = (DVec3::X + DVec3::Y).normalize();
        assert!(!matches!(scatter(aside, aside), Scatter::Layered(_)));
    }
}

fn assert_refused(material: Material, sentence: &str) {
    let why = CompiledScene::new(&furnace(material)).map(|_| ());
    let refusal = why.unwrap_err().to_string();
    assert!(
        refusal.contains(sentence),
        "`{sentence}` is not in `{refusal}`"
    );
}

#[test]
fn textures_that_cannot_be_drawn_are_refused_with_their_reason() {
    let coated = |texture| Material::Coated {
        ior: 1.5,
        alpha: 0.0,
        texture,
    };
    let scoreboard = |center, radius| {
        coated(ProceduralTexture::Scoreboard {
            face: Vec3::ONE,
            ink: Vec3::ZERO,
            center,
            radius,
        })
    };
    for (material, sentence) in [
        (
            coated(ProceduralTexture::Bricks {
                light: Vec3::ONE,
                dark: Vec3::ZERO,
                mortar: Vec3::splat(1.5),
            }),
            "the albedo of its mortar is [1.5, 1.5, 1.5]",
        ),
        (
            scoreboard([0.0, f32::NAN], 0.1),
            "the centre of its dials is NaN",
        ),
        (scoreboard([0.0, 1.0], 0.0), "the radius of its dials is 0"),
        (
            coated(ProceduralTexture::Print {
                sky: Vec3::ONE,
                hills: Vec3::ZERO,
                center: Vec3::ZERO,
                half_height: -1.0,
            }),
            "the half_height of its print is -1",
        ),
    ] {
        assert_refused(material, sentence);
    }
}

#[test]
fn what_cannot_be_drawn_is_refused_with_its_reason() {
    let medium = |extinction, albedo| {
        let albedo = Vec3::splat(albedo);
        glass(1.5, 0.0, Some(Medium { extinction, albedo }))
    };
    for (material, sentence) in [
        (glass(0.9, 0.0, None), "its ior is 0.9: it must be from 1"),
        (
            Material::Dielectric {
                ior: 1.5,
                alpha: 0.0,
                medium: None,
                number: 100,
            },
            "its number is 100: it must be from 0 to 99",
        ),
        (
            glass(1.5, 1.5, None),
            "its alpha is 1.5: it must be from 0 to 1",
        ),
        (gold(f32::NAN), "its alpha is NaN"),
        (
            medium(Vec3::new(-1.0, 0.0, 0.0), 0.0),
            "each channel must be from 0 to 1e6",
        ),
        (
            medium(Vec3::ONE, 1.1),
            "its medium's albedo is [1.1, 1.1, 1.1]",
        ),
        (
            medium(Vec3::new(0.0, 1.0, 1.0), 0.5),
            "none more than 8 times another",
        ),
    ] {
        assert_refused(material, sentence);
    }
    let mut scene = furnace(glass(1.5, 0.0, None));
    for shape in [
        Shape::Disc {
            center: Vec3::ZERO,
            normal: Vec3::Z,
            radius: 1.0,
        },
        Shape::CsgBox {
            min: Vec3::NEG_ONE,
            max: Vec3::ONE,
            subtractions: Vec::new(),
        },
    ] {
        scene.objects[0].shape = shape;
        let why = CompiledScene::new(&scene).unwrap_err().to_string();
        assert!(why.contains("a dielectric, which needs an inside"), "{why}");
    }
}
