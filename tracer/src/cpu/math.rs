//! Natural logarithm and exponential function, one argument per lane.

use fearless_simd::{i32x16, prelude::*};

use super::lanes::{Float, Word};

/// Natural logarithm of a normal number, within 2 ulp (Cephes' `logf`, Moshier 1992).
#[inline(always)]
pub(super) fn ln<S: Simd>(simd: S, x: Float<S>) -> Float<S> {
    let bits: Word<S> = x.bitcast();
    // x = mantissa · 2^exponent with the mantissa in [½, 1): the bias is one less than IEEE's 127.
    let exponent: i32x16<S> = (bits >> 23).bitcast();
    let exponent = exponent.to_float::<Float<S>>() - 126.0;
    let mantissa: Float<S> = ((bits & 0x007f_ffff) | 0x3f00_0000).bitcast();
    // The mantissa is brought to [√½, √2), centred on 1, so that logarithms of numbers near 1 keep their
    // relative accuracy.
    let low = mantissa.simd_lt(std::f32::consts::FRAC_1_SQRT_2);
    let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
    let exponent = exponent - low.select(one, zero);
    let m = mantissa + low.select(mantissa, zero) - one;
    let z = m * m;
    let y = m
        .mul_add(0.070_376_84, -0.115_146_1)
        .mul_add(m, 0.116_769_99)
        .mul_add(m, -0.124_201_41)
        .mul_add(m, 0.142_493_23)
        .mul_add(m, -0.166_680_58)
        .mul_add(m, 0.200_007_15)
        .mul_add(m, -0.249_999_94)
        .mul_add(m, 0.333_333_3);
    let y = y * m * z + exponent * -2.121_944_4e-4 - z * 0.5;
    // ln 2 = 0.693359375 − 2.12e-4: the larger part has few enough bits that its product with the
    // exponent is exact. Smaller terms are added first.
    m + y + exponent * 0.693_359_4
}

/// e^x for x ≤ 0, within 2 ulp (Cephes' `expf`); 0 where the result would be subnormal.
#[inline(always)]
pub(super) fn exp<S: Simd>(simd: S, x: Float<S>) -> Float<S> {
    let zero = Float::splat(simd, 0.0);
    let tiny = x.simd_lt(-87.0);
    let x = x.max(-87.0).min(zero);
    let n = (x * std::f32::consts::LOG2_E + 0.5).floor();
    // Cody and Waite's range reduction: 0.693359375 has 9 bits, so that its product with n is exact.
    let r = x - n * 0.693_359_4 - n * -2.121_944_4e-4;
    let y = r
        .mul_add(1.987_569_1e-4, 1.398_2e-3)
        .mul_add(r, 8.333_452e-3)
        .mul_add(r, 4.166_579_6e-2)
        .mul_add(r, 0.166_666_65)
        .mul_add(r, 0.5);
    let y = (y * r).mul_add(r, r + 1.0);
    let n: i32x16<S> = n.to_int();
    let n: Word<S> = n.bitcast();
    // 2ⁿ by its exponent bits: n ≥ −126, because x ≥ −87.
    let power: Float<S> = ((n + 127) << 23).bitcast();
    tiny.select(zero, y * power)
}

#[cfg(test)]
mod tests {

    use super::super::lanes::LANES;
    use super::*;
    use crate::simd::{Level, dispatch};

    #[inline(always)]
    fn both<S: Simd>(simd: S, x: [f32; LANES]) -> [[f32; LANES]; 2] {
        let x = Float::load_array(simd, x);
        [ln(simd, x).to_array(), exp(simd, x * -20.0).to_array()]
    }

    #[test]
    fn logarithm_and_exponential_are_within_their_bounds() {
        for start in (0..1 << 20).step_by(LANES) {
            let x: [f32; LANES] =
                std::array::from_fn(|lane| (start + lane + 1) as f32 / (1 << 20) as f32);
            let [ln, exp] = dispatch!(Level::new(), simd => both(simd, x));
            for lane in 0..LANES {
                let exact = f64::from(x[lane]).ln();
                let error = (f64::from(ln[lane]) - exact).abs();
                assert!(error <= 3e-7 * exact.abs().max(1e-6), "ln {}", x[lane]);
                let exact = (-20.0 * f64::from(x[lane])).exp();
                let error = (f64::from(exp[lane]) - exact).abs();
                // The argument's own rounding, an ulp of up to 20, is in it.
                assert!(error <= 3e-6 * exact, "exp {}", x[lane]);
            }
        }
    }
}
