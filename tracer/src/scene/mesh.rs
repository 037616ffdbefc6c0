//! Triangle meshes.

use glam::{Quat, Vec2, Vec3, Vec4};
use serde::{Deserialize, Serialize};

use super::{Shape, bounded};

/// Triangles that share vertices, visible from both sides.
///
/// With vertex normals a surface is shaded with interpolated normals, but its geometry stays flat
/// ([`crate::scalar::triangle`]). Triangles without area are never hit.
///
/// A mesh with a dielectric material bounds a body: each edge must belong to two triangles, which
/// traverse it in opposite directions, and triangles must be counterclockwise as seen from outside.
/// Vertices at the same position count as one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mesh {
    /// Vertices in object space, in metres; at most [`super::validate::VERTICES_MAX`].
    #[serde(deserialize_with = "bounded::positions")]
    pub positions: Vec<Vec3>,
    /// Three indices into `positions` each; at most [`super::validate::TRIANGLES_MAX`] in a scene.
    /// Winding matters only for dielectrics.
    #[serde(deserialize_with = "bounded::triangles")]
    pub triangles: Vec<[u32; 3]>,
    /// A normal for each position, of any length but 0, on the outer side of the surface; or none,
    /// for flat shading.
    #[serde(default, deserialize_with = "bounded::normals")]
    pub normals: Vec<Vec3>,
    /// Texture coordinates for each position, within ±[`super::validate::UV_MAX`], or none: (0, 0)
    /// is the top left corner of a texture, (1, 1) its bottom right one.
    #[serde(default, deserialize_with = "bounded::uvs")]
    pub uvs: Vec<Vec2>,
    /// A linear colour for each position, or none: red, green and blue multiply the material's
    /// albedo, alpha may be used by its [`super::Opacity`]; each in [0, 1].
    #[serde(default, deserialize_with = "bounded::colors")]
    pub colors: Vec<Vec4>,
    /// Position of the mesh's origin in metres.
    #[serde(default)]
    pub center: Vec3,
    /// Rotation from object to world space, a unit quaternion (x, y, z, w).
    #[serde(default)]
    pub rotation: Quat,
}

impl Mesh {
    /// A mesh without normals at the origin. The rules for meshes are checked with the scene.
    pub fn new(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        Self {
            positions,
            triangles,
            normals: Vec::new(),
            uvs: Vec::new(),
            colors: Vec::new(),
            center: Vec3::ZERO,
            rotation: Quat::IDENTITY,
        }
    }

    /// Sets a normal for each position.
    #[must_use]
    pub fn normals(self, normals: Vec<Vec3>) -> Self {
        Self { normals, ..self }
    }

    /// Sets texture coordinates for each position.
    #[must_use]
    pub fn uvs(self, uvs: Vec<Vec2>) -> Self {
        Self { uvs, ..self }
    }

    /// Sets a colour for each position.
    #[must_use]
    pub fn colors(self, colors: Vec<Vec4>) -> Self {
        Self { colors, ..self }
    }

    /// Sets the position of the mesh's origin in metres.
    #[must_use]
    pub fn at(self, center: impl Into<Vec3>) -> Self {
        let center = center.into();
        Self { center, ..self }
    }

    /// Sets the rotation from object to world space, a unit quaternion.
    #[must_use]
    pub fn rotated(self, rotation: Quat) -> Self {
        Self { rotation, ..self }
    }

    /// Scales the mesh about its origin, by a factor along each of its axes.
    #[must_use]
    pub fn scaled(mut self, factor: impl Into<Vec3>) -> Self {
        let factor = factor.into();
        for position in &mut self.positions {
            *position *= factor;
        }
        // Normals transform by the inverse transpose, of which the cofactors are a multiple; their
        // length does not matter.
        let cofactor = Vec3::new(
            factor.y * factor.z,
            factor.z * factor.x,
            factor.x * factor.y,
        );
        for normal in &mut self.normals {
            *normal *= cofactor;
        }
        self
    }
}

impl From<Mesh> for Shape {
    fn from(mesh: Mesh) -> Self {
        Self::Mesh(mesh)
    }
}
