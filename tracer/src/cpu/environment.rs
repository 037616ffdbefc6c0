//! Environment lighting, one direction per lane: the arithmetic of [`crate::scalar::environment`].

use std::f32::consts::{FRAC_1_PI, PI};

use fearless_simd::prelude::*;

use super::area_light::argument;
use super::lanes::{Float, LANES, Mask, Vec3x};
use super::sampling::sin_cos_turns;
use crate::CompiledScene;
use crate::compiled::CompiledEnvironment;

/// Environment of a scene: an environment map or a constant radiance.
pub(super) struct Environment {
    /// Radiance from every direction if there is no map, W·sr⁻¹·m⁻².
    constant: [f32; 3],
    map: Option<CompiledEnvironment>,
}

/// Directions sampled from the environment map.
pub(super) struct EnvironmentSample<S: Simd> {
    pub(super) wi: Vec3x<S>,
    /// Reciprocal of the density of `wi` per solid angle, including the probability of choosing the map.
    pub(super) inverse_density: Float<S>,
    pub(super) radiance: Vec3x<S>,
}

/// Solid angle per unit of the map's parameter square, divided by the sine of the colatitude.
const SQUARE_TO_SPHERE: f32 = 2.0 * PI * PI;

impl Environment {
    pub(super) fn new(scene: &CompiledScene) -> Self {
        let map = &scene.environment_map;
        Self {
            constant: scene.environment.to_array(),
            map: (!map.is_empty()).then(|| map.clone()),
        }
    }

    /// Probability with which light sampling chooses the environment; 0 without a map.
    pub(super) fn probability(&self) -> f32 {
        self.map.as_ref().map_or(0.0, |map| map.probability)
    }

    /// Whether it emits no light.
    pub(super) fn is_black(&self) -> bool {
        self.map.is_none() && self.constant == [0.0; 3]
    }

    /// Radiance from `direction`; unspecified in lanes outside `lanes` if there is a map.
    #[inline(always)]
    pub(super) fn radiance<S: Simd>(
        &self,
        simd: S,
        direction: Vec3x<S>,
        lanes: Mask<S>,
    ) -> Vec3x<S> {
        match &self.map {
            None => Vec3x::splat(simd, self.constant),
            Some(map) => seen(simd, map, direction, lanes).0,
        }
    }

    /// [`Environment::radiance`] times the MIS weight beside light sampling. `pdf` is the density of the
    /// direction per solid angle; 0 or ∞ where light sampling could not have drawn it, which gives weight
    /// 1.
    #[inline(always)]
    pub(super) fn radiance_with_mis<S: Simd>(
        &self,
        simd: S,
        direction: Vec3x<S>,
        lanes: Mask<S>,
        pdf: impl FnOnce() -> Float<S>,
    ) -> Vec3x<S> {
        let Some(map) = &self.map else {
            return Vec3x::splat(simd, self.constant);
        };
        let (radiance, density) = seen(simd, map, direction, lanes);
        let pdf = pdf();
        let is_found = pdf.simd_gt(0.0) & pdf.simd_lt(f32::INFINITY);
        let one = Float::splat(simd, 1.0);
        // Power heuristic.
        let ratio = density / is_found.select(pdf, one);
        let weight = one / ratio.mul_add(ratio, one);
        radiance * is_found.select(weight, one)
    }

    /// Draws a direction in each lane; `None` without a map.
    #[inline(always)]
    pub(super) fn sample<S: Simd>(
        &self,
        simd: S,
        u: [Float<S>; 2],
    ) -> Option<EnvironmentSample<S>> {
        Some(sample(simd, self.map.as_ref()?, u))
    }
}

/// Radiance from `direction`, and its density per solid angle under light sampling, including the
/// probability of choosing the map. Not inlined, so that scenes without a map do not pay for its code.
#[inline(never)]
fn seen<S: Simd>(
    simd: S,
    map: &CompiledEnvironment,
    direction: Vec3x<S>,
    lanes: Mask<S>,
) -> (Vec3x<S>, Float<S>) {
    simd.vectorize(
        #[inline(always)]
        || {
            let Vec3x { x, y, z } = direction;
            let sine = x.mul_add(x, y * y).sqrt();
            // Equirectangular projection; the azimuth is measured from +y towards +x.
            let across = argument(simd, y, x) * (0.5 * FRAC_1_PI) + (0.5 + map.turn);
            let across = (across - across.floor()).to_array();
            let down = (argument(simd, z, sine) * FRAC_1_PI).to_array();
            let mut columns = [[0.0; LANES]; 4];
            let mut bits = lanes.to_bitmask();
            while bits != 0 {
                let lane = bits.trailing_zeros() as usize % LANES;
                bits &= bits - 1;
                let uv = [across[lane], down[lane]];
                let [r, g, b] = map.radiance(uv);
                for (column, value) in columns.iter_mut().zip([r, g, b, map.density(uv)]) {
                    column[lane] = value;
                }
            }
            let [r, g, b, density] = columns.map(|column| Float::load_array(simd, column));
            // ∞ at the poles, where a whole row of the map is one direction: the MIS weight becomes 0.
            let density = density * map.probability / (sine * SQUARE_TO_SPHERE);
            (Vec3x::new(r, g, b), density)
        },
    )
}

#[inline(never)]
fn sample<S: Simd>(simd: S, map: &CompiledEnvironment, u: [Float<S>; 2]) -> EnvironmentSample<S> {
    simd.vectorize(
        #[inline(always)]
        || {
            let (u, v) = (u[0].to_array(), u[1].to_array());
            let mut columns = [[0.0; LANES]; 6];
            for lane in 0..LANES {
                let drawn = map.sample([u[lane], v[lane]]);
                let [r, g, b] = map.radiance(drawn.uv);
                let values = [drawn.uv[0], drawn.uv[1], drawn.density, r, g, b];
                for (column, value) in columns.iter_mut().zip(values) {
                    column[lane] = value;
                }
            }
            let [across, down, density, r, g, b] =
                columns.map(|column| Float::load_array(simd, column));
            let turns = across - (0.5 + map.turn);
            let (sin_azimuth, cos_azimuth) = sin_cos_turns(turns - turns.floor());
            let (sine, cosine) = sin_cos_turns(down * 0.5);
            EnvironmentSample {
                wi: Vec3x::new(sine * sin_azimuth, sine * cos_azimuth, cosine),
                inverse_density: sine.max(0.0) * SQUARE_TO_SPHERE / (density * map.probability),
                radiance: Vec3x::new(r, g, b),
            }
        },
    )
}
