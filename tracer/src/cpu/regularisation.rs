//! Regularisation of paths ([`crate::regularisation`]), a lane each: chosen by a bit of their density.

use fearless_simd::prelude::*;

use super::lanes::{Float, Mask, Word};
use super::stream::{Stream, load, load_words};
use crate::regularisation::KEY_MASK;

/// The lowest bit of a finite density in [`Stream::pdf`]: the path comes from a diffuse surface, or
/// by way of coats and metals from one.
const SPREAD: u32 = 1;

/// A density with that bit. One of 0 becomes so small that no light counts either.
#[inline(always)]
pub(super) fn with_spread<S: Simd>(pdf: Float<S>, spread: Mask<S>) -> Float<S> {
    let spread = spread & pdf.simd_ge(0.0) & pdf.simd_lt(f32::INFINITY);
    // A relative change of 2⁻²³ is far below what the power heuristic resolves, and a bit of the density
    // spares a column that compaction would have to move. 0 is lifted first: with the bit it would be
    // subnormal, and processors that flush those to 0 would lose it.
    let word: Word<S> = pdf.max(f32::MIN_POSITIVE).bitcast();
    let plain: Word<S> = pdf.bitcast();
    let word = spread.select(word | SPREAD, plain & !SPREAD);
    word.bitcast()
}

/// The paths whose next mirror is mollified.
#[inline(always)]
pub(super) fn regularised<S: Simd>(simd: S, stream: &Stream, at: usize) -> Mask<S> {
    let pdf: Word<S> = load(simd, &stream.pdf, at).bitcast();
    let sample = load_words(simd, &stream.sample, at);
    (pdf & SPREAD).simd_ne(0) & (sample & KEY_MASK).simd_eq(0)
}
