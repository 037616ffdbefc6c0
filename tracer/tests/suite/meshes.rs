//! Laws of triangle meshes.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_3};

use carom_tracer::film::{trace_image, trace_tiles};
use carom_tracer::metrics::mean;
use carom_tracer::{
    CompiledScene, ImageSize, Mesh, ObjectPose, RadianceImage, RenderSettings, Scene, SceneUpdate,
    Shape, Tile, TileGrid, Tracer,
};
use glam::{Quat, Vec3};

use crate::scenes::{diffuse, empty, floor, gold, light, plastic, still_life, with};
use crate::tracers::tracers;

const SIZE: ImageSize = ImageSize::new(24, 16);

/// A box as twelve triangles.
pub(crate) fn cube(min: Vec3, max: Vec3) -> Mesh {
    let corner = |i: u32| {
        let pick = |bit: u32| if i >> bit & 1 == 0 { min } else { max };
        Vec3::new(pick(0).x, pick(1).y, pick(2).z)
    };
    let faces: [[u32; 4]; 6] = [
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

/// A ball of radius 1 as facets: an octahedron whose edges are halved so many times.
pub(crate) fn facetted_ball(halvings: u32) -> Mesh {
    let edge = 1u32 << halvings;
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for octant in 0..8u32 {
        let sign = |bit: u32| if octant >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let signs = Vec3::new(sign(0), sign(1), sign(2));
        let first = positions.len() as u32;
        let row_first = |row: u32| first + row * (row + 1) / 2;
        for row in 0..=edge {
            let column = |column: u32| Vec3::new((row - column) as f32, column as f32, 0.0);
            positions.extend((0..=row).map(|c| {
                let point = column(c) + (edge - row) as f32 * Vec3::Z;
                (signs * point).normalize()
            }));
        }
        let outwards = |[a, b, c]: [u32; 3]| match signs.element_product() > 0.0 {
            true => [a, b, c],
            false => [a, c, b],
        };
        for row in 0..edge {
            let (upper, lower) = (row_first(row), row_first(row + 1));
            let down = (0..=row).map(|c| [upper + c, lower + c, lower + c + 1]);
            let up = (0..row).map(|c| [upper + c, lower + c + 1, upper + c + 1]);
            triangles.extend(down.chain(up).map(outwards));
        }
    }
    Mesh::new(positions, triangles)
}

/// The same, shaded as the ball.
pub(crate) fn smooth_ball(halvings: u32) -> Mesh {
    let ball = facetted_ball(halvings);
    let normals = ball.positions.clone();
    ball.normals(normals)
}

/// Meshes, facetted and smooth, of matt and shiny materials among other shapes.
pub(crate) fn mesh_still_life() -> Scene {
    let ball = |mesh: Mesh, x: f32| mesh.scaled(Vec3::splat(0.3)).at([x, -0.2, 0.3]);
    let turned = Quat::from_rotation_z(0.4);
    let block = cube(Vec3::new(-0.2, -0.15, 0.0), Vec3::new(0.2, 0.15, 0.6));
    let mut scene = with(empty(0.05), diffuse(0.6), floor());
    scene = with(scene, plastic(0.5, 1.5), ball(smooth_ball(3), 0.0).into());
    scene = with(scene, diffuse(0.7), ball(facetted_ball(2), 0.7).into());
    scene = with(scene, gold(0.2), ball(smooth_ball(1), -0.7).into());
    scene = with(
        scene,
        gold(0.0),
        block.rotated(turned).at([0.3, 0.6, 0.0]).into(),
    );
    let others = still_life();
    scene.objects.push(others.objects[3].clone());
    let material = others.objects[3].material.clone();
    scene.materials.insert(material, diffuse(0.2));
    scene.area_lights = others.area_lights;
    scene.camera = others.camera;
    scene
}

fn settings(samples: u32) -> RenderSettings {
    RenderSettings {
        samples,
        ..RenderSettings::default()
    }
}

fn picture(tracer: &dyn Tracer, scene: &CompiledScene, samples: u32) -> RadianceImage {
    let film = trace_image(tracer, scene, SIZE, settings(samples)).unwrap();
    assert_eq!(film.dropped_samples(), 0, "{}", tracer.info().name);
    film.image()
}

fn compiled(scene: &Scene) -> CompiledScene {
    CompiledScene::new(scene).unwrap()
}

fn alone(mesh: Mesh, albedo: f32) -> Scene {
    with(empty(1.0), diffuse(albedo), mesh.into())
}

#[test]
fn a_cube_of_triangles_looks_as_a_box() {
    let (min, max) = (Vec3::new(-0.4, -0.3, 0.0), Vec3::new(0.2, 0.5, 0.7));
    for material in [diffuse(0.6), plastic(0.4, 1.5), gold(0.3)] {
        let scene = |shape: Shape| {
            let mut scene = with(empty(0.1), diffuse(0.5), floor());
            scene = with(scene, material, shape);
            scene.area_lights.push(light(1.5, true, 10.0));
            scene.camera = still_life().camera;
            compiled(&scene)
        };
        let (mesh, solid) = (scene(cube(min, max).into()), scene(Shape::Box { min, max }));
        for tracer in tracers() {
            let [mesh, solid] = [&mesh, &solid].map(|scene| picture(tracer.as_ref(), scene, 4));
            let is_same = |(a, b): &(&f32, &f32)| (**a - **b).abs() <= 1e-3 * (0.1 + **b);
            let channels = mesh.pixels.as_flattened().iter();
            let channels = channels.zip(solid.pixels.as_flattened());
            let share = channels.filter(is_same).count() as f64 / (3 * SIZE.pixels()) as f64;
            assert!(share > 0.99, "{}: {share}", tracer.info().name);
        }
    }
}

/// White furnace: light that a convex body scatters does not come back to it, whichever facet it leaves, however
/// large it is and wherever.
#[test]
fn a_white_facetted_ball_vanishes_in_uniform_light() {
    for (radius_m, center) in [
        (1.0, Vec3::ZERO),
        (1e-4, Vec3::ZERO),
        (1e4, Vec3::ZERO),
        (0.01, Vec3::new(3.0, -7.0, 11.0)),
        (1.0, Vec3::new(100.0, 200.0, -50.0)),
    ] {
        let ball = facetted_ball(5).scaled(Vec3::splat(radius_m)).at(center);
        let mut scene = alone(ball, 1.0);
        scene.camera.eye = center + radius_m * Vec3::new(0.0, -3.0, 0.4);
        scene.camera.target = center;
        let scene = compiled(&scene);
        for tracer in tracers() {
            for pixel in picture(tracer.as_ref(), &scene, 16).pixels.as_flattened() {
                let name = tracer.info().name;
                assert!((pixel - 1.0).abs() < 2e-5, "{name}, {radius_m} m: {pixel}");
            }
        }
    }
}

/// What an interpolated normal sends below the surface is lost; nothing is made.
#[test]
fn interpolated_normals_never_make_light() {
    for (halvings, least) in [(0, 0.6), (1, 0.9), (4, 0.99)] {
        let scene = compiled(&alone(smooth_ball(halvings), 1.0));
        for tracer in tracers() {
            let picture = picture(tracer.as_ref(), &scene, 64);
            for pixel in picture.pixels.as_flattened() {
                assert!(*pixel < 1.0 + 2e-5, "{}: {pixel}", tracer.info().name);
            }
            let mean = mean(&picture)[0];
            assert!(mean > least, "{}, {halvings}: {mean}", tracer.info().name);
        }
    }
}

/// Mirrors too: their images of the viewer are above the surface, and nothing lies there.
#[test]
fn smooth_mirrors_reflect_the_sky_everywhere() {
    let mirror = carom_tracer::Material::Conductor {
        eta: Vec3::splat(0.01),
        k: Vec3::splat(1000.0),
        alpha: 0.0,
        number: 0,
    };
    for halvings in [0, 1, 3] {
        let mut scene = with(empty(1.0), mirror, smooth_ball(halvings).into());
        scene.camera.fov_x_deg = 40.0;
        let scene = compiled(&scene);
        for tracer in tracers() {
            for pixel in picture(tracer.as_ref(), &scene, 8).pixels.as_flattened() {
                let name = tracer.info().name;
                assert!((pixel - 1.0).abs() < 1e-3, "{name}, {halvings}: {pixel}");
            }
        }
    }
}

/// A closed mesh is dark inside: no ray from its middle passes an edge or a corner.
#[test]
fn closed_meshes_are_dark_inside() {
    for halvings in [0, 2, 5] {
        let mut scene = alone(facetted_ball(halvings), 0.0);
        scene.camera.eye = Vec3::new(0.0, 0.01, 0.02);
        scene.camera.target = Vec3::X;
        scene.camera.fov_x_deg = 120.0;
        let scene = compiled(&scene);
        for tracer in tracers() {
            let picture = picture(tracer.as_ref(), &scene, 64);
            let is_dark = picture.pixels.iter().all(|pixel| *pixel == [0.0; 3]);
            assert!(is_dark, "{}, {halvings}", tracer.info().name);
        }
    }
}

#[test]
fn pictures_of_meshes_do_not_depend_on_tiles() {
    let scene = compiled(&mesh_still_life());
    for tracer in tracers() {
        let whole = picture(tracer.as_ref(), &scene, 3);
        let grid = TileGrid::new(SIZE, 5);
        let mut tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
        tiles.reverse();
        let film = trace_tiles(tracer.as_ref(), &scene, SIZE, settings(3), &tiles).unwrap();
        assert_eq!(film.image(), whole, "{}", tracer.info().name);
    }
}

#[test]
fn triangles_without_area_are_not_seen() {
    let mut mesh = facetted_ball(2);
    let clean = compiled(&alone(mesh.clone(), 0.5));
    let end = mesh.positions.len() as u32;
    mesh.positions
        .extend([Vec3::splat(-2.0), Vec3::splat(-1.0), Vec3::ZERO]);
    mesh.triangles
        .extend([[0, 0, 0], [0, 0, end], [end, end + 1, end + 2]]);
    let dirty = compiled(&alone(mesh, 0.5));
    for tracer in tracers() {
        let [clean, dirty] = [&clean, &dirty].map(|scene| picture(tracer.as_ref(), scene, 2));
        assert_eq!(clean, dirty, "{}", tracer.info().name);
    }
}

/// Places and turns that leave coordinates as they are but for the sign, so that no number is rounded.
#[test]
fn a_moved_mesh_is_where_it_was_built_elsewhere() {
    let mesh = || cube(Vec3::new(-0.5, -0.25, -0.125), Vec3::new(0.5, 0.25, 0.125));
    let placed = |position: Vec3, rotation: Quat| {
        let mut scene = with(
            empty(0.2),
            diffuse(0.5),
            facetted_ball(2).at([2.0, 3.0, 0.0]).into(),
        );
        scene = with(
            scene,
            plastic(0.5, 1.5),
            mesh().at(position).rotated(rotation).into(),
        );
        scene.area_lights.push(light(1.5, true, 10.0));
        scene
    };
    let (position, rotation) = (
        Vec3::new(0.25, 0.5, -0.25),
        Quat::from_rotation_z(FRAC_PI_2),
    );
    let base = placed(Vec3::ZERO, Quat::IDENTITY);
    let mut moved = compiled(&base);
    let pose = ObjectPose {
        object: 1,
        position,
        rotation,
        visible: true,
    };
    let hidden = ObjectPose {
        visible: false,
        ..pose
    };
    let mut without = base.clone();
    without.objects.pop();
    let there = compiled(&placed(position, rotation));
    for tracer in tracers() {
        let name = tracer.info().name;
        let shown = |scene: &CompiledScene| picture(tracer.as_ref(), scene, 2).pixels;
        moved.apply(&SceneUpdate::default().pose(pose)).unwrap();
        let is_same = |(a, b): &(&f32, &f32)| (**a - **b).abs() <= 1e-3 * (0.1 + **b);
        let (moved_pixels, expected) = (shown(&moved), shown(&there));
        let channels = moved_pixels
            .as_flattened()
            .iter()
            .zip(expected.as_flattened());
        let share = channels.filter(is_same).count() as f64 / (3 * SIZE.pixels()) as f64;
        assert!(share > 0.99, "{name}: {share}");
        moved.apply(&SceneUpdate::default().pose(hidden)).unwrap();
        assert_eq!(shown(&moved), shown(&compiled(&without)), "{name}");
        moved.apply(&SceneUpdate::default()).unwrap();
        assert_eq!(shown(&moved), shown(&compiled(&base)), "{name}");
    }
}

#[test]
fn a_turned_mesh_carries_its_normals_along() {
    let turn = Quat::from_rotation_z(FRAC_PI_3) * Quat::from_rotation_x(0.3);
    let at = |rotation: Quat| {
        with(
            empty(0.1),
            plastic(0.5, 1.5),
            smooth_ball(3).rotated(rotation).into(),
        )
    };
    let lit = |mut scene: Scene| {
        scene.area_lights.push(light(3.0, true, 10.0));
        scene.camera.fov_x_deg = 40.0;
        compiled(&scene)
    };
    let (built, mut moved) = (lit(at(turn)), lit(at(Quat::IDENTITY)));
    let pose = ObjectPose {
        object: 0,
        position: Vec3::ZERO,
        rotation: turn,
        visible: true,
    };
    moved.apply(&SceneUpdate::default().pose(pose)).unwrap();
    for tracer in tracers() {
        let [built, moved] = [&built, &moved].map(|scene| picture(tracer.as_ref(), scene, 2));
        let channels = built
            .pixels
            .as_flattened()
            .iter()
            .zip(moved.pixels.as_flattened());
        let is_same = |(a, b): &(&f32, &f32)| (**a - **b).abs() <= 1e-3 * (0.1 + **b);
        let share = channels.filter(is_same).count() as f64 / (3 * SIZE.pixels()) as f64;
        assert!(share > 0.99, "{}: {share}", tracer.info().name);
    }
}

#[test]
fn bad_meshes_are_refused_with_object_and_value() {
    let refusal = |mesh: Mesh| {
        let scene = with(empty(1.0), diffuse(0.5), mesh.into());
        scene.validate().unwrap_err().to_string()
    };
    let with_position = |value: Vec3| {
        let mut mesh = cube(Vec3::ZERO, Vec3::ONE);
        mesh.positions[5] = value;
        refusal(mesh)
    };
    let ball = || smooth_ball(1);
    let cases = [
        (
            with_position(Vec3::new(0.0, f32::NAN, 1.0)),
            "vertex 5 of its mesh is [0, NaN, 1]",
        ),
        (
            with_position(Vec3::INFINITY),
            "vertex 5 of its mesh is [inf, inf, inf]",
        ),
        (with_position(Vec3::splat(1e8)), "must be within ±1e7 m"),
        (
            refusal(Mesh::new(vec![Vec3::ZERO; 3], vec![[0, 1, 2], [0, 3, 1]])),
            "triangle 1 of its mesh has vertex 3, but there are 3 vertices",
        ),
        (
            refusal(Mesh::new(vec![Vec3::ZERO; 2], Vec::new())),
            "its mesh has 2 vertices and no triangle",
        ),
        (
            refusal(cube(Vec3::ZERO, Vec3::ONE).normals(vec![Vec3::Z; 7])),
            "its mesh has 7 normals for 8 vertices",
        ),
        (
            refusal(ball().normals(vec![Vec3::ZERO; ball().positions.len()])),
            "normal 0 of its mesh is [0, 0, 0]: it must be finite and not 0",
        ),
        (refusal(ball().at(Vec3::NAN)), "its center is [NaN"),
        (
            refusal(ball().rotated(Quat::from_xyzw(0.0, 0.0, 0.0, 0.5))),
            "its rotation is",
        ),
        (
            refusal(Mesh::new(vec![Vec3::ZERO; 3], vec![[0, 1, 2]; 10_000_001])),
            "it has 10000001 triangles: at most 10000000 are allowed",
        ),
    ];
    for (refusal, sentence) in cases {
        assert!(
            refusal.contains(sentence),
            "`{sentence}` is not in `{refusal}`"
        );
    }
    let refusal = refusal(ball().at(Vec3::NAN));
    assert!(refusal.contains("object 0 `object 0`"), "{refusal}");
}

#[test]
fn meshes_come_back_from_json_bit_by_bit() {
    let scene = mesh_still_life();
    let text = scene.to_json().unwrap();
    assert_eq!(Scene::from_json(&text).unwrap(), scene);
    let short = r#"{ "mesh": { "positions": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 2]] } }"#;
    let shape: Shape = serde_json::from_str(short).unwrap();
    let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    assert_eq!(shape, Mesh::new(corners, vec![[0, 1, 2]]).into());
}
