//! Fresnel reflectance of dielectrics, one angle per lane.

use fearless_simd::prelude::*;

use super::lanes::Float;

/// [`crate::fresnel::fresnel_dielectric`].
#[inline(always)]
pub(super) fn fresnel<S: Simd>(simd: S, cos_theta: Float<S>, eta: Float<S>) -> Float<S> {
    let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
    let cos_i = cos_theta.max(zero).min(one);
    // Under total internal reflection (eta < 1) the clamp to 0 makes both terms ±1, a reflectance of 1.
    let cos_t = (one - (one - cos_i * cos_i) / (eta * eta)).max(zero).sqrt();
    let parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    let perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let mean = parallel.mul_add(parallel, perpendicular * perpendicular) * 0.5;
    // 0 / 0 above for an index of 1 at grazing incidence: there is no interface.
    (cos_i + cos_t).simd_gt(0.0).select(mean, zero)
}
