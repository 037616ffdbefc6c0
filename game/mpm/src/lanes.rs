//! SIMD arithmetic with one particle a lane: 3x3 matrices, exponential and logarithm.

use fearless_simd::{f32x16, i32x16, prelude::*};

/// Particles processed at once: one AVX-512 register of `f32`, two of AVX2.
pub(crate) const LANES: usize = 16;

/// One `f32` a lane.
pub(crate) type Lanes<S> = f32x16<S>;

/// One 3x3 matrix a lane, indexed by row and column.
#[derive(Clone, Copy)]
pub(crate) struct Mat3x<S: Simd>(pub(crate) [[Lanes<S>; 3]; 3]);

/// The values of a function at 0, 1 and 2. Unlike `array::from_fn` it is always inlined: a function that is
/// not inlined is compiled without the target features of `dispatch!`, and each SIMD operation in it
/// becomes a call.
#[inline(always)]
pub(crate) fn each<T>(mut value: impl FnMut(usize) -> T) -> [T; 3] {
    [value(0), value(1), value(2)]
}

impl<S: Simd> Mat3x<S> {
    #[inline(always)]
    pub(crate) fn from_fn(mut entry: impl FnMut(usize, usize) -> Lanes<S>) -> Self {
        Self([
            [entry(0, 0), entry(0, 1), entry(0, 2)],
            [entry(1, 0), entry(1, 1), entry(1, 2)],
            [entry(2, 0), entry(2, 1), entry(2, 2)],
        ])
    }

    #[inline(always)]
    pub(crate) fn identity(simd: S) -> Self {
        let (one, zero) = (Lanes::splat(simd, 1.0), Lanes::splat(simd, 0.0));
        Self([[one, zero, zero], [zero, one, zero], [zero, zero, one]])
    }

    /// Loads nine arrays of lanes, the entries in row-major order.
    #[inline(always)]
    pub(crate) fn load(simd: S, entries: &[[f32; LANES]; 9]) -> Self {
        Self::from_fn(
            #[inline(always)]
            |row, column| Lanes::load_array_ref(simd, &entries[3 * row + column]),
        )
    }

    #[inline(always)]
    pub(crate) fn store(&self, entries: &mut [[f32; LANES]; 9]) {
        for row in 0..3 {
            for column in 0..3 {
                self.0[row][column].store_array(&mut entries[3 * row + column]);
            }
        }
    }

    #[inline(always)]
    pub(crate) fn mul(&self, rhs: &Self) -> Self {
        Self::from_fn(
            #[inline(always)]
            |i, j| dot(self.0[i], rhs.column(j)),
        )
    }

    /// `self · diag(values)`.
    #[inline(always)]
    pub(crate) fn scale_columns(&self, values: [Lanes<S>; 3]) -> Self {
        Self::from_fn(
            #[inline(always)]
            |i, j| self.0[i][j] * values[j],
        )
    }

    #[inline(always)]
    pub(crate) fn column(&self, j: usize) -> [Lanes<S>; 3] {
        [self.0[0][j], self.0[1][j], self.0[2][j]]
    }

    #[inline(always)]
    pub(crate) fn determinant(&self) -> Lanes<S> {
        let [a, b, c] = self.0;
        let cross = [
            b[1] * c[2] - b[2] * c[1],
            b[2] * c[0] - b[0] * c[2],
            b[0] * c[1] - b[1] * c[0],
        ];
        dot(a, cross)
    }

    #[inline(always)]
    pub(crate) fn trace(&self) -> Lanes<S> {
        self.0[0][0] + self.0[1][1] + self.0[2][2]
    }
}

#[inline(always)]
pub(crate) fn dot<S: Simd>(a: [Lanes<S>; 3], b: [Lanes<S>; 3]) -> Lanes<S> {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// eˣ with a relative error below 2e-7; x is clamped to -87..=88, where results are normal numbers.
#[inline(always)]
pub(crate) fn exp<S: Simd>(x: Lanes<S>) -> Lanes<S> {
    let simd = x.simd;
    let splat = |value: f32| Lanes::splat(simd, value);
    let x = x.max(splat(-87.0)).min(splat(88.0));
    let exponent = (x * splat(std::f32::consts::LOG2_E)).round_ties_even();
    // rest = x − exponent · ln 2 (Cody and Waite): ln 2 is split into a part of few bits, whose product
    // with the exponent is exact, and a correction.
    let rest = exponent.mul_add(splat(-0.693_359_4), x);
    let rest = exponent.mul_add(splat(2.121_944_4e-4), rest);
    // Taylor's series up to the seventh power: |rest| ≤ ½ ln 2, so the next term is below 6e-9.
    let mut series = splat(1.0 / 5040.0);
    for divisor in [720.0, 120.0, 24.0, 6.0, 2.0, 1.0, 1.0] {
        series = series.mul_add(rest, splat(1.0 / divisor));
    }
    let bits: i32x16<S> = exponent.to_int::<i32x16<S>>();
    // 2^exponent, assembled as the exponent bits of an f32, whose bias is 127.
    let power = ((bits + 127) << 23).bitcast::<f32x16<S>>();
    series * power
}

/// Natural logarithm of positive normal numbers, with an absolute or relative error below 2e-7, whichever
/// is larger.
#[inline(always)]
pub(crate) fn ln<S: Simd>(x: Lanes<S>) -> Lanes<S> {
    let simd = x.simd;
    let splat = |value: f32| Lanes::splat(simd, value);
    let bits = x.bitcast::<i32x16<S>>();
    // Subtracting the bits of √½ centres mantissas m on 1, from √½ to √2, where the series converges fast.
    let shifted = bits - 0x3f35_04f3;
    let exponent = shifted >> 23;
    let mantissa = (bits - (exponent << 23)).bitcast::<f32x16<S>>();
    // ln m = 2 artanh s with s = (m − 1)/(m + 1), |s| < 0.172: a series of odd powers, here up to the ninth.
    let s = (mantissa - splat(1.0)) / (mantissa + splat(1.0));
    let square = s * s;
    let mut series = splat(2.0 / 9.0);
    for divisor in [7.0, 5.0, 3.0, 1.0] {
        series = series.mul_add(square, splat(2.0 / divisor));
    }
    let exponent: Lanes<S> = exponent.to_float::<f32x16<S>>();
    exponent.mul_add(splat(std::f32::consts::LN_2), series * s)
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};

    use super::*;

    #[inline(always)]
    fn exp_and_ln<S: Simd>(simd: S, x: &[f32; LANES]) -> ([f32; LANES], [f32; LANES]) {
        let x = Lanes::load_array_ref(simd, x);
        (exp(x).into(), ln(x.abs()).into())
    }

    #[test]
    fn exponential_and_logarithm_keep_their_bounds() {
        for start in 0..4000 {
            let x: [f32; LANES] =
                std::array::from_fn(|lane| (start * 16 + lane) as f32 * 2.5e-3 - 80.0);
            let (exp, ln) = dispatch!(Level::new(), simd => exp_and_ln(simd, &x));
            for lane in 0..LANES {
                let exact = f64::from(x[lane]).exp();
                let error = (f64::from(exp[lane]) / exact - 1.0).abs();
                assert!(error < 2e-7, "exp {} is wrong by {error:e}", x[lane]);
                if x[lane] != 0.0 {
                    let exact = f64::from(x[lane].abs()).ln();
                    let error = (f64::from(ln[lane]) - exact).abs() / exact.abs().max(1.0);
                    assert!(error < 2e-7, "ln {} is wrong by {error:e}", x[lane]);
                }
            }
        }
    }
}
