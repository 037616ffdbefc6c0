//! The variance of a row's pixels before the first pass: the mean over 3 × 3 pixels, computed from
//! column sums that neighbours share, or the pixel's own variance if that is larger. The mean alone
//! would make an outlier a ninth as uncertain as it is, and so preserve it.

use fearless_simd::prelude::*;

use super::input::{LIGHT, NORMAL, VARIANCE};
use super::neighbourhood::{NO_NORMAL, Neighbourhood, dot, guide};
use super::soa_image::{Float, LANES};

/// Planes of sums: number of traced pixels; variances or squares of light; light.
const COUNT: usize = 0;
const SQUARES: usize = 1;
const SUM: usize = 2;
const PLANES: usize = SUM + 3;

/// Sums over three rows for each column; the memory is reused from row to row.
#[derive(Default)]
pub(super) struct ColumnSums {
    stride: usize,
    data: Vec<f32>,
}

impl ColumnSums {
    /// Computes the sums for the `width` columns of a row and one column on each side.
    #[inline(always)]
    pub(super) fn sum_up<S: Simd>(
        &mut self,
        simd: S,
        around: &Neighbourhood<'_>,
        width: usize,
        is_single: bool,
    ) {
        self.stride = width + 2 * LANES + 2;
        self.data.resize(PLANES * self.stride, 0.0);
        let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
        for x in (0..width + 2).step_by(LANES) {
            let (mut count, mut squares, mut sum) = (zero, zero, [zero; 3]);
            for dy in -1..=1 {
                let (guides, light) = around.at(dy);
                // Offset by one column: index x then holds the sum of column x − 1, so that the
                // sums of columns x − 1 to x + 1 are adjacent.
                let traced = guides.load(simd, guide(NORMAL), x, -1).simd_lt(NO_NORMAL);
                count += traced.select(one, zero);
                if is_single {
                    let light = light.triple(simd, LIGHT, x, -1);
                    squares += dot(light, light);
                    sum = [sum[0] + light[0], sum[1] + light[1], sum[2] + light[2]];
                } else {
                    squares += light.load(simd, VARIANCE, x, -1);
                }
            }
            self.store(COUNT, x, count);
            self.store(SQUARES, x, squares);
            if is_single {
                for (channel, sum) in sum.into_iter().enumerate() {
                    self.store(SUM + channel, x, sum);
                }
            }
        }
    }

    /// Mean variance of the 3 × 3 pixels around each pixel from `x` on; with a single sample per
    /// pixel, the variance of light among these pixels.
    #[inline(always)]
    pub(super) fn variance<S: Simd>(&self, simd: S, x: usize, is_single: bool) -> Float<S> {
        let inverse = 1.0 / self.three(simd, COUNT, x).max(1.0);
        let mean_square = self.three(simd, SQUARES, x) * inverse;
        if !is_single {
            return mean_square;
        }
        // Not `map`: closures are not compiled for the caller's instruction set, so its SIMD
        // operations would become calls.
        let sum = [
            self.three(simd, SUM, x),
            self.three(simd, SUM + 1, x),
            self.three(simd, SUM + 2, x),
        ];
        (mean_square - dot(sum, sum) * (inverse * inverse)).max(0.0)
    }

    /// Sum over three adjacent columns, centred at each column from `x` on.
    #[inline(always)]
    fn three<S: Simd>(&self, simd: S, plane: usize, x: usize) -> Float<S> {
        let begin = plane * self.stride + x;
        let columns = &self.data[begin..][..LANES + 2];
        Float::from_slice(simd, &columns[..LANES])
            + Float::from_slice(simd, &columns[1..=LANES])
            + Float::from_slice(simd, &columns[2..])
    }

    #[inline(always)]
    fn store<S: Simd>(&mut self, plane: usize, x: usize, values: Float<S>) {
        values.store_slice(&mut self.data[plane * self.stride + x..][..LANES]);
    }
}
