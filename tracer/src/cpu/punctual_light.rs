//! Punctual lights, one shading point per lane: the arithmetic of [`crate::scalar::punctual_light`].

use fearless_simd::prelude::*;

use super::lanes::{Float, Vec3x};
use crate::compiled::PunctualLightData;
use crate::sampling::BELOW_1;

/// Irradiance at shading points from sampled punctual lights, over the sampling probability.
pub(super) struct PunctualIncidence<S: Simd> {
    pub(super) wi: Vec3x<S>,
    /// Distance, metres; 0 where no light arrives.
    pub(super) distance: Float<S>,
    pub(super) irradiance: Vec3x<S>,
}

/// Draws a light for each point in proportion to its irradiance there. Not inlined, so that scenes without
/// punctual lights do not pay for the code.
#[inline(never)]
pub(super) fn sample_punctual_light<S: Simd>(
    simd: S,
    lights: &[PunctualLightData],
    point: Vec3x<S>,
    u: Float<S>,
) -> PunctualIncidence<S> {
    simd.vectorize(
        #[inline(always)]
        || {
            let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
            let black = Vec3x::new(zero, zero, zero);
            let (mut u, mut sum, mut chosen_weight) = (u, zero, one);
            let mut chosen = PunctualIncidence {
                wi: Vec3x::new(zero, zero, one),
                distance: zero,
                irradiance: black,
            };
            for light in lights {
                let next = incidence(simd, light, point);
                let irradiance = next.irradiance;
                let weight = irradiance.x + irradiance.y + irradiance.z;
                let seen = weight.simd_gt(0.0);
                let before = sum;
                sum += seen.select(weight, zero);
                // Weighted reservoir of one (Chao 1982) with a single random number: light n replaces the
                // chosen one with probability w/Σw, and u is rescaled to be uniform within the branch
                // taken.
                let at = u * sum;
                let taken = seen & at.simd_ge(before);
                let part = taken.select(at - before, at)
                    / taken.select(weight, before.max(f32::MIN_POSITIVE));
                u = seen.select(part.min(BELOW_1 as f32), u);
                chosen.wi = Vec3x::select(taken, next.wi, chosen.wi);
                chosen.distance = taken.select(next.distance, chosen.distance);
                chosen.irradiance = Vec3x::select(taken, irradiance, chosen.irradiance);
                chosen_weight = taken.select(weight, chosen_weight);
            }
            chosen.irradiance = chosen.irradiance * (sum / chosen_weight);
            chosen
        },
    )
}

#[inline(always)]
fn incidence<S: Simd>(simd: S, light: &PunctualLightData, point: Vec3x<S>) -> PunctualIncidence<S> {
    let direction = Vec3x::splat(simd, light.direction);
    let strength = Vec3x::splat(simd, light.strength);
    if light.is_distant == 1 {
        return PunctualIncidence {
            wi: -direction,
            distance: Float::splat(simd, f32::MAX),
            irradiance: strength,
        };
    }
    let to_light = Vec3x::splat(simd, light.center) - point;
    let distance = to_light.length_squared().sqrt();
    let per_metre = 1.0 / distance;
    let wi = to_light * per_metre;
    let cone = (-wi.dot(direction) * light.cone_scale + light.cone_offset)
        .max(0.0)
        .min(1.0);
    let share = cone * per_metre;
    PunctualIncidence {
        wi,
        distance,
        irradiance: strength * (share * share),
    }
}
