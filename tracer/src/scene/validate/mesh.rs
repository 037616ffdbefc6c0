//! The rules that triangle meshes keep.

use glam::{Vec2, Vec3};

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
    check_uvs(mesh)
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
