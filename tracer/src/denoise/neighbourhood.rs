//! Neighbourhood of a row of pixels: light and guides of the rows that a pass reads.

use fearless_simd::prelude::*;

use super::input::{ALBEDO, NORMAL, VARIANCE};
use super::soa_image::{Float, SoaImage, SoaRow};

/// No surface has this normal, so that nothing mixes with what was not traced.
pub(super) const NO_NORMAL: f32 = 1e6;

/// Where in the guides a column is.
pub(super) const fn guide(column: usize) -> usize {
    column - ALBEDO
}

/// The rows that the taps of one row lie in.
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

    /// The mean variance of a pixel and its eight taps, `step` pixels apart, as far as they were traced. Of a pixel
    /// alone it may be nothing by chance: all light around it has missed.
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

    /// Guides and light `dy` steps further down.
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
