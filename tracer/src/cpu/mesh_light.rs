//! Triangles that emit, a lane each: [`crate::compiled::MeshLights`] says how they are drawn.

use fearless_simd::prelude::*;

use super::lanes::{Float, LANES, Mask, Vec3x};
use super::triangle::TriangleTables;
use crate::CompiledScene;
use crate::compiled::{MESH_LIGHT_REACH, MeshLights};

/// The triangles of a scene that emit, and all that tells what of them is seen.
pub(super) struct MeshLightSampler {
    lights: MeshLights,
    surfaces: TriangleTables,
    /// Some emit more in one place than in another: by a texture, or by what their opacity leaves.
    has_pattern: bool,
}

impl MeshLightSampler {
    /// None without any.
    pub(super) fn new(scene: &CompiledScene) -> Option<Self> {
        (scene.mesh_lights.sixteenths > 0).then(|| Self {
            lights: scene.mesh_lights.clone(),
            surfaces: TriangleTables::new(scene),
            has_pattern: (0..scene.materials.len()).any(|material| scene.has_pattern(material)),
        })
    }

    /// With which light sampling aims at them.
    pub(super) fn probability(&self) -> f32 {
        self.lights.probability()
    }

    /// Draws a point for each of `lanes`; the others' numbers mean nothing. Out of line: scenes without are not to pay for it.
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
                let number = |column: usize| Float::load_array(simd, drawn.numbers[column]);
                let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
                let own = number(PROBABILITY);
                let within = ((u[0] - number(BEFORE)) / own).max(zero).min(one);
                let root = within.sqrt();
                let weights = [one - root, root * (one - u[1]), root * u[1]];
                let a = Vec3x::new(number(0), number(1), number(2));
                let b = Vec3x::new(number(3), number(4), number(5));
                let c = Vec3x::new(number(6), number(7), number(8));
                let across = (b - a).cross(c - a);
                let twice_area = across.length_squared().sqrt();
                let to_light = a.mul_add(weights[0], b.mul_add(weights[1], c * weights[2])) - point;
                let distance2 = to_light.length_squared();
                let distance = distance2.sqrt();
                let wi = to_light * (one / distance);
                let cosine = (wi.dot(across) / twice_area).abs();
                // Triangles without area and points on their own plane bring nothing: 0 / 0.
                let is_seen = lanes & cosine.simd_gt(0.0) & distance.simd_gt(0.0);
                let per_angle = cosine / (distance2 * self.probability());
                let mut radiance =
                    Vec3x::new(number(EMISSION), number(EMISSION + 1), number(EMISSION + 2));
                if self.has_pattern {
                    radiance = self.radiance(simd, lanes, &drawn.triangles, weights);
                }
                let forward = Vec3x::splat(simd, [0.0, 0.0, 1.0]);
                let black = Vec3x::splat(simd, [0.0; 3]);
                let radiance = radiance * (0.5 * twice_area * per_angle / own);
                MeshLightSample {
                    wi: Vec3x::select(is_seen, wi, forward),
                    distance: is_seen.select(distance * MESH_LIGHT_REACH, zero),
                    inverse_density: is_seen.select(per_angle / number(POINT_DENSITY), zero),
                    radiance: Vec3x::select(is_seen, radiance, black),
                }
            },
        )
    }

    /// The triangles by a number each, as [`MeshLights::sample`] draws them.
    #[inline(always)]
    fn draw(&self, lanes: u64, u: [f32; LANES]) -> DrawnTriangles {
        let tables = self.surfaces.alpha_test();
        let mut drawn = DrawnTriangles {
            numbers: [[0.0; LANES]; COLUMNS],
            triangles: [0; LANES],
        };
        for (lane, u) in u.into_iter().enumerate() {
            if lanes >> lane & 1 == 0 {
                continue;
            }
            let light = self.lights.triangle(u);
            let data = &tables.triangles[light.triangle as usize];
            let material = &tables.materials[data.material as usize];
            let corners = [data.a, data.b, data.c];
            let others = [material.majorant, light.before, light.probability];
            let numbers = corners
                .as_flattened()
                .iter()
                .chain(&material.k)
                .chain(&others);
            for (column, number) in drawn.numbers.iter_mut().zip(numbers) {
                column[lane] = *number;
            }
            drawn.triangles[lane] = light.triangle;
        }
        drawn
    }

    /// What each lane's triangle emits where corners have these weights.
    #[inline(never)]
    fn radiance<S: Simd>(
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
        let [r, g, b] = columns.map(|column| Float::load_array(simd, column));
        Vec3x::new(r, g, b)
    }
}

/// Triangles by lane.
struct DrawnTriangles {
    /// Corners, then what the constants below say.
    numbers: [[f32; LANES]; COLUMNS],
    triangles: [u32; LANES],
}

const EMISSION: usize = 9;
/// With which light sampling draws a point, m⁻².
const POINT_DENSITY: usize = 12;
/// The probability of the triangles before it.
const BEFORE: usize = 13;
const PROBABILITY: usize = 14;
const COLUMNS: usize = 15;

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
