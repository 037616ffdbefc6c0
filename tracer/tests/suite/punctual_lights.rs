//! Laws of lights without extent.

use std::f32::consts::PI;

use carom_tracer::film::trace_image;
use carom_tracer::{
    CompiledScene, ImageSize, PunctualEmitter, PunctualLight, RenderSettings, Scene, Sphere, Tracer,
};
use glam::Vec3;

use crate::environments::surrounded_still_life;
use crate::scenes::{diffuse, empty, floor, light, with};
use crate::tracers::tracers;

const ALBEDO: f32 = 0.6;

/// A floor of which the picture shows one point.
fn floor_at(point: Vec3, lights: Vec<PunctualLight>) -> Scene {
    let mut scene = with(empty(0.0), diffuse(ALBEDO), floor());
    scene.camera.eye = point + Vec3::new(0.0, -0.2, 0.1);
    scene.camera.target = point;
    scene.camera.fov_x_deg = 0.1;
    scene.punctual_lights = lights;
    scene
}

fn seen(tracer: &dyn Tracer, scene: &Scene, samples: u32) -> Vec3 {
    let settings = RenderSettings {
        samples,
        ..RenderSettings::default()
    };
    let scene = CompiledScene::new(scene).unwrap();
    let film = trace_image(tracer, &scene, ImageSize::new(4, 4), settings).unwrap();
    assert_eq!(film.dropped_samples(), 0, "{}", tracer.info().name);
    let pixels = film.image().pixels;
    let sum: Vec3 = pixels.iter().map(|pixel| Vec3::from(*pixel)).sum();
    sum / pixels.len() as f32
}

fn spot(inner_deg: f32, outer_deg: f32) -> PunctualLight {
    PunctualLight::new(PunctualEmitter::Spot {
        center: Vec3::new(0.0, 0.0, 2.0),
        direction: Vec3::NEG_Z,
        intensity: Vec3::splat(8.0),
        inner_deg,
        outer_deg,
    })
}

/// Radiance of a matt floor: ϱ/π · I cos³θ / h² below a point, ϱ/π · E cos θ under a sun.
#[test]
fn floors_are_as_bright_as_closed_forms_say() {
    let point = PunctualLight::point([0.0, 0.0, 2.0], [8.0, 4.0, 2.0]);
    let sun = PunctualLight::distant([3.0, 0.0, -4.0], [5.0; 3]);
    for (place, light, expected) in [
        (Vec3::ZERO, point.clone(), Vec3::new(2.0, 1.0, 0.5)),
        (
            2.0 * Vec3::X,
            point,
            Vec3::new(2.0, 1.0, 0.5) * 0.5f32.powf(1.5),
        ),
        (Vec3::ZERO, sun.clone(), Vec3::splat(4.0)),
        (4.0 * Vec3::Y, sun, Vec3::splat(4.0)),
        (Vec3::ZERO, spot(30.0, 45.0), Vec3::splat(2.0)),
        // Half way between the cosines of both angles.
        (
            2.0 * Vec3::X,
            spot(0.0, 65.529_54),
            Vec3::splat(2.0 * 0.5f32.powf(1.5) * 0.25),
        ),
        (2.0 * Vec3::X, spot(10.0, 44.0), Vec3::ZERO),
    ] {
        let expected = ALBEDO / PI * expected;
        let scene = floor_at(place, vec![light.clone()]);
        for tracer in tracers() {
            let seen = seen(tracer.as_ref(), &scene, 4);
            let off = (seen - expected).abs().max_element();
            let name = tracer.info().name;
            assert!(
                off < 0.002 * (0.01 + expected.x),
                "{name}, {light:?}: {seen} {expected}"
            );
        }
    }
}

#[test]
fn lights_add_up_and_things_are_in_their_way() {
    let lights = vec![
        PunctualLight::point([0.0, 0.0, 2.0], [8.0; 3]),
        PunctualLight::distant([0.0, 0.0, -1.0], [1.0; 3]),
        PunctualLight::distant([0.0, 0.0, 1.0], [9.0; 3]),
    ];
    let mut area = floor_at(Vec3::ZERO, Vec::new());
    area.area_lights.push(light(3.0, true, 2.0));
    // Aside, where it is in the way of none.
    area.area_lights[0].center.x = 2.0;
    let mut both = area.clone();
    both.punctual_lights.clone_from(&lights);
    let punctual = floor_at(Vec3::ZERO, lights);
    let shaded = with(
        punctual.clone(),
        diffuse(0.0),
        Sphere::new(0.3).at([0.0, 0.0, 1.0]).into(),
    );
    for tracer in tracers() {
        let tracer = tracer.as_ref();
        let name = tracer.info().name;
        let [of_area, of_points, of_both] =
            [&area, &punctual, &both].map(|scene| seen(tracer, scene, 512).x);
        assert!(
            (of_points - ALBEDO / PI * 3.0).abs() < 0.01,
            "{name}: {of_points}"
        );
        let off = (of_both / (of_area + of_points) - 1.0).abs();
        assert!(off < 0.02, "{name}: {of_both}, not {of_area} + {of_points}");
        assert_eq!(seen(tracer, &shaded, 16), Vec3::ZERO, "{name}");
    }
}

/// A point, a spot and a sun beside an environment map and area lights, or beside neither.
pub(crate) fn punctual_still_life(has_others: bool) -> Scene {
    let mut scene = surrounded_still_life(has_others);
    if !has_others {
        scene.environment_map = None;
        scene.environment.radiance = Vec3::ZERO;
    }
    scene.punctual_lights = vec![
        PunctualLight::point([1.0, -1.0, 1.5], [2.0, 1.8, 1.5]),
        PunctualLight::new(PunctualEmitter::Spot {
            center: Vec3::new(-1.5, -1.0, 2.0),
            direction: Vec3::new(1.5, 1.0, -1.8),
            intensity: Vec3::new(3.0, 4.0, 6.0),
            inner_deg: 8.0,
            outer_deg: 25.0,
        }),
        PunctualLight::distant([-0.3, 1.0, -2.0], [0.4, 0.35, 0.3]),
    ];
    scene
}

#[test]
fn what_no_light_can_be_made_of_is_refused() {
    let refusal = |light: PunctualLight| {
        let scene = floor_at(Vec3::ZERO, vec![light.named("lamp")]);
        scene.validate().unwrap_err().to_string()
    };
    for (light, sentence) in [
        (
            PunctualLight::point([f32::NAN, 0.0, 0.0], [1.0; 3]),
            "punctual light 0 `lamp`: its center is [NaN, 0, 0]",
        ),
        (
            PunctualLight::point([0.0; 3], [-1.0, 0.0, 0.0]),
            "the punctual light's radiance is [-1, 0, 0]",
        ),
        (PunctualLight::distant([0.0; 3], [1.0; 3]), "must not be 0"),
        (
            spot(30.0, 20.0),
            "its inner_deg is 30: it must be from 0 to 20",
        ),
        (
            spot(0.0, 91.0),
            "its outer_deg is 91: it must be from 0 to 90",
        ),
    ] {
        let refusal = refusal(light);
        assert!(
            refusal.contains(sentence),
            "`{sentence}` is not in `{refusal}`"
        );
    }
}
