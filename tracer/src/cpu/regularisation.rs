//! Path regularisation ([`crate::regularisation`]), one path per lane; its state is a bit of the stored
//! density.

use fearless_simd::prelude::*;

use super::lanes::{Float, Mask, Word};
use super::stream::{Stream, load, load_words};
use crate::regularisation::KEY_MASK;

/// Lowest bit of a finite density in [`Stream::pdf`]: set if the path comes from a diffuse surface,
/// directly or via coats and metals.
const SPREAD: u32 = 1;

/// A density with that bit set or cleared. 0 becomes the smallest normal number, for which no light counts
/// either.
#[inline(always)]
pub(super) fn with_spread<S: Simd>(pdf: Float<S>, spread: Mask<S>) -> Float<S> {
    let spread = spread & pdf.simd_ge(0.0) & pdf.simd_lt(f32::INFINITY);
    // A relative change of 2⁻²³ is far below the resolution of the power heuristic, and the bit saves a
    // column that compaction would have to move. 0 is raised first: with the bit it would be subnormal, and
    // lost on processors that flush subnormals to 0.
    let word: Word<S> = pdf.max(f32::MIN_POSITIVE).bitcast();
    let plain: Word<S> = pdf.bitcast();
    let word = spread.select(word | SPREAD, plain & !SPREAD);
    word.bitcast()
}

/// Lanes whose next specular lobe is regularised.
#[inline(always)]
pub(super) fn regularised<S: Simd>(simd: S, stream: &Stream, at: usize) -> Mask<S> {
    let pdf: Word<S> = load(simd, &stream.pdf, at).bitcast();
    let sample = load_words(simd, &stream.sample, at);
    (pdf & SPREAD).simd_ne(0) & (sample & KEY_MASK).simd_eq(0)
}
