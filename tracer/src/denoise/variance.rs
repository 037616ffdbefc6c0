//! The variance of a row's pixels before the first pass: means over 3 × 3 pixels, from sums down the
//! columns that neighbours share, or the pixel's own if that is larger. The mean alone would take a
//! dot for a ninth as uncertain as it is, and leave it.

use fearless_simd::prelude::*;

use super::input::{LIGHT, NORMAL, VARIANCE};
use super::neighbourhood::{NO_NORMAL, Neighbourhood, dot, guide};
use super::soa_image::{Float, LANES};

/// SoaImage of sums: how many pixels were traced, their squares, their light.
const COUNT: usize = 0;
const SQUARES: usize = 1;
const SUM: usize = 2;
const PLANES: usize = SUM + 3;

/// Sums over three rows, of one column each; memory that one row's columns after another's use.
#[derive(Default)]
pub(super) struct ColumnSums {
    stride: usize,
    data: Vec<f32>,
}

impl ColumnSums {
    /// Sums up the `width` columns of a row and one on each side of them.
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
                // One column to the left of x: the sums of columns x − 1, x and x + 1 then lie side by
                // side.
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

    /// The mean variance of the 3 × 3 pixels around those from `x` on; of single samples, their
    /// variance among each other.
    #[inline(always)]
    pub(super) fn variance<S: Simd>(&self, simd: S, x: usize, is_single: bool) -> Float<S> {
        let inverse = 1.0 / self.three(simd, COUNT, x).max(1.0);
        let mean_square = self.three(simd, SQUARES, x) * inverse;
        if !is_single {
            return mean_square;
        }
        // Not mapped: a closure is compiled for every processor alike, so that its sums would be calls.
        let sum = [
            self.three(simd, SUM, x),
            self.three(simd, SUM + 1, x),
            self.three(simd, SUM + 2, x),
        ];
        (mean_square - dot(sum, sum) * (inverse * inverse)).max(0.0)
    }

    /// The sum over a column, the one before and the one after it.
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
