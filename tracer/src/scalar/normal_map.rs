//! Normal maps, and lookup of the textures on a triangle.

use glam::{DVec2, DVec3};

use super::ray::vector;
use crate::CompiledScene;
use crate::compiled::{MaterialTextureData, Primitive, TriangleData, TriangleUvs};

/// Normal from the material's normal map, or the unit normal `n_out` without one. Normal maps are sampled
/// at the finest level: averaged normals describe another surface.
pub(super) fn mapped_normal(
    scene: &CompiledScene,
    index: u32,
    barycentric: [f64; 3],
    n_out: DVec3,
) -> DVec3 {
    let Some((textures, triangle, uvs)) = textures_at(scene, Primitive::Triangle(index)) else {
        return n_out;
    };
    let map = NormalMap {
        image: textures.normal,
        scale: textures.normal_scale,
    };
    map.normal(scene, triangle, uvs, barycentric, n_out)
}

/// A normal map, and the scale of its x and y.
pub(super) struct NormalMap {
    pub(super) image: u32,
    pub(super) scale: f32,
}

impl NormalMap {
    /// See [`mapped_normal`].
    pub(super) fn normal(
        &self,
        scene: &CompiledScene,
        triangle: &TriangleData,
        uvs: &TriangleUvs,
        barycentric: [f64; 3],
        n_out: DVec3,
    ) -> DVec3 {
        if self.image == MaterialTextureData::NONE {
            return n_out;
        }
        let uv = interpolate(uvs, barycentric);
        let [x, y, z, _] = scene.textures.sample(self.image, uv, 0.0);
        let [x, y, z] = [x, y, z].map(|share| 2.0 * f64::from(share) - 1.0);
        let scale = f64::from(self.scale);
        let (x, y) = (scale * x, scale * y);
        let Some([tangent, bitangent]) = tangents(triangle, uvs, n_out) else {
            return n_out;
        };
        let mapped = x * tangent + y * bitangent + z * n_out;
        mapped.try_normalize().unwrap_or(n_out)
    }
}

/// Unit tangents to `n`: along increasing u and, orthogonal to it, along decreasing v. `None` where the
/// texture coordinates of a triangle span no area.
fn tangents(triangle: &TriangleData, uvs: &TriangleUvs, n: DVec3) -> Option<[DVec3; 2]> {
    let [a, b, c] = [triangle.a, triangle.b, triangle.c].map(vector);
    let [ta, tb, tc] = [uvs.a, uvs.b, uvs.c].map(|uv| DVec2::from(uv.map(f64::from)));
    let (edge_b, edge_c, uv_b, uv_c) = (b - a, c - a, tb - ta, tc - ta);
    // Solution of a 2×2 system, times the sign of the determinant instead of divided by it: only directions
    // matter.
    let turn = uv_b.perp_dot(uv_c).signum();
    let along_u = turn * (uv_c.y * edge_b - uv_b.y * edge_c);
    let along_v = turn * (uv_b.x * edge_c - uv_c.x * edge_b);
    let tangent = (along_u - n * n.dot(along_u)).try_normalize()?;
    let across = n.cross(tangent);
    // In glTF v points down in the image, the y of a normal map up.
    let side = if across.dot(along_v) > 0.0 { -1.0 } else { 1.0 };
    Some([tangent, side * across])
}

/// Textures of a primitive's material, if it is a triangle with textures, and the triangle.
pub(super) fn textures_at(
    scene: &CompiledScene,
    primitive: Primitive,
) -> Option<(&MaterialTextureData, &TriangleData, &TriangleUvs)> {
    let Primitive::Triangle(index) = primitive else {
        return None;
    };
    let triangle = &scene.meshes.triangles[index as usize];
    let textures = scene.textures.materials.get(triangle.material as usize)?;
    let uvs = scene.meshes.uvs.get(triangle.uvs as usize)?;
    Some((textures, triangle, uvs))
}

/// Texture coordinates at these barycentric coordinates.
pub(super) fn interpolate(uvs: &TriangleUvs, weights: [f64; 3]) -> [f32; 2] {
    let corners = [uvs.a, uvs.b, uvs.c];
    std::array::from_fn(|axis| {
        let terms = corners.iter().zip(weights);
        terms
            .map(|(corner, weight)| f64::from(corner[axis]) * weight)
            .sum::<f64>() as f32
    })
}
