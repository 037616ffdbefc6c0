//! Opacity: stochastic alpha tests of rays against triangles.

use glam::Vec3;

use super::{
    CompiledScene, CompiledTextures, KIND_METALLIC_ROUGHNESS, MaterialData, MaterialTextureData,
    OPACITY_MASK, OPACITY_OPAQUE, TriangleColors, TriangleData, TriangleUvs,
};
use crate::sampling::{pcg4d, unit_float};

/// Tables for alpha tests and emission of triangles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AlphaTest<'a> {
    pub(crate) materials: &'a [MaterialData],
    pub(crate) triangles: &'a [TriangleData],
    pub(crate) uvs: &'a [TriangleUvs],
    pub(crate) colors: &'a [TriangleColors],
    pub(crate) textures: &'a CompiledTextures,
}

impl MaterialData {
    /// Whether rays may pass through it.
    pub(crate) fn is_transparent(&self) -> bool {
        self.kind == KIND_METALLIC_ROUGHNESS && self.sights[2] != OPACITY_OPAQUE
    }
}

impl CompiledScene {
    /// Tables for alpha tests; `None` if all triangles are opaque.
    pub(crate) fn alpha_test(&self) -> Option<AlphaTest<'_>> {
        let has_some = self.materials.iter().any(MaterialData::is_transparent);
        let has_some = has_some && !self.meshes.triangles.is_empty();
        has_some.then(|| self.triangle_tables())
    }

    /// Tables for opacity and emission at points of triangles.
    pub(super) fn triangle_tables(&self) -> AlphaTest<'_> {
        AlphaTest {
            materials: &self.materials,
            triangles: &self.meshes.triangles,
            uvs: &self.meshes.uvs,
            colors: &self.meshes.colors,
            textures: &self.textures,
        }
    }
}

impl AlphaTest<'_> {
    /// Whether a ray hits a triangle at the point with these barycentric coordinates.
    ///
    /// The random number is a hash of ray and triangle (as in Pharr, Jakob and Humphreys, "Physically
    /// Based Rendering", 4th edition, section 7.1.1), so that all tests of the same ray agree, in any
    /// order of traversal. Shadow rays use the same stochastic test: the product of all layers'
    /// transmittances would require a traversal of every layer, where this ends at the first that is hit.
    pub(crate) fn is_met(
        &self,
        origin: Vec3,
        direction: Vec3,
        triangle: u32,
        weights: impl FnOnce() -> [f32; 3],
    ) -> bool {
        let data = &self.triangles[triangle as usize];
        let material = &self.materials[data.material as usize];
        if !material.is_transparent() {
            return true;
        }
        let share = self.share_there(triangle, weights());
        share >= 1.0 || ray_number(origin, direction, triangle) < share
    }

    /// Probability with which a ray hits a triangle at the point with these barycentric coordinates.
    pub(super) fn share_there(&self, triangle: u32, weights: [f32; 3]) -> f32 {
        let data = &self.triangles[triangle as usize];
        let material = &self.materials[data.material as usize];
        let [_, cutoff, mode] = material.sights;
        if !material.is_transparent() {
            return 1.0;
        }
        let alpha = self.alpha(data, material, triangle, weights);
        match mode == OPACITY_MASK {
            true => f32::from(alpha >= cutoff),
            false => alpha,
        }
    }

    fn alpha(
        &self,
        data: &TriangleData,
        material: &MaterialData,
        triangle: u32,
        weights: [f32; 3],
    ) -> f32 {
        let mut alpha = material.sights[0];
        if let Some(colors) = self.colors.get(triangle as usize) {
            alpha *= colors.at(weights).w;
        }
        let maps = self.textures.materials.get(data.material as usize);
        if let (Some(maps), Some(uvs)) = (maps, self.uvs.get(data.uvs as usize))
            && maps.base_color != MaterialTextureData::NONE
        {
            let uv = uvs.at(weights);
            // Always the finest level: the test does not know whether a ray is a camera ray, and all tests
            // of the same ray must agree.
            let [.., of_texture] = self.textures.sample(maps.base_color, uv, 0.0);
            alpha *= of_texture;
        }
        alpha
    }
}

impl TriangleUvs {
    /// Texture coordinates at these barycentric coordinates.
    pub(super) fn at(&self, [wa, wb, wc]: [f32; 3]) -> [f32; 2] {
        [0, 1].map(|axis| wa * self.a[axis] + wb * self.b[axis] + wc * self.c[axis])
    }
}

/// Barycentric coordinates of a ray's intersection with a triangle: Möller and Trumbore, "Fast, Minimum
/// Storage Ray-Triangle Intersection", JGT 2(1), 1997.
pub(crate) fn corner_weights(triangle: &TriangleData, origin: Vec3, direction: Vec3) -> [f32; 3] {
    let [a, b, c] = triangle.corners();
    let (edge_b, edge_c, from_a) = (b - a, c - a, origin - a);
    let across = direction.cross(edge_c);
    let inverse = 1.0 / edge_b.dot(across);
    let (wb, wc) = (
        from_a.dot(across) * inverse,
        direction.dot(from_a.cross(edge_b)) * inverse,
    );
    [1.0 - wb - wc, wb, wc]
}

/// Hash of a ray and a triangle to a number in [0, 1).
fn ray_number(origin: Vec3, direction: Vec3, triangle: u32) -> f32 {
    let [ox, oy, oz] = origin.to_array().map(f32::to_bits);
    let [dx, dy, dz] = direction.to_array().map(f32::to_bits);
    let [x, y, z, w] = pcg4d([ox, oy, oz, triangle]);
    // The hash takes four words; the direction is mixed in by a second round.
    let [number, ..] = pcg4d([x ^ dx, y ^ dy, z ^ dz, w]);
    unit_float(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// For rays that differ in the last bits only, as those of one pixel do.
    #[test]
    fn numbers_of_neighbouring_rays_are_even_and_independent() {
        let numbers = |triangle: u32| {
            (0..40_000_u32).map(move |i| {
                let direction = Vec3::new(1e-6 * i as f32, 1.0, 1e-6);
                f64::from(ray_number(Vec3::X, direction, triangle)) - 0.5
            })
        };
        let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / 40_000.0;
        // Four standard errors of 40,000 numbers.
        assert!(mean(&mut numbers(0)).abs() < 0.006);
        assert!((mean(&mut numbers(1).map(|u| u * u)) - 1.0 / 12.0).abs() < 0.0016);
        let next = numbers(0).zip(numbers(0).skip(1)).map(|(a, b)| a * b);
        assert!(mean(&mut { next }).abs() < 0.0017);
        let other = numbers(0).zip(numbers(1)).map(|(a, b)| a * b);
        assert!(mean(&mut { other }).abs() < 0.0017);
    }
}
