//! Laws of environment maps.

use std::f64::consts::{FRAC_PI_2, PI};

use carom_tracer::environment_file::encode_exr;
use carom_tracer::film::trace_image;
use carom_tracer::{
    CompiledScene, EnvironmentMap, ImageSize, Material, RadianceImage, RenderSettings, Scene,
    Tracer,
};
use glam::Vec3;

use crate::scenes::{ball, diffuse, empty, floor, glass, gold, plastic, still_life, with};
use crate::textures::image_textured_still_life;
use crate::tracers::tracers;

const SIZE: ImageSize = ImageSize::new(12, 8);

/// A map whose pixels are given by column and row.
fn map(size: [u32; 2], pixel: impl Fn(u32, u32) -> [f32; 3]) -> EnvironmentMap {
    let mut picture = RadianceImage::black(ImageSize::new(size[0], size[1]));
    for (place, radiance) in (0..).zip(&mut picture.pixels) {
        *radiance = pixel(place % size[0], place / size[0]);
    }
    EnvironmentMap::new(encode_exr(&picture).unwrap())
}

/// Matt, coated, metal, glass and textured things below a window, a sun and a dim sky; with two area lights or without.
pub(crate) fn surrounded_still_life(has_area_lights: bool) -> Scene {
    let mut scene = still_life();
    let textured = image_textured_still_life();
    let at = |x: f32, y: f32| carom_tracer::Sphere::new(0.2).at([x, y, 0.2]).into();
    scene = with(scene, gold(0.2), at(-0.4, -0.5));
    scene = with(scene, glass(1.5, 0.3, None), at(0.2, 0.7));
    scene = with(scene, Material::rough([0.8, 0.4, 0.2], 0.4), at(1.0, 0.4));
    let bumpy = textured.objects[2].clone();
    let mut material = textured.materials[&bumpy.material];
    if let Material::MetallicRoughness { textures, .. } = &mut material {
        textures.normal = Some(0);
    }
    scene.textures = vec![textured.textures[2].clone()];
    scene = with(scene, material, bumpy.shape);
    scene.environment.radiance = Vec3::new(1.0, 0.9, 0.8);
    let sky = map([16, 8], |x, y| match (x, y) {
        (5, 2) => [60.0, 50.0, 30.0],
        (9..12, 2..4) => [2.0, 3.0, 5.0],
        (_, 0..4) => [0.2, 0.3, 0.5],
        _ => [0.02; 3],
    });
    scene.environment_map = Some(sky.turned_deg(70.0));
    if !has_area_lights {
        scene.area_lights.clear();
    }
    scene
}

fn picture(tracer: &dyn Tracer, scene: &Scene, samples: u32) -> Vec<[f32; 3]> {
    let settings = RenderSettings {
        samples,
        max_depth: 63,
        ..RenderSettings::default()
    };
    let scene = CompiledScene::new(scene).unwrap();
    let film = trace_image(tracer, &scene, SIZE, settings).unwrap();
    assert_eq!(film.dropped_samples(), 0, "{}", tracer.info().name);
    film.image().pixels
}

fn mean(pixels: &[[f32; 3]]) -> Vec3 {
    let sum: Vec3 = pixels.iter().map(|pixel| Vec3::from(*pixel)).sum();
    sum / pixels.len() as f32
}

#[test]
fn a_map_of_one_colour_is_a_constant_environment() {
    let even = map([6, 3], |_, _| [0.5, 1.0, 2.0]);
    for material in [
        diffuse(1.0),
        plastic(1.0, 1.5),
        gold(0.3),
        glass(1.5, 0.2, None),
    ] {
        let mut constant = with(empty(1.0), material, ball());
        constant.environment.radiance = Vec3::new(0.5, 1.0, 2.0);
        let mut mapped = constant.clone();
        mapped.environment.radiance = Vec3::ONE;
        mapped.environment_map = Some(even.clone());
        for tracer in tracers() {
            let [constant, mapped] =
                [&constant, &mapped].map(|scene| mean(&picture(tracer.as_ref(), scene, 256)));
            let off = ((mapped - constant) / constant).abs().max_element();
            let name = tracer.info().name;
            assert!(off < 0.02, "{name}, {material:?}: {mapped} {constant}");
        }
    }
}

/// Radiance `cos θ` above a floor of albedo ϱ: irradiance 2π/3, radiance 2ϱ/3.
#[test]
fn a_cosine_sky_lights_a_floor_by_two_thirds() {
    let rows = 256;
    let sky = map([4, rows], |_, y| {
        let colatitude = PI * (f64::from(y) + 0.5) / f64::from(rows);
        [colatitude.cos().max(0.0) as f32; 3]
    });
    let mut scene = with(empty(1.0), diffuse(0.6), floor());
    scene.environment_map = Some(sky);
    scene.camera.eye = Vec3::new(0.0, -1.0, 1.0);
    for tracer in tracers() {
        let lit = mean(&picture(tracer.as_ref(), &scene, 512)).x;
        assert!((lit - 0.4).abs() < 0.003, "{}: {lit}", tracer.info().name);
    }
}

/// A sun of a few pixels, from each quarter of the sky: at few samples light comes from where the map says, and as much
/// as a sum over its pixels says.
#[test]
fn a_small_sun_lights_each_side_of_a_ball_without_noise() {
    let [width, height] = [64, 32];
    for (turn_deg, side) in [
        (0.0, Vec3::Y),
        (90.0, Vec3::NEG_X),
        (180.0, Vec3::NEG_Y),
        (-90.0, Vec3::X),
    ] {
        let sun = map([width, height], |x, y| {
            let is_sun = (31..33).contains(&x) && (15..17).contains(&y);
            [if is_sun { 1000.0 } else { 0.0 }; 3]
        });
        let mut scene = with(empty(1.0), diffuse(0.5), ball());
        scene.environment_map = Some(sun.turned_deg(turn_deg));
        scene.camera.eye = 4.0 * side;
        scene.camera.fov_x_deg = 2.0;
        // Interpolated, its light is as wide as its pixels: each is π²/(32·32)·... of a square of the picture.
        let pixel_sr = 2.0 * PI / f64::from(width) * PI / f64::from(height);
        let expected = 0.5 / PI * 1000.0 * 4.0 * pixel_sr;
        for tracer in tracers() {
            let lit = f64::from(mean(&picture(tracer.as_ref(), &scene, 16)).x);
            let name = tracer.info().name;
            let off = (lit / expected - 1.0).abs();
            assert!(
                off < 0.02,
                "{name}, {turn_deg}: {lit} instead of {expected}"
            );
            let mut behind = scene.clone();
            behind.camera.eye = -4.0 * side;
            let dark = mean(&picture(tracer.as_ref(), &behind, 16)).x;
            assert!(dark == 0.0, "{name}, {turn_deg}: {dark} on the far side");
        }
    }
}

/// The middle of the picture is seen along +y, its right half to the right, its upper edge above.
#[test]
fn a_map_is_seen_from_inside() {
    let shown = map([8, 4], |x, y| [x as f32, y as f32, 1.0]);
    let mut scene = empty(1.0);
    scene.camera.fov_x_deg = 0.5;
    let seen = |tracer: &dyn Tracer, turn_deg: f32, target: Vec3| {
        let mut scene = scene.clone();
        scene.environment_map = Some(shown.clone().turned_deg(turn_deg));
        scene.camera.eye = Vec3::ZERO;
        scene.camera.target = target;
        mean(&picture(tracer, &scene, 16))
    };
    let eighth = (FRAC_PI_2 / 2.0) as f32;
    let aside = |azimuth: f32| Vec3::new(azimuth.sin(), azimuth.cos(), 0.0);
    for tracer in tracers() {
        let tracer = tracer.as_ref();
        let name = tracer.info().name;
        let close = |seen: Vec3, x: f32, y: f32| {
            let off = (seen - Vec3::new(x, y, 1.0)).abs().max_element();
            assert!(off < 0.02, "{name}: {seen}, not {x} {y}");
        };
        close(seen(tracer, 0.0, Vec3::Y), 3.5, 1.5);
        close(seen(tracer, 0.0, aside(eighth)), 4.5, 1.5);
        close(seen(tracer, 0.0, aside(-eighth)), 2.5, 1.5);
        close(seen(tracer, 0.0, Vec3::new(0.0, 1.0, 1.0)), 3.5, 0.5);
        close(seen(tracer, 45.0, Vec3::Y), 4.5, 1.5);
    }
}

#[test]
fn what_no_map_can_be_made_of_is_refused() {
    let mut scene = empty(1.0);
    let refusal = |scene: &Scene| CompiledScene::new(scene).unwrap_err().to_string();
    scene.environment_map = Some(EnvironmentMap::new(b"\x89PNG".to_vec()));
    let sentence =
        "the environment map: it begins with the bytes [89, 50, 4e, 47]: it must be an OpenEXR";
    assert!(refusal(&scene).contains(sentence), "{}", refusal(&scene));
    let one = map([1, 1], |_, _| [1.0; 3]);
    scene.environment_map = Some(one.clone().turned_deg(f32::NAN));
    let sentence = "the environment map's turn_deg is NaN: it must be from -360 to 360";
    assert!(refusal(&scene).contains(sentence), "{}", refusal(&scene));
    scene.environment_map = Some(map([2, 1], |x, _| [f32::INFINITY * x as f32; 3]));
    assert!(
        refusal(&scene).contains("its pixel (0, 0) is [NaN"),
        "{}",
        refusal(&scene)
    );
    scene.environment_map = Some(one);
    CompiledScene::new(&scene).unwrap();
}
