//! The neighbourhood of a row of pixels: light and guides of the rows that a filter pass reads.

use fearless_simd::prelude::*;

use super::input::{ALBEDO, NORMAL, VARIANCE};
use super::soa_image::{Float, SoaImage, SoaRow};

/// The x component of the normal of pixels that were not traced. It is so far from any real normal
/// that nothing mixes with them.
pub(super) const NO_NORMAL: f32 = 1e6;

/// Index of a column of [`super::DenoiseInput`] among the guides.
pub(super) const fn guide(column: usize) -> usize {
    column - ALBEDO
}

/// The three rows in which the taps of one row lie.
pub(super) struct Neighbourhood<'a> {
    guides: [SoaRow<'a>; 3],
    light: [SoaRow<'a>; 3],
}

impl<'a> Neighbourhood<'a> {
    pub(super) fn new(light: &'a SoaImage, guides: &'a SoaImage, y: usize, step: isize) -> Self {
        let offsets = [-step, 0, step];
        Self {
            guides: offsets.map(|dy| guides.row(y, dy)),
            light: offsets.map(|dy| light.row(y, dy)),
        }
    }

    /// Mean variance of a pixel and its eight taps at distance `step`, as far as these were traced.
    /// The variance of the pixel alone may be 0 by chance, if all of its paths missed the light.
    #[inline(always)]
    pub(super) fn mean_variance<S: Simd>(&self, simd: S, x: usize, step: isize) -> Float<S> {
        let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
        let (mut count, mut sum) = (zero, zero);
        for (guides, light) in self.guides.iter().zip(&self.light) {
            for dx in [-step, 0, step] {
                let traced = guides.load(simd, guide(NORMAL), x, dx).simd_lt(NO_NORMAL);
                count += traced.select(one, zero);
                sum += traced.select(light.load(simd, VARIANCE, x, dx), zero);
            }
        }
        sum / count.max(1.0)
    }

    /// Guides and light of the row `dy` steps (−1 to 1) below.
    #[inline(always)]
    pub(super) fn at(&self, dy: isize) -> (SoaRow<'a>, SoaRow<'a>) {
        let row = 1usize.wrapping_add_signed(dy);
        (self.guides[row], self.light[row])
    }
}

#[inline(always)]
pub(super) fn dot<S: Simd>(a: [Float<S>; 3], b: [Float<S>; 3]) -> Float<S> {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

#[inline(always)]
pub(super) fn distance_squared<S: Simd>(a: [Float<S>; 3], b: [Float<S>; 3]) -> Float<S> {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    dot(d, d)
}
