//! Free flight through what fills dielectrics, a lane each: the arithmetic of [`crate::scalar::medium`].

use fearless_simd::prelude::*;

use super::lanes::{Float, Mask, Vec3x, Word};
use super::math::{exp, ln};
use super::microfacet::{ETA_OR_EXTINCTION, K_OR_SCATTERING, MicrofacetRow, SAMPLING_DENSITY};
use super::rows::Rows;

/// A free flight through what fills a dielectric: how far, and the weight of what is left.
pub(super) struct FreeFlight<S: Simd> {
    /// Scattered before the boundary.
    pub(super) scattered: Mask<S>,
    pub(super) distance: Float<S>,
    pub(super) weight: Vec3x<S>,
}

impl<S: Simd> FreeFlight<S> {
    /// Towards a boundary at `distance`, for the lanes of `within`; the others keep their light.
    #[inline(always)]
    pub(super) fn new(
        simd: S,
        table: &[MicrofacetRow],
        id: Word<S>,
        within: Mask<S>,
        distance: Float<S>,
        u: Float<S>,
    ) -> Self {
        let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
        let rows = Rows::new(table, id);
        let rate = rows.number(simd, SAMPLING_DENSITY);
        // 1 − u is at least 2⁻²⁴, as `ln` asks. Without a medium the rate is 0 and the quotient ∞ or NaN;
        // neither counts as scattered below.
        let sampled = -ln(simd, one - u) / rate;
        let scattered = within & rate.simd_gt(0.0) & sampled.simd_lt(distance);
        let distance = scattered.select(sampled, distance);
        // Distances are drawn by the least extinction of the three channels, so that what is left of each
        // over the density, exp(−(σt − rate) d), never exceeds 1 and all channels share a path.
        let beyond = rows.triple(simd, ETA_OR_EXTINCTION) - Vec3x::new(rate, rate, rate);
        let left = beyond * -distance;
        let left = Vec3x::new(exp(simd, left.x), exp(simd, left.y), exp(simd, left.z));
        let unscattered = Vec3x::new(one, one, one);
        let weight = Vec3x::select(scattered, rows.triple(simd, K_OR_SCATTERING), unscattered);
        let weight = weight.scale(left);
        Self {
            scattered,
            distance: distance.max(zero),
            weight: Vec3x::select(within, weight, unscattered),
        }
    }
}
