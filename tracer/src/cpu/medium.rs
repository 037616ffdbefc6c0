//! Free flight through the interior of dielectrics, one path per lane: the arithmetic of
//! [`crate::scalar::medium`].

use fearless_simd::prelude::*;

use super::lanes::{Float, Mask, Vec3x, Word};
use super::math::{exp, ln};
use super::microfacet::{ETA_OR_EXTINCTION, K_OR_SCATTERING, MicrofacetRow, SAMPLING_DENSITY};
use super::rows::Rows;

/// Result of a free flight: distance and weight.
pub(super) struct FreeFlight<S: Simd> {
    /// Lanes that are scattered before the boundary.
    pub(super) scattered: Mask<S>,
    /// Distance to the scattering event or the boundary, metres.
    pub(super) distance: Float<S>,
    /// Factor of the throughput: transmittance, and scattering coefficient if scattered, over the density.
    pub(super) weight: Vec3x<S>,
}

impl<S: Simd> FreeFlight<S> {
    /// Samples flights towards a boundary at `distance` in the lanes of `within`; the others have weight 1.
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
        // 1 − u is at least 2⁻²⁴, as `ln` requires. Without scattering the rate is 0 and the quotient ∞ or
        // NaN; `rate > 0` excludes both below.
        let sampled = -ln(simd, one - u) / rate;
        let scattered = within & rate.simd_gt(0.0) & sampled.simd_lt(distance);
        let distance = scattered.select(sampled, distance);
        // Distances are drawn by the smallest extinction of the channels, so that exp(−(σt − rate) d), the
        // ratio of transmittance to density, is at most 1 and all channels share a path.
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
