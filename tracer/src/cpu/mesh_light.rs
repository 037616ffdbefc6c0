//! Triangles that emit, a lane each: [`crate::compiled::MeshLights`] says how they are drawn.

use fearless_simd::prelude::*;
use glam::Vec3;

use super::lanes::{Float, LANES, Mask, Vec3x};
use super::triangle::TriangleTables;
use crate::CompiledScene;
use crate::compiled::{MESH_LIGHT_REACH, MeshLights};

/// The triangles of a scene that emit, and all that tells what of them is seen.
pub(super) struct MeshLightSampler {
    lights: MeshLights,
    surfaces: TriangleTables,
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

impl MeshLightSampler {
    /// None without any.
    pub(super) fn new(scene: &CompiledScene) -> Option<Self> {
        (scene.mesh_lights.sixteenths > 0).then(|| Self {
            lights: scene.mesh_lights.clone(),
            surfaces: TriangleTables::new(scene),
        })
    }

    /// With which light sampling aims at them.
    pub(super) fn probability(&self) -> f32 {
        self.lights.probability()
    }

    /// Draws a point for each of `lanes`. Out of line: scenes without are not to pay for it.
    #[inline(never)]
    pub(super) fn sample<S: Simd>(
        &self,
        simd: S,
        lanes: Mask<S>,
        point: Vec3x<S>,
        u: [Float<S>; 2],
    ) -> MeshLightSample<S> {
        let points = [point.x.to_array(), point.y.to_array(), point.z.to_array()];
        let u = [u[0].to_array(), u[1].to_array()];
        let mut columns = [[0.0; LANES]; 8];
        columns[2] = [1.0; LANES];
        let bits = lanes.to_bitmask();
        for lane in (0..LANES).filter(|lane| bits >> lane & 1 == 1) {
            let point = Vec3::from(points.map(|column| column[lane]));
            if let Some(numbers) = self.sample_lane(point, u.map(|column| column[lane])) {
                for (column, number) in columns.iter_mut().zip(numbers) {
                    column[lane] = number;
                }
            }
        }
        let number = |column: usize| Float::load_array(simd, columns[column]);
        MeshLightSample {
            wi: Vec3x::new(number(0), number(1), number(2)),
            distance: number(3),
            inverse_density: number(4),
            radiance: Vec3x::new(number(5), number(6), number(7)),
        }
    }

    /// The numbers of a [`MeshLightSample`] in order.
    fn sample_lane(&self, point: Vec3, u: [f32; 2]) -> Option<[f32; 8]> {
        let chosen = self.lights.sample(u);
        let surfaces = self.surfaces.alpha_test();
        let triangle = &surfaces.triangles[chosen.triangle as usize];
        let [a, b, c] = triangle.corners();
        let [wa, wb, wc] = chosen.weights;
        let across = (b - a).cross(c - a);
        let twice_area = across.length();
        let to_light = wa * a + wb * b + wc * c - point;
        let distance2 = to_light.length_squared();
        let distance = distance2.sqrt();
        let wi = to_light / distance;
        let cosine = (wi.dot(across) / twice_area).abs();
        // Written so that triangles without area and points on their own plane bring nothing.
        if !(cosine > 0.0 && distance > 0.0) {
            return None;
        }
        let material = &surfaces.materials[triangle.material as usize];
        let probability = self.probability();
        let inverse_density = cosine / (material.majorant * probability * distance2);
        let inverse_pdf =
            0.5 * twice_area * cosine / (distance2 * (chosen.probability * probability));
        let emission = surfaces.emission(chosen.triangle, chosen.weights) * inverse_pdf;
        let [x, y, z] = wi.to_array();
        let [r, g, b] = emission.to_array();
        let reach = distance * MESH_LIGHT_REACH;
        Some([x, y, z, reach, inverse_density, r, g, b])
    }
}
