//! Pictures as planes of numbers, with room around them that taps may reach.

use std::ops::Range;

use fearless_simd::{f32x16, mask32x16, prelude::*};
use rayon::prelude::*;

use crate::Tile;

pub(super) type Float<S> = f32x16<S>;
pub(super) type Mask<S> = mask32x16<S>;
pub(super) const LANES: usize = 16;

/// Columns on each side of the picture.
const PAD: usize = 4;

/// SoaImage of numbers, row by row: a row of the first plane, of the second, …, then the next row.
pub(super) struct SoaImage {
    stride: usize,
    floats: usize,
    /// A row of what lies above and below the picture.
    outside: Vec<f32>,
    data: Vec<f32>,
}

/// One row of all planes, to read: looked up once for a row of results rather than for each tap.
#[derive(Clone, Copy)]
pub(super) struct SoaRow<'a> {
    stride: usize,
    data: &'a [f32],
}

/// One row of all planes.
pub(super) struct SoaRowMut<'a> {
    stride: usize,
    data: &'a mut [f32],
}

impl SoaImage {
    /// As large as `bounds`: 0 around it, in it anything that `memory` held.
    pub(super) fn new(bounds: Tile, planes: usize, memory: Vec<f32>) -> Self {
        // Room for the taps of the last pass on both sides and for one whole register beyond the last
        // pixel, so that no load has to ask where the picture ends.
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

    /// Fills what lies around the picture in a plane.
    pub(super) fn surround(&mut self, plane: usize, value: f32) {
        let columns = plane * self.stride..(plane + 1) * self.stride;
        for row in self.data.chunks_exact_mut(self.floats) {
            let row = &mut row[columns.clone()];
            row[..PAD].fill(value);
            row[self.stride - PAD - LANES..].fill(value);
        }
        self.outside[columns].fill(value);
    }

    /// Fills a row of planes.
    pub(super) fn fill_row(&mut self, y: usize, planes: Range<usize>, value: f32) {
        let columns = planes.start * self.stride..planes.end * self.stride;
        self.data[y * self.floats..][columns].fill(value);
    }

    /// A number of one plane.
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

    /// The row `dy` below `y`, which may lie outside.
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

    /// The numbers of some columns of one plane.
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
    /// Sets numbers of one plane from column `x` on.
    pub(super) fn put(&mut self, plane: usize, x: usize, values: &[f32]) {
        let to = self.columns(plane, x, values.len());
        // Tiles' rows are short: most of a call's time would be its beginning and end.
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
