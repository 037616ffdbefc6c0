//! Emissive surfaces for light sampling: spheres, discs, rectangles and triangles.
//!
//! A surface is drawn in proportion to its power, area times mean emission, by a cumulative table, so that
//! adjacent triangles of a mesh are adjacent in the random number and its stratification carries over to
//! the surface; then a point is drawn uniformly by area or, for a sphere, by the solid angle that it
//! subtends (Pharr, Jakob and Humphreys, "Physically Based Rendering", 4th edition, sections 12.4, 6.5.2
//! and 6.2.4). The density of a point by area depends on its material alone: mean emission over total
//! power. So the MIS weight at a hit needs no search of the table.

use std::f64::consts::PI;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::{
    AlphaTest, CompiledScene, CompiledTextures, KIND_METALLIC_ROUGHNESS, MaterialData,
    MaterialTextureData, Primitive, ShapeKind,
};

/// Emissive surfaces: spheres, discs and rectangles, then triangles, each in the order of the scene. Those
/// of an update's particles are not included.
#[derive(Clone, Debug, Default)]
pub struct EmissiveSurfaces {
    /// The table, in the order of the random number.
    pub surfaces: Arc<Vec<EmissiveSurfaceData>>,
    /// Probability with which light sampling chooses an emissive surface, in sixteenths.
    pub sixteenths: u32,
    /// Sum of area times mean emission of the channels, W·sr⁻¹.
    pub power: f64,
}

/// An emissive surface.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct EmissiveSurfaceData {
    /// Index into the array of its shape.
    pub index: u32,
    /// Sum of the probabilities of the surfaces before it.
    pub before: f32,
    /// Probability of the surface.
    pub probability: f32,
    /// Its [`ShapeKind`], as an integer.
    pub shape: u32,
}

/// Maximum number of emissive surfaces that are sampled: with more, single probabilities would be below the
/// resolution of the random numbers; all are found by BSDF sampling alone then.
pub const EMISSIVE_SURFACES_MAX: usize = 1 << 20;
/// Length of a shadow ray to an emissive surface, relative to the distance; the rest is slack for rounding.
pub const EMISSIVE_SURFACE_REACH: f32 = 1.0 - 1e-4;

impl EmissiveSurfaces {
    /// Probability with which light sampling chooses an emissive surface.
    pub fn probability(&self) -> f32 {
        self.sixteenths as f32 * (1.0 / 16.0)
    }

    /// Index of the surface that a number in [0, 1) selects.
    pub fn sample_index(&self, u: f32) -> usize {
        // The last surface whose interval begins at or below `u`.
        let next = self.surfaces.partition_point(|surface| surface.before <= u);
        next.saturating_sub(1)
    }

    /// The surfaces other than triangles, and the triangles.
    pub(crate) fn shapes_and_triangles(&self) -> (&[EmissiveSurfaceData], &[EmissiveSurfaceData]) {
        let is_shape = |surface: &EmissiveSurfaceData| surface.kind() != ShapeKind::Triangle;
        self.surfaces
            .split_at(self.surfaces.partition_point(is_shape))
    }
}

impl ShapeKind {
    /// Whether light sampling draws points on surfaces of the shape.
    pub(crate) fn is_light_sampled(self) -> bool {
        self.area_factor().is_some()
    }

    /// Area of a surface over that of the parallelogram of [`CompiledScene::emissive_corners`], or over the
    /// square of a sphere's radius; `None` for shapes that are found by BSDF sampling alone.
    pub(crate) const fn area_factor(self) -> Option<f64> {
        match self {
            Self::Sphere => Some(4.0 * PI),
            Self::Disc => Some(PI),
            Self::Rectangle => Some(1.0),
            Self::Triangle => Some(0.5),
            Self::Box | Self::CsgFace => None,
        }
    }
}

impl CompiledScene {
    /// Finds the emissive surfaces, and the probability with which light sampling chooses them.
    pub(super) fn find_emissive_surfaces(&mut self) {
        let brightness: Vec<f64> = (0..self.materials.len())
            .map(|material| mean_emission(&self.materials[material], material, &self.textures))
            .collect();
        if brightness.iter().all(|mean| *mean == 0.0) {
            return;
        }
        let candidates = self.emissive_candidates();
        let powers = candidates.filter_map(|(shape, index, material, unit_area)| {
            let power = brightness[material as usize] * (shape.area_factor()? * unit_area);
            (power > 0.0 && power.is_finite()).then_some((shape, index, power))
        });
        // One more than the maximum, to detect an excess without collecting all.
        let powers: Vec<(ShapeKind, u32, f64)> = powers.take(EMISSIVE_SURFACES_MAX + 1).collect();
        let power: f64 = powers.iter().map(|(.., power)| power).sum();
        if powers.is_empty() || powers.len() > EMISSIVE_SURFACES_MAX || !power.is_finite() {
            return;
        }
        let fluxes = powers.iter().map(|(shape, _, power)| match shape {
            ShapeKind::Sphere => *power,
            // Flat shapes emit on both sides.
            _ => 2.0 * power,
        });
        let flux = fluxes.sum();
        let mut sum = 0.0;
        let mut surfaces = Vec::with_capacity(powers.len());
        for (shape, index, own) in powers {
            let before = (sum / power) as f32;
            sum += own;
            // Difference of rounded sums, where the next interval begins too, so that intervals adjoin.
            // Those that rounding leaves empty can never be drawn and are omitted.
            let probability = ((sum / power).min(1.0) as f32) - before;
            if probability > 0.0 {
                surfaces.push(EmissiveSurfaceData {
                    index,
                    before,
                    probability,
                    shape: shape as u32,
                });
            }
        }
        for (material, brightness) in self.materials.iter_mut().zip(brightness) {
            if material.kind == KIND_METALLIC_ROUGHNESS {
                material.sampling_density = (brightness / power) as f32;
            }
        }
        self.emissive_surfaces = EmissiveSurfaces {
            surfaces: Arc::new(surfaces),
            sixteenths: self.emissive_surface_sixteenths(flux),
            power,
        };
        let left = 1.0 - self.emissive_surfaces.probability();
        self.punctual_probability *= left;
        self.environment_map.probability *= left;
    }

    /// Primitives of the shapes that light sampling supports: shape, index, material, and the unit area
    /// that [`ShapeKind::area_factor`] multiplies, m².
    fn emissive_candidates(&self) -> impl Iterator<Item = (ShapeKind, u32, u32, f64)> {
        let spheres = self.spheres.iter().zip(0..).map(|(sphere, index)| {
            let unit_area = f64::from(sphere.radius).powi(2);
            (ShapeKind::Sphere, index, sphere.material, unit_area)
        });
        let discs = self.discs.iter().zip(0..).map(|(disc, index)| {
            let unit_area = f64::from(disc.radius).powi(2);
            (ShapeKind::Disc, index, disc.material, unit_area)
        });
        let rectangles = self.rectangles.iter().zip(0..).map(|(rectangle, index)| {
            let [u, v] = [rectangle.half_u, rectangle.half_v].map(Vec3::from);
            let unit_area = 4.0 * u.as_dvec3().cross(v.as_dvec3()).length();
            (ShapeKind::Rectangle, index, rectangle.material, unit_area)
        });
        let triangles = self.meshes.triangles.iter().zip(0..);
        let triangles = triangles.map(|(triangle, index)| {
            let [a, b, c] = triangle.corners().map(Vec3::as_dvec3);
            let unit_area = (b - a).cross(c - a).length();
            (ShapeKind::Triangle, index, triangle.material, unit_area)
        });
        spheres.chain(discs).chain(rectangles).chain(triangles)
    }

    /// Probability in sixteenths: one half beside environment maps and punctual lights, whose irradiance
    /// depends on the point; by power beside area lights; 1 without other lights. `flux` is the total
    /// emitted flux over π.
    fn emissive_surface_sixteenths(&self, flux: f64) -> u32 {
        if self.punctual_probability > 0.0 || self.environment_map.probability > 0.0 {
            return 8;
        }
        let others = self.area_lights.iter().map(|light| {
            let area = 4.0 * f64::from(light.length_u) * f64::from(light.length_v);
            area * mean(light.radiance)
        });
        // Fluxes over π: area times mean radiance of Lambertian emitters.
        let share = flux / (flux + others.sum::<f64>());
        match self.area_lights.is_empty() {
            true => 16,
            false => (16.0 * share).round().clamp(1.0, 15.0) as u32,
        }
    }

    /// Whether the emission of a material varies over surfaces: by a texture or by opacity.
    pub(crate) fn emission_varies(&self, material: usize) -> bool {
        let data = &self.materials[material];
        let maps = self.textures.materials.get(material);
        let is_textured = maps.is_some_and(|maps| maps.emission != MaterialTextureData::NONE);
        data.kind == KIND_METALLIC_ROUGHNESS
            && data.k != [0.0; 3]
            && (is_textured || data.is_transparent())
    }

    /// Emission at a point of a surface with these corner weights, for a triangle scaled by its opacity
    /// there.
    pub(crate) fn emission_at(&self, surface: &EmissiveSurfaceData, weights: [f32; 3]) -> Vec3 {
        match surface.kind() {
            ShapeKind::Triangle => self.triangle_tables().emission(surface.index, weights),
            _ => (self.material_of(surface.primitive()))
                .map_or(Vec3::ZERO, |material| Vec3::from(material.k)),
        }
    }

    /// Corners of the parallelogram on which points of a surface are drawn, the first adjacent to both
    /// others: of a triangle its own; of a rectangle three; of a disc its centre and two points on its rim
    /// at right angles. Of a sphere its centre, and its radius as x of the second.
    pub(crate) fn emissive_corners(&self, surface: &EmissiveSurfaceData) -> [Vec3; 3] {
        let index = surface.index as usize;
        match surface.kind() {
            ShapeKind::Sphere => {
                let sphere = &self.spheres[index];
                [
                    Vec3::from(sphere.center),
                    sphere.radius * Vec3::X,
                    Vec3::ZERO,
                ]
            }
            ShapeKind::Disc => {
                let disc = &self.discs[index];
                let center = Vec3::from(disc.center);
                // Adding 0 turns −0 into 0, for which the basis is another.
                let (t, b) = (Vec3::from(disc.normal) + Vec3::ZERO).any_orthonormal_pair();
                [center, center + disc.radius * t, center + disc.radius * b]
            }
            ShapeKind::Rectangle => {
                let rectangle = &self.rectangles[index];
                let [center, u, v] =
                    [rectangle.center, rectangle.half_u, rectangle.half_v].map(Vec3::from);
                [center - u - v, center + u - v, center - u + v]
            }
            _ => self.meshes.triangles[index].corners(),
        }
    }
}

impl EmissiveSurfaceData {
    /// Its shape.
    pub fn kind(&self) -> ShapeKind {
        ShapeKind::ALL[self.shape as usize]
    }

    /// Its primitive.
    pub fn primitive(&self) -> Primitive {
        self.kind().primitive(self.index)
    }
}

impl AlphaTest<'_> {
    /// Emission at a point of a triangle, scaled by its opacity there.
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

/// Mean of a material's emission over channels and texture.
fn mean_emission(material: &MaterialData, index: usize, textures: &CompiledTextures) -> f64 {
    if material.kind != KIND_METALLIC_ROUGHNESS {
        return 0.0;
    }
    let maps = textures.materials.get(index);
    let map = maps.map_or(MaterialTextureData::NONE, |maps| maps.emission);
    if map == MaterialTextureData::NONE {
        return mean(material.k);
    }
    mean((Vec3::from(material.k) * textures.mean(map)).to_array())
}

fn mean(channels: [f32; 3]) -> f64 {
    channels.into_iter().map(f64::from).sum::<f64>() / 3.0
}
