//! Scenes of triangles, as files: Mitsuba's Cornell box, and a bumpy ball of a million triangles or of as many as are
//! asked for.
//!
//! `cargo run --release -p carom-tracer --example mesh_scenes -- FOLDER [TRIANGLES]`
//!
//! It prints how long the ball takes to be compiled, and its BVH to be built on all threads.

use std::f32::consts::{PI, TAU};
use std::path::PathBuf;
use std::time::Instant;

use carom_tracer::compiled::ShapeKind;
use carom_tracer::{
    AreaLight, Camera, CompiledScene, Layers, Material, MaterialTextures, Mesh, Opacity, Scene,
};
use glam::{Mat4, Quat, Vec3};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("which folder?")?);
    let triangles = arguments
        .next()
        .map_or(Ok(1_000_000), |text| text.parse())?;
    let mut box_lit_by_a_light = cornell_box();
    box_lit_by_a_light.add_light(lamp());
    box_lit_by_a_light.save(folder.join("cornell_box.json"))?;
    cornell_box_with_white_lamp().save(folder.join("cornell_box_white_lamp.json"))?;
    let scene = bumpy_ball_on_floor(triangles);
    let begun = Instant::now();
    let compiled = CompiledScene::new(&scene)?;
    let compiled_in = begun.elapsed();
    let begun = Instant::now();
    let bvh = compiled
        .build_bvh(ShapeKind::Triangle)
        .ok_or("too few triangles")?;
    println!(
        "{} triangles: compiled in {:.3} s, BVH of {} nodes in {:.3} s on {} threads",
        compiled.meshes.triangles.len(),
        compiled_in.as_secs_f64(),
        bvh.nodes.len(),
        begun.elapsed().as_secs_f64(),
        rayon::current_num_threads()
    );
    scene.save(folder.join("bumpy_ball.json"))?;
    Ok(())
}

/// As `mitsuba.cornell_box()` has it (Mitsuba 3.9), each surface a mesh, but for its lamp; y is up.
fn cornell_box() -> Scene {
    let camera = Camera::looking_at([0.0, 0.0, 3.9], [0.0; 3]).upright([0.0, 1.0, 0.0]);
    let mut scene = Scene::new().camera(camera.fov_deg(39.3077)).sky([0.0; 3]);
    let white = Material::diffuse(WHITE);
    let green = Material::diffuse([0.105_421, 0.377_98, 0.076_425]);
    let red = Material::diffuse([0.570_068, 0.043_013_5, 0.044_370_6]);
    let wall = |normal: Vec3| {
        let (u, v) = normal.any_orthonormal_pair();
        let corners = [u + v, u - v, -u - v, v - u].map(|corner| corner - normal);
        Mesh::new(corners.into(), vec![[0, 1, 2], [0, 2, 3]])
    };
    for (name, normal, material) in [
        ("floor", Vec3::Y, white),
        ("ceiling", Vec3::NEG_Y, white),
        ("back", Vec3::Z, white),
        ("green wall", Vec3::NEG_X, green),
        ("red wall", Vec3::X, red),
    ] {
        scene.add_named(name, wall(normal), material);
    }
    for (name, half, center, degrees) in [
        (
            "small box",
            Vec3::splat(0.3),
            Vec3::new(0.335, -0.7, 0.38),
            -17.0f32,
        ),
        (
            "large box",
            Vec3::new(0.3, 0.61, 0.3),
            Vec3::new(-0.33, -0.4, -0.28),
            18.25,
        ),
    ] {
        let turn = Quat::from_rotation_y(degrees.to_radians());
        scene.add_named(name, block(half).at(center).rotated(turn), white);
    }
    scene
}

/// The albedo of the box's white walls.
const WHITE: [f32; 3] = [0.885_809, 0.698_859, 0.666_422];

/// The box's lamp, which reflects nothing.
fn lamp() -> AreaLight {
    let mut lamp = AreaLight::new(0.46, 0.38).at([0.0, 0.99, 0.01]);
    (lamp.half_u, lamp.half_v) = (0.23 * Vec3::X, 0.19 * Vec3::Z);
    lamp.radiance([18.387, 13.987_3, 6.753_57])
}

/// The box with a lamp as white as its walls: a mesh that emits to both sides, under a black lid.
fn cornell_box_with_white_lamp() -> Scene {
    let mut scene = cornell_box();
    let AreaLight {
        center,
        half_u,
        half_v,
        radiance,
        ..
    } = lamp();
    let sheet = |height: f32| {
        let corners = [
            half_u + half_v,
            half_u - half_v,
            -half_u - half_v,
            half_v - half_u,
        ];
        let corners = corners.map(|corner| center + corner + height * Vec3::Y);
        Mesh::new(corners.into(), vec![[0, 1, 2], [0, 2, 3]])
    };
    let glowing = Material::MetallicRoughness {
        base_color: WHITE.into(),
        metallic: 0.0,
        roughness: 1.0,
        ior: 1.5,
        emission: radiance,
        textures: MaterialTextures::NONE,
        opacity: Opacity::Opaque,
        layers: Layers {
            specular: 0.0,
            ..Layers::NONE
        },
    };
    scene.add_named("lamp", sheet(0.0), glowing);
    scene.add_named("lid", sheet(1e-4), Material::diffuse([0.0; 3]));
    scene
}

/// A box of half these edges round the origin.
fn block(half: Vec3) -> Mesh {
    let corner = |i: u32| {
        let sign = |bit: u32| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
        half * Vec3::new(sign(0), sign(1), sign(2))
    };
    let faces = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let triangles = faces
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    Mesh::new((0..8).map(corner).collect(), triangles.collect())
}

fn bumpy_ball_on_floor(triangles: u32) -> Scene {
    let camera = Camera::looking_at([0.3, -3.6, 1.9], [0.0, 0.0, 0.9]);
    let mut scene = Scene::new().camera(camera).sky([0.3, 0.35, 0.4]);
    // Of 200 m: on one of 20 km, as planes are, Mitsuba's CUDA back end loses 3 % of the sky's light.
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let corners = corners.map(|[x, y]| 100.0 * Vec3::new(x, y, 0.0));
    let floor = Mesh::new(corners.into(), vec![[0, 1, 2], [0, 2, 3]]);
    scene.add(floor, Material::diffuse([0.4, 0.35, 0.3]));
    let ball = bumpy_ball(triangles).at([0.0, 0.0, 1.0]);
    scene.add_named("ball", ball, Material::diffuse([0.7, 0.3, 0.15]));
    scene.add_light(
        AreaLight::new(1.5, 1.5)
            .at([2.0, -2.0, 4.0])
            .facing([0.0; 3])
            .power(300.0),
    );
    scene
}

/// A ball of radius 1 m with bumps of 3 cm, of half as many rows as columns; its poles are open by a thousandth.
fn bumpy_ball(triangles: u32) -> Mesh {
    let rows = (f64::from(triangles) / 4.0).sqrt().round().max(2.0) as u32;
    let columns = triangles.div_ceil(2 * rows).max(3);
    let point = |i: u32| {
        let (row, column) = (i / columns, i % columns);
        let polar = 0.001 + (PI - 0.002) * row as f32 / rows as f32;
        let azimuth = TAU * column as f32 / columns as f32;
        let bump = 0.03 * (20.0 * polar).sin() * (20.0 * azimuth).sin();
        let turn = Mat4::from_rotation_z(azimuth) * Mat4::from_rotation_y(polar);
        (1.0 + bump) * turn.transform_vector3(Vec3::Z)
    };
    let positions = (0..(rows + 1) * columns).map(point).collect();
    let faces = (0..rows * columns).flat_map(|i| {
        let next = i / columns * columns + (i + 1) % columns;
        [[i, i + columns, next + columns], [i, next + columns, next]]
    });
    Mesh::new(positions, faces.collect())
}
