//! Triangles that emit, as light sampling draws points on them.
//!
//! A triangle is drawn in proportion to its power, area times mean emission, by a table of sums, so that neighbours in a mesh
//! are neighbours in the random number and its even distribution carries over to the surface; then a point uniform in its
//! area (Pharr, Jakob and Humphreys, "Physically Based Rendering", 4th edition, sections 12.4 and 6.5.2). A point's density is that of its
//! material alone, mean emission over the power of all: so what meets a triangle by chance knows it without a search.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::{
    AlphaTest, CompiledScene, CompiledTextures, KIND_METALLIC_ROUGHNESS, MaterialData,
    MaterialTextureData, TriangleData,
};

/// Triangles that emit, in the order of the scene's; those of an update's particles are not among them.
#[derive(Clone, Debug, Default)]
pub struct MeshLights {
    /// One each.
    pub triangles: Arc<Vec<MeshLightData>>,
    /// Probability with which light sampling aims at one of them, in sixteenths.
    pub sixteenths: u32,
    /// Area times mean emission, over the channels and all of them, W·sr⁻¹.
    pub power: f64,
}

/// A triangle that emits.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct MeshLightData {
    /// Index into [`super::CompiledMeshes::triangles`].
    pub triangle: u32,
    /// The probability of those before it.
    pub before: f32,
    /// Its own probability.
    pub probability: f32,
    /// 0.
    pub padding: u32,
}

/// A point on a triangle that emits, drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshLightPoint {
    /// Index of the triangle.
    pub triangle: u32,
    /// What its corners weigh.
    pub weights: [f32; 3],
    /// Probability of the triangle.
    pub probability: f32,
}

/// The most triangles that emit of a scene that light sampling aims at: with more the probability of one is less than
/// random numbers can tell, and all are found by chance.
pub const MESH_LIGHTS_MAX: usize = 1 << 20;
/// How far along a ray to a point on a triangle anything may be in the way: the rest is left to rounding.
pub const MESH_LIGHT_REACH: f32 = 1.0 - 1e-4;

impl MeshLights {
    /// Probability with which light sampling aims at one of them.
    pub fn probability(&self) -> f32 {
        self.sixteenths as f32 * (1.0 / 16.0)
    }

    /// Draws a point by two numbers in [0, 1).
    pub fn sample(&self, [u, v]: [f32; 2]) -> MeshLightPoint {
        let light = self.triangle(u);
        let within = ((u - light.before) / light.probability).clamp(0.0, 1.0);
        let root = within.sqrt();
        MeshLightPoint {
            triangle: light.triangle,
            weights: [1.0 - root, root * (1.0 - v), root * v],
            probability: light.probability,
        }
    }

    /// The triangle that a number in [0, 1) draws.
    pub(crate) fn triangle(&self, u: f32) -> &MeshLightData {
        let next = self.triangles.partition_point(|light| light.before <= u);
        &self.triangles[next.saturating_sub(1)]
    }
}

impl CompiledScene {
    /// Finds the triangles that emit, and how often light sampling aims at them beside others.
    pub(super) fn find_mesh_lights(&mut self) {
        let brightness: Vec<f64> = (0..self.materials.len())
            .map(|material| mean_emission(&self.materials[material], material, &self.textures))
            .collect();
        if brightness.iter().all(|mean| *mean == 0.0) {
            return;
        }
        let lights = self.meshes.triangles.iter().zip(0u32..);
        let powers = lights.filter_map(|(triangle, index)| {
            let power = brightness[triangle.material as usize] * area(triangle);
            (power > 0.0 && power.is_finite()).then_some((index, power))
        });
        let powers: Vec<(u32, f64)> = powers.take(MESH_LIGHTS_MAX + 1).collect();
        let power: f64 = powers.iter().map(|(_, power)| power).sum();
        if powers.is_empty() || powers.len() > MESH_LIGHTS_MAX || !power.is_finite() {
            return;
        }
        let mut sum = 0.0;
        let mut lights = Vec::with_capacity(powers.len());
        for (triangle, own) in powers {
            let before = (sum / power) as f32;
            sum += own;
            let probability = ((sum / power).min(1.0) as f32) - before;
            if probability > 0.0 {
                lights.push(MeshLightData {
                    triangle,
                    before,
                    probability,
                    padding: 0,
                });
            }
        }
        for (material, brightness) in self.materials.iter_mut().zip(brightness) {
            if material.kind == KIND_METALLIC_ROUGHNESS {
                material.majorant = (brightness / power) as f32;
            }
        }
        self.mesh_lights = MeshLights {
            triangles: Arc::new(lights),
            sixteenths: self.mesh_light_sixteenths(power),
            power,
        };
        let left = 1.0 - self.mesh_lights.probability();
        self.punctual_probability *= left;
        self.environment_map.probability *= left;
    }

    /// Half beside surroundings and lights without extent, whose power is told by the place alone; by power beside area lights;
    /// all without others.
    fn mesh_light_sixteenths(&self, power: f64) -> u32 {
        if self.punctual_probability > 0.0 || self.environment_map.probability > 0.0 {
            return 8;
        }
        let others = self.area_lights.iter().map(|light| {
            let area = 4.0 * f64::from(light.length_u) * f64::from(light.length_v);
            area * mean(light.radiance)
        });
        // Triangles shine to both sides.
        let share = 2.0 * power / (2.0 * power + others.sum::<f64>());
        match self.area_lights.is_empty() {
            true => 16,
            false => (16.0 * share).round().clamp(1.0, 15.0) as u32,
        }
    }

    /// Whether a material's emission depends on the place: by a texture, or by what its opacity leaves.
    pub(crate) fn emission_varies(&self, material: usize) -> bool {
        let data = &self.materials[material];
        let maps = self.textures.materials.get(material);
        let is_textured = maps.is_some_and(|maps| maps.emission != MaterialTextureData::NONE);
        data.kind == KIND_METALLIC_ROUGHNESS
            && data.k != [0.0; 3]
            && (is_textured || data.is_transparent())
    }

    /// What a point of a triangle emits of what its opacity leaves there, where corners have these weights.
    pub(crate) fn emission_at(&self, triangle: u32, weights: [f32; 3]) -> Vec3 {
        self.triangle_tables().emission(triangle, weights)
    }
}

impl AlphaTest<'_> {
    /// See [`CompiledScene::emission_at`].
    pub(crate) fn emission(&self, triangle: u32, weights: [f32; 3]) -> Vec3 {
        let data = &self.triangles[triangle as usize];
        let material = &self.materials[data.material as usize];
        let mut emission = Vec3::from(material.k);
        let maps = self.textures.materials.get(data.material as usize);
        if let (Some(maps), Some(uvs)) = (maps, self.uvs.get(data.uvs as usize))
            && maps.emission != MaterialTextureData::NONE
        {
            let [r, g, b, _] = self.textures.sample(maps.emission, uvs.at(weights), 0.0);
            emission *= Vec3::new(r, g, b);
        }
        emission * self.share_there(triangle, weights)
    }
}

/// The mean of a material's emission over the channels and its texture.
fn mean_emission(material: &MaterialData, index: usize, textures: &CompiledTextures) -> f64 {
    if material.kind != KIND_METALLIC_ROUGHNESS {
        return 0.0;
    }
    let maps = textures.materials.get(index);
    let map = maps.map_or(MaterialTextureData::NONE, |maps| maps.emission);
    if map == MaterialTextureData::NONE {
        return mean(material.k);
    }
    let [r, g, b, _] = textures.sample(map, [0.5; 2], f32::MAX);
    mean((Vec3::from(material.k) * Vec3::new(r, g, b)).to_array())
}

fn mean(channels: [f32; 3]) -> f64 {
    channels.into_iter().map(f64::from).sum::<f64>() / 3.0
}

/// Square metres.
fn area(triangle: &TriangleData) -> f64 {
    let [a, b, c] = triangle.corners().map(Vec3::as_dvec3);
    0.5 * (b - a).cross(c - a).length()
}
