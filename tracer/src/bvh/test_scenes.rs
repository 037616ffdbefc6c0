//! Test scenes with many primitives of one shape, and rays through them, for comparing BVH traversal with a
//! linear search.

use std::collections::BTreeMap;

use glam::{Quat, Vec3};

use crate::compiled::ShapeKind;
use crate::sampling::uniforms;
use crate::{Camera, CompiledScene, Environment, Lens, Material, Mesh, Object, Scene, Shape};

#[derive(Clone, Copy, Debug)]
pub(crate) enum Arrangement {
    /// Random positions, also overlapping.
    Cloud,
    /// On a lattice, each touching its neighbours.
    Touching,
    /// Several at the same position.
    Coincident,
    /// Sizes from a few micrometres to a metre.
    Sized,
    /// Along a line, with gaps that grow to a kilometre.
    Growing,
    /// A cloud of glass.
    Glass,
    /// A hundred kilometres from the origin.
    Far,
}

pub(crate) const ARRANGEMENTS: [Arrangement; 7] = [
    Arrangement::Cloud,
    Arrangement::Touching,
    Arrangement::Coincident,
    Arrangement::Sized,
    Arrangement::Growing,
    Arrangement::Glass,
    Arrangement::Far,
];

pub(crate) const SHAPES: [ShapeKind; 5] = [
    ShapeKind::Sphere,
    ShapeKind::Box,
    ShapeKind::Disc,
    ShapeKind::Rectangle,
    ShapeKind::Triangle,
];

/// Position and radius of primitive `i` of `count`.
fn place(kind: Arrangement, count: u32, seed: u32, i: u32) -> (Vec3, f32) {
    let [x, y, z, r] = uniforms(i, seed, 7, 0);
    let (cloud, small) = (
        2.0 * Vec3::new(x, y, z) - 1.0,
        (count as f32).cbrt().recip(),
    );
    match kind {
        Arrangement::Cloud | Arrangement::Glass => (cloud, (0.05 + 0.6 * r) * small),
        Arrangement::Touching => {
            let edge = (count as f32).cbrt().ceil() as u32;
            let place = [i % edge, i / edge % edge, i / edge / edge];
            (0.25 * Vec3::from(place.map(|at| at as f32)), 0.125)
        }
        Arrangement::Coincident => {
            let [x, y, z, r] = uniforms(i / 3, seed, 7, 0);
            (2.0 * Vec3::new(x, y, z) - 1.0, (0.2 + 0.5 * r) * small)
        }
        Arrangement::Sized => (cloud, 10f32.powf(-5.5 * r)),
        Arrangement::Growing => (
            Vec3::new(1000f32.powf(i as f32 / count as f32) - 1.0, 0.1 * y, 0.0),
            0.05 * (1.0 + i as f32 / count as f32),
        ),
        Arrangement::Far => (cloud + Vec3::new(1e5, -1e5, 3e4), 0.5 * small),
    }
}

fn shape(of: ShapeKind, kind: Arrangement, (center, radius): (Vec3, f32), i: u32) -> Shape {
    let [a, b, c, d] = uniforms(i, 5, 7, 0);
    let normal = (Vec3::new(a, b, c) - 0.5).normalize();
    let (u, v) = normal.any_orthonormal_pair();
    match of {
        ShapeKind::Sphere => Shape::Sphere {
            center,
            radius,
            rotation: Quat::IDENTITY,
        },
        ShapeKind::Box => {
            let half = match kind {
                Arrangement::Touching => Vec3::splat(radius),
                _ => radius * Vec3::new(1.0, 0.5 + 0.5 * a, 0.5 + 0.5 * b),
            };
            Shape::Box {
                min: center - half,
                max: center + half,
            }
        }
        ShapeKind::Disc => Shape::Disc {
            center,
            normal,
            radius,
        },
        ShapeKind::Rectangle => Shape::Rectangle {
            center,
            half_u: radius * u,
            half_v: radius * (0.5 + 0.5 * d) * v,
        },
        ShapeKind::CsgFace => Shape::CsgBox {
            min: center - radius,
            max: center + radius,
            subtractions: Vec::new(),
        },
        ShapeKind::Triangle => {
            let corners = [u, v, -0.5 * u - d * v].map(|corner| radius * corner);
            Mesh::new(corners.into(), vec![[0, 1, 2]]).at(center).into()
        }
    }
}

/// A scene of one shape; flat shapes are never glass.
pub(crate) fn test_scene(kind: Arrangement, of: ShapeKind, count: u32, seed: u32) -> CompiledScene {
    let albedo = Vec3::ONE;
    let is_body = matches!(of, ShapeKind::Sphere | ShapeKind::Box);
    let material = match kind {
        Arrangement::Glass if is_body => Material::Dielectric {
            ior: 1.5,
            alpha: 0.0,
            medium: None,
            number: 0,
        },
        _ => Material::Diffuse { albedo },
    };
    let object = |i| Object {
        name: String::new(),
        material: "m".to_owned(),
        shape: shape(of, kind, place(kind, count, seed, i), i),
    };
    let (target, _) = place(kind, count, seed, 0);
    let scene = Scene {
        camera: Camera {
            eye: target + 3.0,
            target,
            up: Vec3::Z,
            fov_x_deg: 40.0,
            lens: Lens::default(),
            near_m: 0.0,
        },
        environment: Environment { radiance: albedo },
        materials: BTreeMap::from([("m".to_owned(), material)]),
        objects: (0..count).map(object).collect(),
        area_lights: Vec::new(),
        ..Scene::new()
    };
    CompiledScene::new(&scene).unwrap()
}

pub(crate) struct CrowdRay {
    pub(crate) origin: Vec3,
    /// Unit vector.
    pub(crate) direction: Vec3,
    /// The primitive that the ray starts on, if any.
    pub(crate) left: Option<u32>,
    /// Whether the ray travels inside that primitive.
    pub(crate) is_inside: bool,
}

/// Centre and half extents of a primitive.
fn extent(scene: &CompiledScene, i: usize) -> (Vec3, Vec3) {
    let (center, half) = if let Some(sphere) = scene.spheres.get(i) {
        (sphere.center, Vec3::splat(sphere.radius))
    } else if let Some(data) = scene.boxes.get(i) {
        let (min, max) = (Vec3::from(data.min), Vec3::from(data.max));
        ((0.5 * (min + max)).to_array(), 0.5 * (max - min))
    } else if let Some(disc) = scene.discs.get(i) {
        (disc.center, Vec3::splat(disc.radius))
    } else if let Some(data) = scene.meshes.triangles.get(i) {
        let [a, b, c] = data.corners();
        let (min, max) = (a.min(b).min(c), a.max(b).max(c));
        (((a + b + c) / 3.0).to_array(), 0.5 * (max - min))
    } else {
        let data = &scene.rectangles[i];
        let half = Vec3::from(data.half_u).abs() + Vec3::from(data.half_v).abs();
        (data.center, half)
    };
    (center.into(), half)
}

/// A point on a primitive's surface with its normal; for flat shapes the centre, without a normal.
fn surface(scene: &CompiledScene, i: usize, aside: Vec3) -> (Vec3, Option<Vec3>) {
    let (center, half) = extent(scene, i);
    if i < scene.spheres.len() {
        return (center + half * aside, Some(aside));
    }
    if i < scene.boxes.len() {
        let axis = aside.abs().max_position();
        let normal = aside[axis].signum() * Vec3::AXES[axis];
        return (center + half * aside / aside[axis].abs(), Some(normal));
    }
    (center, None)
}

/// Ray from the eye, from between the primitives or from a primitive's surface; towards a primitive, along
/// an axis or in a random direction.
pub(crate) fn ray(scene: &CompiledScene, seed: u32, i: u32) -> CrowdRay {
    let [a, b, c, d] = uniforms(i, seed, 8, 0);
    let [e, f, g, h] = uniforms(i, seed, 9, 0);
    let some = |u: f32| (u * scene.primitives.len() as f32) as usize;
    let aside = (Vec3::new(e, f, g) - 0.5)
        .try_normalize()
        .unwrap_or(Vec3::X);
    let from = some(a);
    let (center, half) = extent(scene, from);
    let is_left = i % 4 > 1 && half != Vec3::ZERO;
    let (on, normal) = surface(scene, from, aside);
    let origin = match i % 4 {
        0 => scene.camera.eye,
        1 => center + 2.0 * aside * (b - 0.5),
        _ => on,
    };
    let (at, at_half) = extent(scene, some(c));
    let aim = at + 1.1 * at_half * (Vec3::new(f, g, h) - 0.5);
    let direction = match i / 4 % 8 {
        0 => Vec3::AXES[some(d) % 3],
        1 => -Vec3::AXES[some(d) % 3],
        2 => Vec3::new(g, h, e) - 0.5,
        _ => aim - origin,
    };
    let mut direction = direction.try_normalize().unwrap_or(Vec3::Y);
    let is_inside = is_left && i % 4 == 3 && normal.is_some() && scene.materials[0].ior > 1.0;
    if let Some(normal) = normal {
        let outwards = direction.dot(normal);
        if is_left && (outwards < 0.0) != is_inside {
            direction -= 2.0 * outwards * normal;
            direction = direction.normalize();
        }
    }
    CrowdRay {
        origin,
        direction,
        left: is_left.then_some(from as u32),
        is_inside,
    }
}

/// A closed mesh around the origin, with rays from within to its vertices and to points on its edges.
pub(crate) fn globe_with_rays() -> (CompiledScene, Vec<(Vec3, Vec3)>) {
    const ROWS: u32 = 12;
    const COLUMNS: u32 = 17;
    let ring = |row: u32| {
        (0..COLUMNS).map(move |column| {
            let (sin, cos) = (std::f32::consts::PI * row as f32 / ROWS as f32).sin_cos();
            let turn = Quat::from_rotation_z(0.37 * column as f32);
            turn * Vec3::new(1.3 * sin, 0.0, cos)
        })
    };
    let mut positions: Vec<Vec3> = (1..ROWS).flat_map(ring).collect();
    let [north, south] = [0, 1].map(|pole| positions.len() as u32 + pole);
    positions.extend([Vec3::Z, Vec3::NEG_Z]);
    let at = |row: u32, column: u32| row * COLUMNS + column % COLUMNS;
    let mut triangles: Vec<[u32; 3]> = (0..COLUMNS)
        .flat_map(|c| {
            [
                [north, at(0, c), at(0, c + 1)],
                [south, at(ROWS - 2, c + 1), at(ROWS - 2, c)],
            ]
        })
        .collect();
    triangles.extend((0..ROWS - 2).flat_map(|row| {
        (0..COLUMNS).flat_map(move |c| {
            let [a, b, c, d] = [
                at(row, c),
                at(row + 1, c),
                at(row + 1, c + 1),
                at(row, c + 1),
            ];
            [[a, b, c], [a, c, d]]
        })
    }));
    let rays = |seed: u32| {
        let (positions, triangles) = (positions.clone(), triangles.clone());
        (0..).zip(triangles).flat_map(move |(i, [a, b, c])| {
            let [x, y, z, along] = uniforms(i, seed, 11, 0);
            let origin = 0.4 * Vec3::new(x, y, z) - 0.2;
            let corner = |index: u32| positions[index as usize];
            let on_edge = corner(a).lerp(corner(b), along);
            [corner(a), on_edge, 0.5 * (corner(b) + corner(c))].map(|aim| (origin, aim - origin))
        })
    };
    let rays: Vec<_> = (0..8)
        .flat_map(rays)
        .map(|(o, d)| (o, d.normalize()))
        .collect();
    let mut scene = Scene::new();
    scene.add(
        Mesh::new(positions.clone(), triangles.clone()),
        Material::grey(0.5),
    );
    (CompiledScene::new(&scene).unwrap(), rays)
}
