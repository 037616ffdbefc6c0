//! Tables of numbers, a row per primitive, fetched a lane each.

use fearless_simd::prelude::*;

use super::lanes::{Float, LANES, Vec3x, Word};

/// A table's rows for each lane.
pub(super) struct Rows<'a, const N: usize> {
    lanes: [&'a [f32; N]; LANES],
    /// All lanes hit the same primitive, as camera rays mostly do.
    uniform: bool,
}

impl<'a, const N: usize> Rows<'a, N> {
    /// # Panics
    /// If an id is not below the table's length.
    #[inline(always)]
    pub(super) fn new<S: Simd>(table: &'a [[f32; N]], id: Word<S>) -> Self {
        let uniform = id.simd_eq(id[0]).all_true();
        let lanes = if uniform {
            [&table[id[0] as usize]; LANES]
        } else {
            id.to_array().map(|id| &table[id as usize])
        };
        Self { lanes, uniform }
    }

    #[inline(always)]
    pub(super) fn number<S: Simd>(&self, simd: S, column: usize) -> Float<S> {
        if self.uniform {
            return Float::splat(simd, self.lanes[0][column]);
        }
        Float::load_array(simd, self.lanes.map(|row| row[column]))
    }

    #[inline(always)]
    pub(super) fn triple<S: Simd>(&self, simd: S, column: usize) -> Vec3x<S> {
        Vec3x::new(
            self.number(simd, column),
            self.number(simd, column + 1),
            self.number(simd, column + 2),
        )
    }
}
