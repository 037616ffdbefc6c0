//! Laws of triangles that emit.

use carom_tracer::film::{trace_estimate, trace_image};
use carom_tracer::{
    AreaLight, CompiledScene, ImageSize, Material, MaterialTextures, Mesh, Opacity, RenderSettings,
    Scene, Tile, TileGrid, Tracer,
};
use glam::{Quat, Vec2, Vec3};

use crate::environments::surrounded_still_life;
use crate::scenes::{diffuse, empty, floor, light, lit_floor, still_life, with};
use crate::textures::{lamp, texture};
use crate::tracers::{assert_agreement_in_the_mean, tracers};

const SIZE: ImageSize = ImageSize::new(24, 16);

/// What emits so much and reflects nothing.
fn glow(radiance: f32) -> Material {
    let mut material = lamp(MaterialTextures::NONE);
    if let Material::MetallicRoughness { emission, .. } = &mut material {
        *emission = Vec3::splat(radiance);
    }
    material
}

/// The rectangle of an area light, of 2·`edge`² triangles, with texture coordinates over all of it.
fn sheet(of: &AreaLight, edge: u32) -> Mesh {
    let place = |i: u32| 2.0 * i as f32 / edge as f32 - 1.0;
    let places = (0..=edge).flat_map(|v| (0..=edge).map(move |u| Vec2::new(place(u), place(v))));
    let places: Vec<Vec2> = places.collect();
    let positions = places.iter().map(|at| at.x * of.half_u + at.y * of.half_v);
    let row = edge + 1;
    let corners = (0..edge).flat_map(|v| (0..edge).map(move |u| v * row + u));
    let triangles = corners
        .flat_map(|at| [[at, at + 1, at + row + 1], [at, at + row + 1, at + row]])
        .collect();
    let mesh = Mesh::new(positions.collect(), triangles).at(of.center);
    mesh.uvs(places.iter().map(|at| 0.5 + 0.5 * *at).collect())
}

/// The same scene lit by glowing sheets instead of its area lights.
fn by_meshes(mut scene: Scene, edge: u32) -> Scene {
    for light in std::mem::take(&mut scene.area_lights) {
        let mesh = sheet(&light, edge);
        scene = with(scene, glow(light.radiance.x), mesh.into());
    }
    scene
}

fn settings(samples: u32) -> RenderSettings {
    RenderSettings {
        samples,
        max_depth: 6,
        ..RenderSettings::default()
    }
}

fn mean(tracer: &dyn Tracer, scene: &Scene, samples: u32) -> f32 {
    let scene = CompiledScene::new(scene).unwrap();
    let film = trace_image(tracer, &scene, SIZE, settings(samples)).unwrap();
    assert_eq!(film.dropped_samples(), 0, "{}", tracer.info().name);
    let pixels = film.image().pixels;
    let pixels = pixels.as_flattened();
    pixels.iter().sum::<f32>() / pixels.len() as f32
}

/// A floor is as bright under a glowing sheet as under an area light in its place, of few triangles and of many; at one
/// scattering, which then is the last.
#[test]
fn sheets_light_as_area_lights_do() {
    let point = Vec3::new(0.4, 0.3, 0.0);
    let lit = lit_floor(point, true);
    for max_depth in [1, 6] {
        for tracer in tracers() {
            let mean = |scene: &Scene| {
                let settings = RenderSettings {
                    max_depth,
                    ..settings(16)
                };
                let scene = CompiledScene::new(scene).unwrap();
                let film = trace_image(tracer.as_ref(), &scene, SIZE, settings).unwrap();
                let pixels = film.image().pixels;
                let pixels = pixels.as_flattened();
                pixels.iter().sum::<f32>() / pixels.len() as f32
            };
            let expected = mean(&lit);
            for edge in [1, 12] {
                let found = mean(&by_meshes(lit.clone(), edge));
                let off = (found / expected - 1.0).abs();
                let name = tracer.info().name;
                assert!(off < 0.01, "{name} {max_depth} {edge}: {found} {expected}");
            }
        }
    }
}

/// A box without windows, lit by a lamp near its roof.
fn room(lamp: &AreaLight) -> Scene {
    let mut scene = empty(0.0);
    let wall = |scene: Scene, center: Vec3, rotation: Quat| {
        let [half_u, half_v] = [Vec3::X, Vec3::Y].map(|axis| 2.0 * (rotation * axis));
        let shape = carom_tracer::Shape::Rectangle {
            center,
            half_u,
            half_v,
        };
        with(scene, diffuse(0.6), shape)
    };
    let quarter = std::f32::consts::FRAC_PI_2;
    for (center, rotation) in [
        (Vec3::ZERO, Quat::IDENTITY),
        (4.0 * Vec3::Z, Quat::IDENTITY),
        (Vec3::new(2.0, 0.0, 2.0), Quat::from_rotation_y(quarter)),
        (Vec3::new(-2.0, 0.0, 2.0), Quat::from_rotation_y(quarter)),
        (Vec3::new(0.0, 2.0, 2.0), Quat::from_rotation_x(quarter)),
        (Vec3::new(0.0, -2.0, 2.0), Quat::from_rotation_x(quarter)),
    ] {
        scene = wall(scene, center, rotation);
    }
    scene.area_lights.push(lamp.clone());
    scene.camera.eye = Vec3::new(0.0, -1.9, 1.2);
    scene.camera.target = Vec3::new(0.0, 2.0, 1.0);
    scene.camera.fov_x_deg = 70.0;
    scene
}

/// Mean variance of a pixel's 8 batches.
fn variance(tracer: &dyn Tracer, scene: &Scene) -> f64 {
    let scene = CompiledScene::new(scene).unwrap();
    let grid = TileGrid::new(SIZE, 8);
    let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
    let estimate = trace_estimate(tracer, &scene, SIZE, settings(16), &tiles, 8).unwrap();
    let squares = estimate.stderr.pixels.as_flattened().iter();
    squares.map(|error| f64::from(*error).powi(2)).sum::<f64>() / (3 * SIZE.pixels()) as f64
}

/// A room lit by a sheet of 128 triangles just below its roof has at most 1.5 times the noise of one lit by an area light there, and
/// the same light.
#[test]
fn a_glowing_mesh_has_about_the_noise_of_an_area_light() {
    let mut lamp = light(3.999, true, 8.0);
    (lamp.half_u, lamp.half_v) = (0.5 * Vec3::X, -0.5 * Vec3::Y);
    let by_light = room(&lamp);
    let by_mesh = by_meshes(by_light.clone(), 8);
    for tracer in tracers() {
        let name = tracer.info().name;
        let [of_light, of_mesh] =
            [&by_light, &by_mesh].map(|scene| variance(tracer.as_ref(), scene));
        let noise = (of_mesh / of_light).sqrt();
        println!("{name}: {noise:.2} times the noise");
        assert!(noise < 1.5, "{name}: {noise}");
        let [of_light, of_mesh] =
            [&by_light, &by_mesh].map(|scene| mean(tracer.as_ref(), scene, 64));
        let off = (of_mesh / of_light - 1.0).abs();
        assert!(off < 0.02, "{name}: {of_mesh} {of_light}");
    }
}

/// Half there, a lamp gives half the light.
#[test]
fn a_half_transparent_lamp_gives_half_its_light() {
    let lit = lit_floor(Vec3::new(0.4, 0.3, 0.0), true);
    let whole = by_meshes(lit, 3);
    let mut half = whole.clone();
    for material in half.materials.values_mut() {
        *material = material.with_opacity(Opacity::Blend { alpha: 0.5 });
    }
    for tracer in tracers() {
        let [whole, half] = [&whole, &half].map(|scene| mean(tracer.as_ref(), scene, 32));
        let name = tracer.info().name;
        assert!((half / whole - 0.5).abs() < 0.01, "{name}: {half} {whole}");
    }
}

/// Glowing meshes, one of them with a picture, among area lights or points, or all kinds of lights.
pub(crate) fn glowing_still_life(has_others: bool) -> Scene {
    let mut scene = match has_others {
        true => surrounded_still_life(true),
        false => still_life(),
    };
    let picture = texture(4, |x, y| [60 * x as u8, 200, 50 + 50 * y as u8]);
    let emission = Some(scene.add_texture(picture));
    let mut shown = lamp(MaterialTextures {
        emission,
        ..MaterialTextures::NONE
    });
    if let Material::MetallicRoughness { emission, .. } = &mut shown {
        *emission = Vec3::new(6.0, 3.0, 8.0);
    }
    let at = |center: Vec3, half_u: Vec3, half_v: Vec3| AreaLight {
        name: String::new(),
        center,
        half_u,
        half_v,
        radiance: Vec3::ONE,
    };
    let screen = at(Vec3::new(-0.6, 0.5, 0.5), 0.3 * Vec3::X, 0.2 * Vec3::Z);
    scene = with(scene, shown, sheet(&screen, 2).into());
    let strip = at(Vec3::new(0.5, -0.9, 0.02), 0.2 * Vec3::X, 0.01 * Vec3::Y);
    with(scene, glow(20.0), sheet(&strip, 5).into())
}

/// Regions and the whole picture, to 4 standard errors.
#[test]
fn back_ends_agree_on_mesh_lights_in_the_mean() {
    for has_others in [false, true] {
        let scene = CompiledScene::new(&glowing_still_life(has_others)).unwrap();
        assert_agreement_in_the_mean(&scene, SIZE, settings(32), 8);
    }
}

#[test]
fn triangles_are_drawn_by_their_power() {
    let floor = with(empty(0.0), diffuse(0.5), floor());
    let large = AreaLight {
        center: 3.0 * Vec3::Z,
        ..light(1.0, true, 1.0)
    };
    let mut scene = with(floor, glow(1.0), sheet(&large, 1).into());
    let small = AreaLight {
        half_u: 0.5 * large.half_u,
        center: 4.0 * Vec3::Z,
        ..large
    };
    scene = with(scene, glow(6.0), sheet(&small, 1).into());
    let lights = CompiledScene::new(&scene).unwrap().mesh_lights;
    assert_eq!((lights.sixteenths, lights.triangles.len()), (16, 4));
    let shares: Vec<f32> = lights
        .triangles
        .iter()
        .map(|light| light.probability)
        .collect();
    // Areas 1 and 1/2, emission 1 and 6.
    for (share, expected) in shares.iter().zip([0.125, 0.125, 0.375, 0.375]) {
        assert!((share - expected).abs() < 1e-6, "{shares:?}");
    }
    for (u, triangle) in [(0.0, 0), (0.2, 1), (0.26, 2), (0.999, 3)] {
        assert_eq!(lights.sample([u, 0.5]).triangle, triangle);
    }
    // Beside an area light of as much power, which shines to one side: two thirds.
    scene.area_lights.push(light(2.0, true, 4.0));
    let lights = CompiledScene::new(&scene).unwrap().mesh_lights;
    assert_eq!(lights.sixteenths, 11);
}
