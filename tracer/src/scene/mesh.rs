//! Triangle meshes.

use glam::{Quat, Vec2, Vec3, Vec4};
use serde::{Deserialize, Serialize};

use super::{Shape, bounded};

/// Triangles that share vertices, seen from both sides.
///
/// With vertex normals a surface is shaded as if its normal were interpolated between them; what rays meet
/// stays flat ([`crate::scalar::triangle`]). A triangle without area is never met.
///
/// A mesh of a dielectric bounds a body: each edge belongs to two triangles, which go along it in opposite directions
/// and round counterclockwise as seen from outside. Vertices in the same place count as one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mesh {
    /// Vertices in the mesh's own frame, in metres; at most [`super::validate::VERTICES_MAX`].
    #[serde(deserialize_with = "bounded::positions")]
    pub positions: Vec<Vec3>,
    /// Three indices into `positions` each; at most [`super::validate::TRIANGLES_MAX`] in a scene. Which way
    /// round they go matters for dielectrics alone.
    #[serde(deserialize_with = "bounded::triangles")]
    pub triangles: Vec<[u32; 3]>,
    /// A normal for each position, of any length but 0, on the side of the surface that is outside; or none at
    /// all, for facets.
    #[serde(default, deserialize_with = "bounded::normals")]
    pub normals: Vec<Vec3>,
    /// Texture coordinates for each position, within ±[`super::validate::UV_MAX`], or none at all: (0, 0) is the top left
    /// corner of a texture, (1, 1) its bottom right one.
    #[serde(default, deserialize_with = "bounded::uvs")]
    pub uvs: Vec<Vec2>,
    /// A colour for each position, or none at all: red, green and blue, linear, which multiply the albedo of the material, and
    /// alpha, which its [`super::Opacity`] may use, each in [0, 1].
    #[serde(default, deserialize_with = "bounded::colors")]
    pub colors: Vec<Vec4>,
    /// Where the mesh's own origin lies, in metres.
    #[serde(default)]
    pub center: Vec3,
    /// `world_from_mesh`, a unit quaternion (x, y, z, w).
    #[serde(default)]
    pub rotation: Quat,
}

impl Mesh {
    /// Facets, with their own origin at that of the world. A mesh that breaks a rule is refused with its
    /// scene.
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

    /// Shaded with a normal for each position.
    #[must_use]
    pub fn normals(self, normals: Vec<Vec3>) -> Self {
        Self { normals, ..self }
    }

    /// With texture coordinates for each position.
    #[must_use]
    pub fn uvs(self, uvs: Vec<Vec2>) -> Self {
        Self { uvs, ..self }
    }

    /// With a colour for each position.
    #[must_use]
    pub fn colors(self, colors: Vec<Vec4>) -> Self {
        Self { colors, ..self }
    }

    /// With its own origin here, in metres.
    #[must_use]
    pub fn at(self, center: impl Into<Vec3>) -> Self {
        let center = center.into();
        Self { center, ..self }
    }

    /// Turned by `world_from_mesh`, a unit quaternion.
    #[must_use]
    pub fn rotated(self, rotation: Quat) -> Self {
        Self { rotation, ..self }
    }

    /// Enlarged round its own origin by a factor along each of its axes.
    #[must_use]
    pub fn scaled(mut self, factor: impl Into<Vec3>) -> Self {
        let factor = factor.into();
        for position in &mut self.positions {
            *position *= factor;
        }
        // Normals of a surface go with the inverse transpose, whose scale is of no matter.
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
