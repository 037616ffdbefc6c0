//! The rules that triangle meshes keep.

use glam::{Vec2, Vec3, Vec4};

use super::{COORDINATE_M_MAX, Check, UV_MAX, count, position, rotation};
use crate::SceneError;
use crate::scene::{Mesh, Scene, Shape};

/// The most triangles in a scene: they, their vertex normals and their BVH take at most 1.5 GB of a node's memory
/// a back end.
pub const TRIANGLES_MAX: usize = 10_000_000;
/// The most vertices in a mesh: no triangle shares one with another.
pub const VERTICES_MAX: usize = 3 * TRIANGLES_MAX;

/// Counts the triangles of all meshes.
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
    if mesh.triangles.is_empty() {
        return Err(SceneError::NoTriangles(vertices));
    }
    // In the world a coordinate is at most the distance from the mesh's own origin beyond its centre.
    let reach_max = COORDINATE_M_MAX - mesh.center.abs().max_element();
    let mut positions = mesh.positions.iter().enumerate();
    // NaN is not within.
    let is_within = |p: &Vec3| p.length() <= reach_max;
    if let Some((index, &value)) = positions.find(|(_, p)| !is_within(p)) {
        let max = COORDINATE_M_MAX;
        return Err(SceneError::Vertex { index, value, max });
    }
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|vertex| **vertex as usize >= vertices) {
            return Err(SceneError::VertexIndex {
                triangle,
                vertex,
                vertices,
            });
        }
    }
    check_normals(mesh)?;
    check_uvs(mesh)?;
    check_colors(mesh)
}

fn check_normals(mesh: &Mesh) -> Check {
    let (normals, vertices) = (mesh.normals.len(), mesh.positions.len());
    if normals != 0 && normals != vertices {
        return Err(SceneError::VertexNormals { normals, vertices });
    }
    let mut normals = mesh.normals.iter().enumerate();
    let is_direction = |n: &Vec3| n.is_finite() && n.as_dvec3().length_squared() > 0.0;
    match normals.find(|(_, normal)| !is_direction(normal)) {
        Some((index, &value)) => Err(SceneError::VertexNormal { index, value }),
        None => Ok(()),
    }
}

fn check_uvs(mesh: &Mesh) -> Check {
    let (uvs, vertices) = (mesh.uvs.len(), mesh.positions.len());
    if uvs != 0 && uvs != vertices {
        return Err(SceneError::TextureCoordinates { uvs, vertices });
    }
    let mut uvs = mesh.uvs.iter().enumerate();
    // NaN is not within.
    let is_within = |uv: &Vec2| uv.abs().cmple(Vec2::splat(UV_MAX)).all();
    match uvs.find(|(_, uv)| !is_within(uv)) {
        Some((index, &value)) => Err(SceneError::TextureCoordinate {
            index,
            value,
            max: UV_MAX,
        }),
        None => Ok(()),
    }
}

fn check_colors(mesh: &Mesh) -> Check {
    let (colors, vertices) = (mesh.colors.len(), mesh.positions.len());
    if colors != 0 && colors != vertices {
        return Err(SceneError::VertexColors { colors, vertices });
    }
    let mut colors = mesh.colors.iter().enumerate();
    // NaN is not within.
    let is_within = |c: &Vec4| c.cmpge(Vec4::ZERO).all() && c.cmple(Vec4::ONE).all();
    match colors.find(|(_, color)| !is_within(color)) {
        Some((index, &value)) => Err(SceneError::VertexColor { index, value }),
        None => Ok(()),
    }
}

/// An edge of a triangle from one corner to the next: both corners, the lower first, and twice the triangle's index,
/// and one more where the edge goes from the higher to the lower.
type DirectedEdge = ([u32; 2], u32);

/// Checks that a mesh bounds a body: each edge belongs to two triangles, which go along it in opposite directions, and
/// they go round counterclockwise as seen from outside. Vertices in the same place count as one, and triangles between
/// fewer than three places as none.
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
        return Err(SceneError::OpenMesh {
            triangle: (first / 2) as usize,
            from: mesh.positions[from as usize],
            to: mesh.positions[to as usize],
            along,
            against: edge.len() - along,
        });
    }
    let volumes = mesh.triangles.iter().map(|corners| {
        let [a, b, c] = corners.map(|corner| mesh.positions[corner as usize].as_dvec3());
        a.dot(b.cross(c))
    });
    match volumes.sum::<f64>() > 0.0 {
        true => Ok(()),
        false => Err(SceneError::InwardMesh),
    }
}

/// For each vertex the first in the same place.
fn welded(positions: &[Vec3]) -> Vec<u32> {
    // A sum with 0 makes −0 the same place as 0.
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
