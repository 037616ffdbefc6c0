//! Images as planes of floats (structure of arrays), with padding that taps may read.

use std::ops::Range;

use fearless_simd::{f32x16, mask32x16, prelude::*};
use rayon::prelude::*;

use crate::Tile;

pub(super) type Float<S> = f32x16<S>;
pub(super) type Mask<S> = mask32x16<S>;
pub(super) const LANES: usize = 16;

/// Padding on each side of the image, in columns.
const PAD: usize = 4;

/// An image of several float planes, interleaved by row: a row of the first plane, of the second,
/// …, then the next row.
pub(super) struct SoaImage {
    stride: usize,
    floats: usize,
    /// A row that stands for all rows above and below the image.
    outside: Vec<f32>,
    data: Vec<f32>,
}

/// One row of all planes, for reading: looked up once per row of results rather than per tap.
#[derive(Clone, Copy)]
pub(super) struct SoaRow<'a> {
    stride: usize,
    data: &'a [f32],
}

/// One row of all planes, for writing.
pub(super) struct SoaRowMut<'a> {
    stride: usize,
    data: &'a mut [f32],
}

impl SoaImage {
    /// An image of the size of `bounds`, with padding of 0; its pixels hold whatever `memory` held.
    pub(super) fn new(bounds: Tile, planes: usize, memory: Vec<f32>) -> Self {
        // Padding for the taps of the last pass on both sides, and for a whole vector beyond the
        // last pixel, so that no load needs a bounds check of its own.
        let stride = bounds.width as usize + 2 * PAD + LANES;
        let floats = planes * stride;
        let mut data = memory;
        data.resize(bounds.height as usize * floats, 0.0);
        for row in data.chunks_exact_mut(stride) {
            row[..PAD].fill(0.0);
            row[PAD + bounds.width as usize..].fill(0.0);
        }
        Self {
            stride,
            floats,
            outside: vec![0.0; floats],
            data,
        }
    }

    pub(super) fn into_memory(self) -> Vec<f32> {
        self.data
    }

    /// Fills the padding of a plane, on all four sides.
    pub(super) fn surround(&mut self, plane: usize, value: f32) {
        let columns = plane * self.stride..(plane + 1) * self.stride;
        for row in self.data.chunks_exact_mut(self.floats) {
            let row = &mut row[columns.clone()];
            row[..PAD].fill(value);
            row[self.stride - PAD - LANES..].fill(value);
        }
        self.outside[columns].fill(value);
    }

    /// Fills one row of some planes.
    pub(super) fn fill_row(&mut self, y: usize, planes: Range<usize>, value: f32) {
        let columns = planes.start * self.stride..planes.end * self.stride;
        self.data[y * self.floats..][columns].fill(value);
    }

    /// One pixel of a plane.
    pub(super) fn get(&self, plane: usize, x: usize, y: usize) -> f32 {
        self.data[y * self.floats + plane * self.stride + PAD + x]
    }

    pub(super) fn rows_mut(&mut self) -> impl Iterator<Item = SoaRowMut<'_>> {
        let stride = self.stride;
        let rows = self.data.chunks_exact_mut(self.floats);
        rows.map(move |data| SoaRowMut { stride, data })
    }

    pub(super) fn par_rows_mut(
        &mut self,
    ) -> impl IndexedParallelIterator<Item = (usize, SoaRowMut<'_>)> {
        let stride = self.stride;
        let rows = self.data.par_chunks_exact_mut(self.floats);
        rows.map(move |data| SoaRowMut { stride, data }).enumerate()
    }

    /// The row `dy` below `y`, or padding if that lies outside the image.
    pub(super) fn row(&self, y: usize, dy: isize) -> SoaRow<'_> {
        let begin = y.checked_add_signed(dy).map(|y| y * self.floats);
        let inside = begin.and_then(|begin| self.data.get(begin..begin + self.floats));
        SoaRow {
            stride: self.stride,
            data: inside.unwrap_or(&self.outside),
        }
    }
}

impl<'a> SoaRow<'a> {
    #[inline(always)]
    pub(super) fn load<S: Simd>(self, simd: S, plane: usize, x: usize, dx: isize) -> Float<S> {
        let begin = plane * self.stride + (x + PAD).wrapping_add_signed(dx);
        Float::from_slice(simd, &self.data[begin..][..LANES])
    }

    /// Some columns of one plane.
    pub(super) fn numbers(self, plane: usize, columns: Range<usize>) -> &'a [f32] {
        &self.data[plane * self.stride + PAD..][columns]
    }

    #[inline(always)]
    pub(super) fn triple<S: Simd>(
        self,
        simd: S,
        plane: usize,
        x: usize,
        dx: isize,
    ) -> [Float<S>; 3] {
        [
            self.load(simd, plane, x, dx),
            self.load(simd, plane + 1, x, dx),
            self.load(simd, plane + 2, x, dx),
        ]
    }
}

impl SoaRowMut<'_> {
    /// Writes values to one plane from column `x` on.
    pub(super) fn put(&mut self, plane: usize, x: usize, values: &[f32]) {
        let to = self.columns(plane, x, values.len());
        // Copies whole vectors: a tile's rows are so short that most of the time of a `memcpy` call
        // would be its overhead.
        let ((to, to_rest), (from, rest)) = (to.as_chunks_mut::<LANES>(), values.as_chunks());
        for (to, from) in to.iter_mut().zip(from) {
            *to = *from;
        }
        to_rest.copy_from_slice(rest);
    }

    #[inline(always)]
    pub(super) fn store<S: Simd>(&mut self, plane: usize, x: usize, values: Float<S>) {
        values.store_slice(self.columns(plane, x, LANES));
    }

    #[inline(always)]
    fn columns(&mut self, plane: usize, x: usize, count: usize) -> &mut [f32] {
        &mut self.data[plane * self.stride + PAD + x..][..count]
    }
}
