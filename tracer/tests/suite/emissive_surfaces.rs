//! Laws of surfaces that emit.

use carom_tracer::compiled::Primitive;
use carom_tracer::film::{trace_estimate, trace_image};
use carom_tracer::{
    AreaLight, CompiledScene, ImageSize, Material, MaterialTextures, Mesh, ObjectPose, Opacity,
    RenderSettings, Scene, SceneUpdate, Shape, Tile, TileGrid, Tracer,
};
use glam::{Quat, Vec2, Vec3};
use std::f32::consts::PI;

use crate::environments::surrounded_still_life;
use crate::meshes::facetted_ball;
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
        let shape = Shape::Rectangle {
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

/// Glowing meshes, one of them with a picture, and surfaces of other shapes among area lights, or all kinds of lights.
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
        ..AreaLight::new(1.0, 1.0)
    };
    let screen = at(Vec3::new(-0.6, 0.5, 0.5), 0.3 * Vec3::X, 0.2 * Vec3::Z);
    scene = with(scene, shown, sheet(&screen, 2).into());
    let strip = at(Vec3::new(0.5, -0.9, 0.02), 0.2 * Vec3::X, 0.01 * Vec3::Y);
    scene = with(scene, glow(20.0), sheet(&strip, 5).into());
    // One lies on the floor, the next is half in it.
    scene = with(scene, glow(5.0), sphere(Vec3::new(-0.25, -0.5, 0.1), 0.1));
    scene = with(scene, glow(30.0), sphere(Vec3::new(0.9, 0.1, 0.0), 0.03));
    let disc = Shape::Disc {
        center: Vec3::new(0.1, 0.3, 0.9),
        normal: Vec3::new(0.2, -1.0, -0.5),
        radius: 0.2,
    };
    scene = with(scene, glow(4.0), disc);
    let rectangle = Shape::Rectangle {
        center: Vec3::new(0.7, 0.6, 0.3),
        half_u: Vec3::new(0.1, 0.1, 0.0),
        half_v: Vec3::new(0.0, 0.0, 0.25),
    };
    with(scene, glow(3.0), rectangle)
}

fn sphere(center: Vec3, radius: f32) -> Shape {
    Shape::Sphere {
        center,
        radius,
        rotation: Quat::IDENTITY,
    }
}

/// Regions and the whole picture, to 4 standard errors.
#[test]
fn back_ends_agree_on_emissive_surfaces_in_the_mean() {
    for has_others in [false, true] {
        let scene = CompiledScene::new(&glowing_still_life(has_others)).unwrap();
        assert_agreement_in_the_mean(&scene, SIZE, settings(32), 8);
    }
}

#[test]
fn surfaces_are_drawn_by_their_power() {
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
    let lights = CompiledScene::new(&scene).unwrap().emissive_surfaces;
    assert_eq!((lights.sixteenths, lights.surfaces.len()), (16, 4));
    let shares: Vec<f32> = lights
        .surfaces
        .iter()
        .map(|light| light.probability)
        .collect();
    // Areas 1 and 1/2, emission 1 and 6.
    for (share, expected) in shares.iter().zip([0.125, 0.125, 0.375, 0.375]) {
        assert!((share - expected).abs() < 1e-6, "{shares:?}");
    }
    for (u, index) in [(0.0, 0), (0.2, 1), (0.26, 2), (0.999, 3)] {
        assert_eq!(lights.sample_index(u), index);
    }
    // Beside an area light of as much power, which shines to one side: two thirds.
    scene.area_lights.push(light(2.0, true, 4.0));
    let lights = CompiledScene::new(&scene).unwrap().emissive_surfaces;
    assert_eq!(lights.sixteenths, 11);
    // A sphere comes before the triangles, and shines to one side.
    scene = with(scene, glow(8.0 / PI), sphere(2.0 * Vec3::Z, 0.5));
    let lights = CompiledScene::new(&scene).unwrap().emissive_surfaces;
    assert_eq!((lights.sixteenths, lights.surfaces.len()), (12, 5));
    assert_eq!(lights.surfaces[0].primitive(), Primitive::Sphere(0));
    assert!((lights.surfaces[0].probability - 0.5).abs() < 1e-6);
}

/// What a floor of albedo 0.5 reflects right below a surface that emits 10.
fn reflected_below(shape: Shape, tracer: &dyn Tracer) -> f32 {
    let mut scene = lit_floor(Vec3::ZERO, true);
    scene.area_lights.clear();
    scene = with(scene, glow(10.0), shape);
    mean(tracer, &scene, 64)
}

/// The irradiance below spheres, `πL·(r/d)²`, and below discs, `πL·r²/(r² + h²)` (Howell, "A Catalog of Radiation Heat Transfer
/// Configuration Factors", B-12 and B-44): of large, near and far ones.
#[test]
fn a_floor_below_a_sphere_or_disc_has_its_analytic_radiance() {
    for (radius, height) in [(0.5, 1.5), (1.0, 1.2), (0.01, 1.0), (0.2, 300.0)] {
        let disc = Shape::Disc {
            center: height * Vec3::Z,
            normal: -2.0 * Vec3::Z,
            radius,
        };
        let ball = sphere(height * Vec3::Z, radius);
        let (squared, distance) = (radius * radius, height * height);
        let expected = [
            (ball, squared / distance),
            (disc, squared / (squared + distance)),
        ];
        for tracer in tracers() {
            for (shape, factor) in &expected {
                let found = reflected_below(shape.clone(), tracer.as_ref()) / (0.5 * 10.0 * factor);
                let name = tracer.info().name;
                assert!((found - 1.0).abs() < 0.01, "{name} {shape:?}: {found}");
            }
        }
    }
}

/// A sphere aimed at as one solid angle has less noise than a mesh of as much area, and the same light.
#[test]
fn a_glowing_sphere_has_less_noise_than_a_mesh_of_it() {
    let lamp = light(3.5, true, 8.0);
    let mut dark = room(&lamp);
    dark.area_lights.clear();
    let center = Vec3::new(0.3, 0.2, 0.4);
    let by_sphere = with(dark.clone(), glow(8.0), sphere(center, 0.3));
    let by_mesh = with(
        dark,
        glow(8.0),
        facetted_ball(3).scaled(Vec3::splat(0.3)).at(center).into(),
    );
    for tracer in tracers() {
        let name = tracer.info().name;
        let [of_sphere, of_mesh] =
            [&by_sphere, &by_mesh].map(|scene| variance(tracer.as_ref(), scene));
        let noise = (of_sphere / of_mesh).sqrt();
        println!("{name}: {noise:.2} times the noise");
        assert!(noise < 0.9, "{name}: {noise}");
        let [of_sphere, of_mesh] =
            [&by_sphere, &by_mesh].map(|scene| mean(tracer.as_ref(), scene, 64));
        let off = (of_sphere / of_mesh - 1.0).abs();
        assert!(off < 0.02, "{name}: {of_sphere} {of_mesh}");
    }
}

/// Within a glowing sphere all is lit from everywhere, whatever else light sampling aims at there.
#[test]
fn surfaces_within_a_glowing_sphere_are_lit_evenly() {
    // Alone too: all of it is seen along its normal.
    let around = with(
        empty(0.0),
        glow(2.0),
        sphere(Vec3::new(0.0, -3.0, 0.0), 100.0),
    );
    for tracer in tracers() {
        assert!((mean(tracer.as_ref(), &around, 64) - 2.0).abs() < 0.001);
    }
    let scene = with(around, diffuse(0.5), sphere(Vec3::ZERO, 1.0));
    let scene = with(scene, glow(2.0), sphere(Vec3::new(0.5, -2.0, 2.0), 0.5));
    for tracer in tracers() {
        let mean = mean(tracer.as_ref(), &scene, 64);
        let name = tracer.info().name;
        assert!((mean - 1.0).abs() < 0.005, "{name}: {mean}");
    }
}

/// A sphere that an update has moved lights what it would light had it been there from the beginning.
#[test]
fn a_glowing_sphere_lights_from_where_it_is() {
    let floor = with(empty(0.0), diffuse(0.5), floor());
    let at = |x: f32| {
        with(
            floor.clone(),
            glow(8.0),
            sphere(Vec3::new(x, 0.0, 1.0), 0.2),
        )
    };
    let mut moved = CompiledScene::new(&at(-2.0)).unwrap();
    moved
        .apply(&SceneUpdate {
            poses: vec![ObjectPose {
                object: 1,
                position: Vec3::new(1.0, 0.0, 1.0),
                rotation: Quat::IDENTITY,
                visible: true,
            }],
            ..SceneUpdate::default()
        })
        .unwrap();
    let there = CompiledScene::new(&at(1.0)).unwrap();
    for tracer in tracers() {
        let [moved, there] = [&moved, &there].map(|scene| {
            trace_image(tracer.as_ref(), scene, SIZE, settings(4))
                .unwrap()
                .image()
        });
        assert_eq!(moved.pixels, there.pixels, "{}", tracer.info().name);
    }
}
