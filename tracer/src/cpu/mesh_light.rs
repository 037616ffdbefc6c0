//! Triangles that emit, a lane each: [`crate::compiled::MeshLights`] says how they are drawn.

use fearless_simd::prelude::*;

use super::lanes::{Float, LANES, Mask, Vec3x};
use super::triangle::TriangleTables;
use super::triangle_surface::interpolate;
use crate::CompiledScene;
use crate::compiled::{MESH_LIGHT_REACH, MeshLights};

/// The triangles of a scene that emit, and all that tells what of them is seen.
pub(super) struct MeshLightSampler {
    lights: MeshLights,
    surfaces: TriangleTables,
    /// Emission depends on the place on some of them.
    emission_varies: bool,
}

impl MeshLightSampler {
    /// None without any.
    pub(super) fn new(scene: &CompiledScene) -> Option<Self> {
        (scene.mesh_lights.sixteenths > 0).then(|| Self {
            lights: scene.mesh_lights.clone(),
            surfaces: TriangleTables::new(scene),
            emission_varies: (0..scene.materials.len()).any(|index| scene.emission_varies(index)),
        })
    }

    /// With which light sampling aims at them.
    pub(super) fn probability(&self) -> f32 {
        self.lights.probability()
    }

    /// Draws a point for each of `lanes`; no light comes in the others. Out of line: scenes without are not to pay for it.
    #[inline(never)]
    pub(super) fn sample<S: Simd>(
        &self,
        simd: S,
        lanes: Mask<S>,
        point: Vec3x<S>,
        u: [Float<S>; 2],
    ) -> MeshLightSample<S> {
        let drawn = self.draw(lanes.to_bitmask(), u[0].to_array());
        simd.vectorize(
            #[inline(always)]
            || {
                let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
                let before = Float::load_array(simd, drawn.before);
                let probability = Float::load_array(simd, drawn.probability);
                let within = ((u[0] - before) / probability).max(zero).min(one);
                let root = within.sqrt();
                let weights = [one - root, root * (one - u[1]), root * u[1]];
                let corners = [
                    Vec3x::load_arrays(simd, &drawn.corners[0]),
                    Vec3x::load_arrays(simd, &drawn.corners[1]),
                    Vec3x::load_arrays(simd, &drawn.corners[2]),
                ];
                let across = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                let twice_area = across.length_squared().sqrt();
                let to_light = interpolate(corners, weights) - point;
                let distance2 = to_light.length_squared();
                let distance = distance2.sqrt();
                let wi = to_light * (one / distance);
                let cosine = (wi.dot(across) / twice_area).abs();
                // Triangles without area and points on their own plane bring nothing: 0 / 0.
                let is_seen = lanes & cosine.simd_gt(0.0) & distance.simd_gt(0.0);
                let per_angle = cosine / (distance2 * self.probability());
                let emission = match self.emission_varies {
                    true => self.emission(simd, lanes, &drawn.triangles, weights),
                    false => Vec3x::load_arrays(simd, &drawn.emission),
                };
                let radiance = emission * (0.5 * twice_area * per_angle / probability);
                let point_density = Float::load_array(simd, drawn.point_density);
                let forward = Vec3x::splat(simd, [0.0, 0.0, 1.0]);
                let black = Vec3x::splat(simd, [0.0; 3]);
                MeshLightSample {
                    wi: Vec3x::select(is_seen, wi, forward),
                    distance: is_seen.select(distance * MESH_LIGHT_REACH, zero),
                    inverse_density: is_seen.select(per_angle / point_density, zero),
                    radiance: Vec3x::select(is_seen, radiance, black),
                }
            },
        )
    }

    /// A triangle for each of `lanes`, by a number in [0, 1).
    #[inline(always)]
    fn draw(&self, lanes: u64, u: [f32; LANES]) -> DrawnTriangles {
        let tables = self.surfaces.alpha_test();
        let mut drawn = DrawnTriangles {
            triangles: [0; LANES],
            corners: [[[0.0; LANES]; 3]; 3],
            emission: [[0.0; LANES]; 3],
            point_density: [0.0; LANES],
            before: [0.0; LANES],
            probability: [0.0; LANES],
        };
        for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
            let light = self.lights.triangle(u[lane]);
            let data = &tables.triangles[light.triangle as usize];
            let material = &tables.materials[data.material as usize];
            drawn.triangles[lane] = light.triangle;
            for axis in 0..3 {
                drawn.corners[0][axis][lane] = data.a[axis];
                drawn.corners[1][axis][lane] = data.b[axis];
                drawn.corners[2][axis][lane] = data.c[axis];
                drawn.emission[axis][lane] = material.k[axis];
            }
            drawn.point_density[lane] = material.majorant;
            drawn.before[lane] = light.before;
            drawn.probability[lane] = light.probability;
        }
        drawn
    }

    /// What each lane's triangle emits where corners have these weights.
    #[inline(never)]
    fn emission<S: Simd>(
        &self,
        simd: S,
        lanes: Mask<S>,
        triangles: &[u32; LANES],
        weights: [Float<S>; 3],
    ) -> Vec3x<S> {
        let tables = self.surfaces.alpha_test();
        let weights = weights.map(Float::<S>::to_array);
        let mut columns = [[0.0; LANES]; 3];
        let bits = lanes.to_bitmask();
        for lane in (0..LANES).filter(|lane| bits >> lane & 1 == 1) {
            let emission = tables.emission(triangles[lane], weights.map(|weight| weight[lane]));
            for (column, channel) in columns.iter_mut().zip(emission.to_array()) {
                column[lane] = channel;
            }
        }
        Vec3x::load_arrays(simd, &columns)
    }
}

/// Triangles that emit, drawn for each lane.
struct DrawnTriangles {
    triangles: [u32; LANES],
    /// By corner and axis.
    corners: [[[f32; LANES]; 3]; 3],
    /// By channel; where emission varies, its factor.
    emission: [[f32; LANES]; 3],
    /// With which light sampling draws a point of the triangle, m⁻².
    point_density: [f32; LANES],
    /// Probability of the triangles before it in the table.
    before: [f32; LANES],
    /// Its own probability.
    probability: [f32; LANES],
}

/// Points on triangles that emit, as directions to them.
pub(super) struct MeshLightSample<S: Simd> {
    pub(super) wi: Vec3x<S>,
    /// As far as anything may be in the way; 0 where no light comes.
    pub(super) distance: Float<S>,
    /// Of the density that the power heuristic takes, per solid angle among all directions to light.
    pub(super) inverse_density: Float<S>,
    /// What emits, over the density with which it was drawn.
    pub(super) radiance: Vec3x<S>,
}
