//! Tables with a row of numbers per primitive, gathered by lane.

use fearless_simd::prelude::*;

use super::lanes::{Float, LANES, Vec3x, Word};

/// The row of each lane in a table.
pub(super) struct Rows<'a, const N: usize> {
    lanes: [&'a [f32; N]; LANES],
    /// Whether all lanes use the same row, as is common for camera rays.
    uniform: bool,
}

impl<'a, const N: usize> Rows<'a, N> {
    /// Looks up row `id` of `table` in each lane.
    ///
    /// # Panics
    /// If an id is not below the table's length.
    #[inline(always)]
    pub(super) fn new<S: Simd>(table: &'a [[f32; N]], id: Word<S>) -> Self {
        // If so, each number that follows is a broadcast instead of a gather.
        let uniform = id.simd_eq(id[0]).all_true();
        let mut lanes = [&table[id[0] as usize]; LANES];
        if !uniform {
            for (row, id) in lanes.iter_mut().zip(&id.to_array()) {
                *row = &table[*id as usize];
            }
        }
        Self { lanes, uniform }
    }

    #[inline(always)]
    pub(super) fn number<S: Simd>(&self, simd: S, column: usize) -> Float<S> {
        if self.uniform {
            return Float::splat(simd, self.lanes[0][column]);
        }
        // A loop, because `array::map`, if not inlined, is compiled for the baseline instruction set: 6 %
        // of a Cornell box.
        let mut numbers = [0.0; LANES];
        for (number, row) in numbers.iter_mut().zip(&self.lanes) {
            *number = row[column];
        }
        Float::load_array(simd, numbers)
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
