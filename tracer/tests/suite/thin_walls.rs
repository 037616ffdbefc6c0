//! Laws of thin walls: surfaces without an inside that let light pass.

use carom_tracer::{
    AreaLight, Layers, Material, MaterialTextures, Mesh, ObjectPose, ParticleCloud, ParticleForm,
    PunctualEmitter, PunctualLight, Scene, SceneUpdate, Shape,
};
use glam::{U16Vec3, Vec3};

use crate::environments::surrounded_still_life;
use crate::scenes::{ball, diffuse, empty, glass, light, with};
use crate::textures::{on_screen, picture, screen, texture};
use crate::tracers::tracers;

fn wall(base: impl Into<Vec3>, roughness: f32, transmission: f32) -> Material {
    Material::rough(base, roughness).layered(Layers {
        transmission,
        ..Layers::NONE
    })
}

/// A lamp behind the origin that shines along −y.
fn lamp_behind(radiance: f32) -> AreaLight {
    AreaLight {
        name: "lamp".to_owned(),
        center: Vec3::new(0.0, 1.0, 0.0),
        half_u: Vec3::new(0.5, 0.0, 0.0),
        half_v: Vec3::new(0.0, 0.0, 0.4),
        radiance: Vec3::splat(radiance),
        ..AreaLight::new(1.0, 1.0)
    }
}

/// A smooth pane, a frosted one of a texture with bumps, and a coated disc before an area light; a lamp shade round another,
/// and a ball of glass.
pub(crate) fn thin_wall_still_life() -> Scene {
    let pane = |x: f32, mesh: Mesh| -> Shape {
        let pane = mesh.scaled(Vec3::new(0.2, 1.0, 0.3));
        pane.at([x, 0.0, 0.3]).into()
    };
    let mut scene = empty(0.05);
    scene = with(scene, diffuse(0.6), crate::scenes::floor());
    let tinted = wall([0.9, 0.6, 0.3], 0.0, 0.9);
    scene = with(scene, tinted, pane(-0.45, screen()));
    let frosted = wall([0.5, 0.8, 0.9], 0.6, 1.0).textured(MaterialTextures {
        transmission: Some(0),
        metallic_roughness: Some(1),
        normal: Some(2),
        ..MaterialTextures::NONE
    });
    scene = with(scene, frosted, pane(0.0, screen()));
    let coated = Material::rough([0.9, 0.9, 0.7], 0.4).layered(Layers {
        transmission: 0.7,
        clearcoat: 0.8,
        clearcoat_roughness: 0.3,
        sheen: Vec3::splat(0.3),
        sheen_roughness: 0.6,
        ..Layers::NONE
    });
    let disc = Shape::Disc {
        center: Vec3::new(0.45, 0.0, 0.3),
        normal: Vec3::new(0.1, -1.0, 0.2).normalize(),
        radius: 0.2,
    };
    scene = with(scene, coated, disc);
    let shade = crate::meshes::smooth_ball(2).scaled(Vec3::splat(0.25));
    scene = with(
        scene,
        wall([0.9, 0.8, 0.6], 0.8, 0.6),
        shade.at([0.2, 0.6, 0.3]).into(),
    );
    let solid = Shape::Sphere {
        center: Vec3::new(-0.3, -0.5, 0.12),
        radius: 0.12,
        rotation: glam::Quat::IDENTITY,
    };
    scene = with(scene, glass(1.5, 0.0, None), solid);
    let share = texture(3, |x, y| [255 - 60 * x as u8, 80 * y as u8, 9]).linear();
    let wear = texture(3, |x, y| [0, 110 + 70 * x as u8, 40 * y as u8]).linear();
    let bumps = texture(4, |x, y| [98 + 20 * x as u8, 158 - 20 * y as u8, 240]).linear();
    scene.textures = vec![share, wear, bumps];
    let mut behind = lamp_behind(6.0);
    behind.center.z = 0.4;
    let mut within = light(0.35, true, 30.0);
    within.center = Vec3::new(0.2, 0.6, 0.35);
    within.half_u *= 0.05;
    within.half_v *= 0.1;
    scene.area_lights = vec![light(2.0, true, 5.0), behind, within];
    scene.camera.eye = Vec3::new(0.1, -3.0, 0.8);
    scene.camera.target = Vec3::new(0.0, 0.0, 0.3);
    scene.camera.fov_x_deg = 28.0;
    scene
}

/// The same among a sky, a lamp without extent and a panel that glows, which are seen through rough walls too.
pub(crate) fn thin_walls_among_lamps() -> Scene {
    let mut scene = thin_wall_still_life();
    scene.environment_map = surrounded_still_life(false).environment_map;
    scene.environment.radiance = Vec3::splat(0.5);
    scene
        .punctual_lights
        .push(PunctualLight::new(PunctualEmitter::Point {
            center: Vec3::new(-0.2, 0.8, 0.6),
            intensity: Vec3::splat(0.5),
        }));
    let mut glowing = Material::rough([0.3; 3], 0.7);
    if let Material::MetallicRoughness { emission, .. } = &mut glowing {
        *emission = Vec3::new(1.5, 1.0, 2.0);
    }
    let panel = screen().scaled(Vec3::splat(0.4)).at([-0.4, 0.9, 0.5]);
    with(scene, glowing, panel.into())
}

fn mean(pixels: &[[f32; 3]]) -> Vec3 {
    let sum: Vec3 = pixels.iter().copied().map(Vec3::from).sum();
    sum / pixels.len() as f32
}

/// White furnace: a white wall takes no light if it is smooth, and makes none.
#[test]
fn white_walls_vanish_in_uniform_light() {
    for (roughness, least) in [(0.0, 0.99), (0.3, 0.95), (1.0, 0.3)] {
        for transmission in [0.0, 0.5, 1.0] {
            let mut scene = on_screen(
                wall([1.0; 3], roughness, transmission),
                Vec::new(),
                screen(),
            );
            scene.environment.radiance = Vec3::ONE;
            for tracer in tracers() {
                let mean = mean(&picture(tracer.as_ref(), &scene, 256)).y;
                let what = format!("{}: {roughness} {transmission}", tracer.info().name);
                assert!(mean < 1.003 && mean > least, "{what}: {mean}");
            }
        }
    }
}

/// What lets all pass is not there, from whichever side.
#[test]
fn a_wall_that_reflects_nothing_shows_what_lies_behind() {
    let clear = Material::rough([1.0; 3], 0.0).layered(Layers {
        transmission: 1.0,
        specular: 0.0,
        ..Layers::NONE
    });
    let scene = |material| {
        let mut scene = on_screen(material, Vec::new(), screen());
        scene.area_lights.push(lamp_behind(3.0));
        scene.environment.radiance = Vec3::new(0.1, 0.2, 0.3);
        scene
    };
    let walled = scene(clear);
    let mut free = walled.clone();
    free.objects.clear();
    let mut turned = walled.clone();
    let Shape::Mesh(mesh) = &mut turned.objects[0].shape else {
        panic!("it is a mesh");
    };
    for triangle in &mut mesh.triangles {
        triangle.swap(0, 1);
    }
    for tracer in tracers() {
        let expected = picture(tracer.as_ref(), &free, 4);
        for walled in [&walled, &turned] {
            let seen = picture(tracer.as_ref(), walled, 4);
            let pairs = expected.as_flattened().iter().zip(seen.as_flattened());
            let off = pairs
                .map(|(a, b)| (a - b).abs())
                .filter(|off| *off > 1e-4)
                .count();
            // A ray past the edge of the lamp, by rounding.
            assert!(off <= 3, "{}: {off}", tracer.info().name);
        }
    }
}

/// Light behind a smooth wall is counted once: straight ahead `(1 − F) · base · transmission` of it is seen.
#[test]
fn a_smooth_wall_dims_a_lamp_by_its_base_and_its_reflection() {
    let base = Vec3::new(0.9, 0.5, 0.2);
    let mut scene = on_screen(wall(base, 0.0, 0.8), Vec::new(), screen());
    scene.area_lights.push(lamp_behind(4.0));
    scene.camera.fov_x_deg = 1.0;
    let expected = 4.0 * 0.96 * 0.8 * base;
    for tracer in tracers() {
        let mean = mean(&picture(tracer.as_ref(), &scene, 1024));
        let off = ((mean - expected) / expected).abs().max_element();
        assert!(off < 0.01, "{}: {mean} {expected}", tracer.info().name);
    }
}

/// What light sampling finds behind a rough wall and what chance does add up to what is seen straight through a smooth one.
#[test]
fn rough_walls_are_as_bright_as_smooth_ones_in_uniform_light() {
    for roughness in [0.1, 0.3] {
        let scene = |roughness| {
            let mut scene = on_screen(wall([0.8; 3], roughness, 1.0), Vec::new(), screen());
            // So large that all light that is spread comes from it.
            let mut lamp = lamp_behind(2.0);
            lamp.half_u *= 20.0;
            lamp.half_v *= 20.0;
            scene.area_lights.push(lamp);
            scene
        };
        let (smooth, rough) = (scene(0.0), scene(roughness));
        for tracer in tracers() {
            let [smooth, rough] =
                [&smooth, &rough].map(|scene| mean(&picture(tracer.as_ref(), scene, 512)).x);
            let what = format!("{}, {roughness}: {smooth} {rough}", tracer.info().name);
            assert!((smooth / rough - 1.0).abs() < 0.03, "{what}");
        }
    }
}

#[test]
fn a_transmission_texture_of_one_colour_is_that_number() {
    let red = 150;
    let share = f32::from(red) / 255.0;
    let lit = |transmission, textures| {
        let material = wall([0.9, 0.6, 0.3], 0.4, transmission);
        let material = match textures {
            true => material.textured(MaterialTextures {
                transmission: Some(0),
                ..MaterialTextures::NONE
            }),
            false => material,
        };
        let maps = vec![texture(2, |_, _| [red, 30, 200]).linear()];
        let mut scene = on_screen(material, maps, screen());
        scene.area_lights.push(lamp_behind(3.0));
        scene
    };
    let scenes = [lit(0.8 * share, false), lit(0.8, true), lit(0.8, false)];
    for tracer in tracers() {
        let [expected, textured, ignored] = scenes
            .each_ref()
            .map(|scene| picture(tracer.as_ref(), scene, 4));
        let off = |other: &[[f32; 3]]| {
            let pairs = expected.as_flattened().iter().zip(other.as_flattened());
            pairs
                .map(|(a, b)| (a - b).abs() / (0.1 + a))
                .fold(0.0, f32::max)
        };
        let name = tracer.info().name;
        assert!(off(&textured) < 5e-4, "{name}: {}", off(&textured));
        assert!(off(&ignored) > 0.01, "{name}: it may be ignored");
    }
}

#[test]
fn thin_walls_with_an_inside_are_refused() {
    let refusal = |scene: Scene| scene.validate().unwrap_err().to_string();
    let solid = with(empty(1.0), wall([1.0; 3], 0.0, 0.5), ball());
    let sentence = "its material `object 0` has transmission, which makes it a thin wall";
    assert!(refusal(solid).contains(sentence));
    let much = with(empty(1.0), wall([1.0; 3], 0.0, 1.5), screen().into());
    assert!(refusal(much).contains("its transmission is 1.5"));
    let update = SceneUpdate {
        particles: vec![ParticleCloud {
            material: wall([1.0; 3], 0.0, 0.5),
            radius_m: 0.01,
            min: Vec3::ZERO,
            max: Vec3::ONE,
            places: vec![U16Vec3::ZERO],
            form: ParticleForm::Balls,
        }],
        poses: Vec::<ObjectPose>::new(),
        ..SceneUpdate::default()
    };
    let refusal = update.validate_particles().unwrap_err().to_string();
    assert!(refusal.contains("its particles are balls"), "{refusal}");
}
