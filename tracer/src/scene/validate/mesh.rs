//! Validation of triangle meshes.

use std::fmt::Display;

use glam::{Vec2, Vec3, Vec4};

use super::{COORDINATE_M_MAX, Check, UV_MAX, count, position, require, rotation};
use crate::SceneError;
use crate::scene::{Mesh, Scene, Shape};

/// Maximum number of triangles in a scene. With vertex normals and BVH they take at most 1.5 GB of
/// a node's memory per tracer.
pub const TRIANGLES_MAX: usize = 10_000_000;
/// Maximum number of vertices in a mesh, enough for triangles that share none.
pub const VERTICES_MAX: usize = 3 * TRIANGLES_MAX;

/// Checks the total number of triangles of all meshes.
pub(super) fn check_triangles(scene: &Scene) -> Check {
    let triangles = scene.objects.iter().map(|object| match &object.shape {
        Shape::Mesh(mesh) => mesh.triangles.len(),
        _ => 0,
    });
    count("triangles", triangles.sum(), TRIANGLES_MAX)
}

pub(super) fn check_mesh(mesh: &Mesh) -> Check {
    position("its center", mesh.center)?;
    rotation(mesh.rotation)?;
    let vertices = mesh.positions.len();
    count("vertices", vertices, VERTICES_MAX)?;
    require(!mesh.triangles.is_empty(), || {
        SceneError::rule(format!(
            "its mesh has {vertices} vertices and no triangle: give it one"
        ))
    })?;
    // A coordinate in world space is at most the mesh's centre plus the vertex's distance from the
    // mesh's origin.
    let reach_max = COORDINATE_M_MAX - mesh.center.abs().max_element();
    check_each(
        "vertex",
        &mesh.positions,
        |p| p.length() <= reach_max,
        || format!("every coordinate in the world must be within ±{COORDINATE_M_MAX:e} m"),
    )?;
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        if let Some(vertex) = corners.iter().find(|vertex| **vertex as usize >= vertices) {
            return Err(SceneError::rule(format!(
                "triangle {triangle} of its mesh has vertex {vertex}, but there are {vertices} vertices"
            )));
        }
    }
    let is_direction = |n: &Vec3| n.is_finite() && n.as_dvec3().length_squared() > 0.0;
    check_count("normals", &mesh.normals, vertices)?;
    check_each("normal", &mesh.normals, is_direction, || {
        "it must be finite and not 0".to_owned()
    })?;
    let is_near = |uv: &Vec2| uv.abs().cmple(Vec2::splat(UV_MAX)).all();
    check_count("texture coordinates", &mesh.uvs, vertices)?;
    check_each("texture coordinate", &mesh.uvs, is_near, || {
        format!("each must be within ±{UV_MAX}")
    })?;
    let is_share = |c: &Vec4| c.cmpge(Vec4::ZERO).all() && c.cmple(Vec4::ONE).all();
    check_count("colours", &mesh.colors, vertices)?;
    check_each("colour", &mesh.colors, is_share, || {
        "each number must be from 0 to 1".to_owned()
    })
}

/// Checks that a list has one element per vertex, or none.
fn check_count<T>(what: &str, elements: &[T], vertices: usize) -> Check {
    let count = elements.len();
    require(count == 0 || count == vertices, || {
        SceneError::rule(format!(
            "its mesh has {count} {what} for {vertices} vertices: give it one each, or none"
        ))
    })
}

/// Checks all elements of a list with `is_valid`, which must be false for NaN.
fn check_each<T: Display>(
    what: &str,
    elements: &[T],
    is_valid: impl Fn(&T) -> bool,
    range: impl FnOnce() -> String,
) -> Check {
    let mut numbered = elements.iter().enumerate();
    match numbered.find(|(_, element)| !is_valid(element)) {
        Some((index, value)) => {
            let what = format!("{what} {index} of its mesh");
            Err(SceneError::value(what, value, range()))
        }
        None => Ok(()),
    }
}

/// An edge of a triangle from one corner to the next: both corners, the lower one first; and twice
/// the triangle's index, plus 1 if the edge goes from the higher to the lower corner.
type DirectedEdge = ([u32; 2], u32);

/// Checks that a mesh bounds a body: each edge belongs to two triangles, which traverse it in
/// opposite directions, and triangles are counterclockwise as seen from outside. Vertices at the
/// same position count as one, and triangles with fewer than three distinct vertices are ignored.
pub(super) fn check_closed(mesh: &Mesh) -> Check {
    let welded = welded(&mesh.positions);
    let mut edges: Vec<DirectedEdge> = Vec::with_capacity(3 * mesh.triangles.len());
    for (corners, triangle) in mesh.triangles.iter().zip(0u32..) {
        let [a, b, c] = corners.map(|corner| welded[corner as usize]);
        if a == b || b == c || c == a {
            continue;
        }
        edges.extend([(a, b), (b, c), (c, a)].map(|(from, to)| {
            let is_downwards = u32::from(from > to);
            ([from.min(to), from.max(to)], 2 * triangle + is_downwards)
        }));
    }
    edges.sort_unstable();
    let same_edge = |a: &DirectedEdge, b: &DirectedEdge| a.0 == b.0;
    let is_bad = |edge: &&[DirectedEdge]| {
        let directions =
            [0, 1].map(|direction| edge.iter().filter(|e| e.1 & 1 == direction).count());
        directions != [1, 1]
    };
    let bad = edges.chunk_by(same_edge).filter(is_bad);
    if let Some(edge) = bad.min_by_key(|edge| edge[0].1) {
        let ([low, high], first) = edge[0];
        let along = edge.iter().filter(|e| e.1 & 1 == first & 1).count();
        let (from, to) = if first & 1 == 0 {
            (low, high)
        } else {
            (high, low)
        };
        let [from, to] = [from, to].map(|vertex| mesh.positions[vertex as usize]);
        let (triangle, against) = (first / 2, edge.len() - along);
        return Err(SceneError::rule(format!(
            "its material is a dielectric, so its mesh must be closed, but of the edge from {from} to {to} of triangle \
             {triangle} there are {along} that way and {against} the other way: there must be one of each"
        )));
    }
    // The signed volumes (times 6) of the tetrahedra of all triangles and the origin add up to the
    // mesh's volume.
    let volumes = mesh.triangles.iter().map(|corners| {
        let [a, b, c] = corners.map(|corner| mesh.positions[corner as usize].as_dvec3());
        a.dot(b.cross(c))
    });
    require(volumes.sum::<f64>() > 0.0, || {
        SceneError::rule(
            "its material is a dielectric, but its mesh is inside out: let its triangles go round counterclockwise \
             as seen from outside",
        )
    })
}

/// For each vertex, the index of the first vertex at the same position.
fn welded(positions: &[Vec3]) -> Vec<u32> {
    // Adding 0 turns −0 into 0, whose bits differ.
    let place = |vertex: u32| {
        (positions[vertex as usize] + Vec3::ZERO)
            .to_array()
            .map(f32::to_bits)
    };
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    order.sort_unstable_by_key(|vertex| (place(*vertex), *vertex));
    let mut welded = vec![0; positions.len()];
    for same in order.chunk_by(|a, b| place(*a) == place(*b)) {
        for vertex in same {
            welded[*vertex as usize] = same[0];
        }
    }
    welded
}
