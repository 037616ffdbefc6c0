//! Random numbers and sampling warps, one path per lane: the arithmetic of [`crate::sampling`].

use std::f32::consts::FRAC_PI_2;

use fearless_simd::{i32x16, prelude::*};

use super::lanes::{Float, Vec3x, Word};
use crate::sampling::{SCRAMBLE, pair_seeds};

/// Two numbers in [0, 1) per lane: [`crate::sampling::pair`], bit for bit.
#[inline(always)]
pub(super) fn pair<S: Simd>(
    pixel: Word<S>,
    sample: Word<S>,
    block: u32,
    seed: u32,
) -> [Float<S>; 2] {
    let seeds = pair_seeds(block, seed);
    let sample = reverse_bits(scramble(sample, seeds[0]));
    let x = sample ^ in_base_q(scramble(pixel, seeds[1]));
    let y = second_dimension(x);
    [
        unit_float(reverse_bits(scramble(x, seeds[2]))),
        unit_float(reverse_bits(scramble(y, seeds[3]))),
    ]
}

#[inline(always)]
fn scramble<S: Simd>(mut word: Word<S>, seed: u32) -> Word<S> {
    word ^= word * SCRAMBLE[0];
    word = (word + seed) * ((seed >> 16) | 1);
    word ^= word * SCRAMBLE[1];
    word ^ (word * SCRAMBLE[2])
}

#[inline(always)]
fn second_dimension<S: Simd>(mut x: Word<S>) -> Word<S> {
    x ^= (x & 0xaaaa_aaaa) >> 1;
    x ^= (x & 0xcccc_cccc) >> 2;
    x ^= (x & 0xf0f0_f0f0) >> 4;
    x ^= (x & 0xff00_ff00) >> 8;
    // The mask of the last step, 0xffff_0000, is implied by the shift.
    x ^ (x >> 16)
}

#[inline(always)]
fn in_base_q<S: Simd>(mut digits: Word<S>) -> Word<S> {
    let high = digits & 0xcccc_cccc;
    digits ^= (high >> 2) ^ (high >> 1);
    let high = digits & 0xf0f0_f0f0;
    digits ^= (high >> 4) ^ (high >> 2);
    let high = digits & 0xff00_ff00;
    digits ^= (high >> 8) ^ (high >> 4);
    let high = digits & 0xffff_0000;
    digits ^ (high >> 16) ^ (high >> 8)
}

#[inline(always)]
fn reverse_bits<S: Simd>(mut word: Word<S>) -> Word<S> {
    word = ((word >> 1) & 0x5555_5555) | ((word & 0x5555_5555) << 1);
    word = ((word >> 2) & 0x3333_3333) | ((word & 0x3333_3333) << 2);
    word = ((word >> 4) & 0x0f0f_0f0f) | ((word & 0x0f0f_0f0f) << 4);
    word = ((word >> 8) & 0x00ff_00ff) | ((word & 0x00ff_00ff) << 8);
    (word >> 16) | (word << 16)
}

/// The upper 24 bits as a number in [0, 1): signed conversion is exact there, and cheaper than unsigned.
#[inline(always)]
fn unit_float<S: Simd>(word: Word<S>) -> Float<S> {
    let bits: i32x16<S> = (word >> 8).bitcast();
    bits.to_float::<Float<S>>() * (1.0 / 16_777_216.0)
}

/// Sine and cosine of 2π · `turns` for `turns` in [0, 1], within 1.3e-7: the nearest multiple of a quarter
/// turn is subtracted exactly, and Taylor series cover the remaining ±π/4.
#[inline(always)]
pub(super) fn sin_cos_turns<S: Simd>(turns: Float<S>) -> (Float<S>, Float<S>) {
    // `turns · 4` and the difference below are exact in f32, unlike a reduction by multiples of 2π.
    let quarters = (turns * 4.0 + 0.5).floor();
    let angle = (turns * 4.0 - quarters) * FRAC_PI_2;
    let a2 = angle * angle;
    let sin = a2
        .mul_add(1.0 / 362_880.0, -1.0 / 5040.0)
        .mul_add(a2, 1.0 / 120.0)
        .mul_add(a2, -1.0 / 6.0);
    let sin = (sin * a2).mul_add(angle, angle);
    let cos = a2
        .mul_add(1.0 / 40_320.0, -1.0 / 720.0)
        .mul_add(a2, 1.0 / 24.0)
        .mul_add(a2, -0.5)
        .mul_add(a2, 1.0);
    // Quarters 1 and 3 swap sine and cosine; 2 and 3 negate the sine, 1 and 2 the cosine.
    let half = (quarters * 0.5).floor();
    let odd = (quarters - half * 2.0).simd_gt(0.5);
    let (sin, cos) = (odd.select(cos, sin), odd.select(sin, cos));
    let sin_turned = quarters.simd_gt(1.5) & quarters.simd_lt(3.5);
    let cos_turned = quarters.simd_gt(0.5) & quarters.simd_lt(2.5);
    (sin_turned.select(-sin, sin), cos_turned.select(-cos, cos))
}

/// Direction about the unit vector `n` with density cos θ / π.
#[inline(always)]
pub(super) fn cosine_hemisphere<S: Simd>(
    simd: S,
    n: Vec3x<S>,
    u1: Float<S>,
    u2: Float<S>,
) -> Vec3x<S> {
    let one = Float::splat(simd, 1.0);
    let (sin, cos) = sin_cos_turns(u2);
    let r = u1.sqrt();
    let (x, y) = (r * cos, r * sin);
    // Malley's method: uniform points on the disc, projected up to the hemisphere, have density cos θ / π.
    let z = (one - u1).max(0.0).sqrt();
    let (tangent, bitangent) = basis(simd, n);
    tangent.mul_add(x, bitangent.mul_add(y, n * z))
}

/// Two unit vectors that complete the unit vector `n` to an orthonormal basis: Duff et al.,
/// "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.
#[inline(always)]
pub(super) fn basis<S: Simd>(simd: S, n: Vec3x<S>) -> (Vec3x<S>, Vec3x<S>) {
    let one = Float::splat(simd, 1.0);
    // Comparison instead of the sign bit, so that −0 and 0 give the same basis.
    let sign = n.z.simd_ge(0.0).select(one, -one);
    let a = -one / (sign + n.z);
    let b = n.x * n.y * a;
    let tangent = Vec3x::new((sign * n.x * n.x).mul_add(a, one), sign * b, -(sign * n.x));
    let bitangent = Vec3x::new(b, (n.y * n.y).mul_add(a, sign), -n.y);
    (tangent, bitangent)
}

/// Directions drawn from a BSDF.
pub(super) struct BsdfSample<S: Simd> {
    pub(super) wi: Vec3x<S>,
    /// `f · cos θ / pdf`, including the probability of the lobe.
    pub(super) weight: Vec3x<S>,
    /// Density per solid angle; ∞ for specular directions, −∞ inside a body, 0 for a coat's mirror, whose
    /// area lights next-event estimation has added.
    pub(super) pdf: Float<S>,
}

/// Direction uniform on the sphere.
#[inline(always)]
pub(super) fn uniform_direction<S: Simd>(simd: S, u1: Float<S>, u2: Float<S>) -> Vec3x<S> {
    // Archimedes' theorem: heights of uniform directions are uniform.
    let z = Float::splat(simd, 1.0) - u1 * 2.0;
    let sine = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = sin_cos_turns(u2);
    Vec3x::new(sine * cos, sine * sin, z)
}

#[cfg(test)]
mod tests {

    use super::super::lanes::LANES;
    use super::*;
    use crate::sampling::sample_key;
    use crate::simd::{Level, dispatch};

    /// Sample index of the first lane; those of later lanes wrap around.
    const SAMPLE: u32 = u32::MAX - 7;

    #[inline(always)]
    fn drawn<S: Simd>(simd: S, pixel: u32, block: u32, seed: u32) -> [[f32; LANES]; 2] {
        let sample = Word::from_fn(simd, |lane| sample_key(SAMPLE.wrapping_add(lane as u32)));
        pair(Word::splat(simd, pixel), sample, block, seed).map(|u| u.to_array())
    }

    #[test]
    fn lanes_draw_what_the_scalar_code_draws() {
        for (pixel, block, seed) in [(0, 0, 0), (0x0123_4567, 11, u32::MAX), (u32::MAX, 3, 1)] {
            let got = dispatch!(Level::new(), simd => drawn(simd, pixel, block, seed));
            for lane in 0..LANES as u32 {
                let sample = sample_key(SAMPLE.wrapping_add(lane));
                let want = crate::sampling::pair(pixel, sample, block, seed);
                assert_eq!(got.map(|u| u[lane as usize]), want);
            }
        }
    }

    #[inline(always)]
    fn sin_cos<S: Simd>(simd: S, turns: [f32; LANES]) -> [[f32; LANES]; 2] {
        let (sin, cos) = sin_cos_turns(Float::load_array(simd, turns));
        [sin.to_array(), cos.to_array()]
    }

    #[test]
    fn sine_and_cosine_keep_their_bound() {
        const STEPS: usize = 1 << 20;
        let mut worst = 0.0f64;
        for start in (0..=STEPS).step_by(LANES) {
            let turns: [f32; LANES] =
                std::array::from_fn(|lane| (start + lane).min(STEPS) as f32 / STEPS as f32);
            let [sin, cos] = dispatch!(Level::new(), simd => sin_cos(simd, turns));
            for lane in 0..LANES {
                let angle = f64::from(turns[lane]) * std::f64::consts::TAU;
                worst = worst.max((f64::from(sin[lane]) - angle.sin()).abs());
                worst = worst.max((f64::from(cos[lane]) - angle.cos()).abs());
            }
        }
        assert!(worst < 1.3e-7, "{worst:e}");
    }
}
