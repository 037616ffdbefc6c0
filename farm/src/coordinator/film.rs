//! A picture as its tiles come in.

use carom_protocol::PixelFormat;
use carom_protocol::tile_codec::TilePixels;
use carom_tracer::{Tile, TileGrid, TileRun};

use super::work::push_tile;
use crate::Pixels;

/// Pixels of a picture, and which tiles of it are there.
#[derive(Clone, Debug)]
pub(super) struct Film {
    grid: TileGrid,
    pixels: Pixels,
    filled: Vec<bool>,
    missing: u32,
}

impl Film {
    pub(super) fn new(grid: TileGrid, format: PixelFormat) -> Self {
        let pixels = match format {
            PixelFormat::Srgb8 { .. } => Pixels::Srgb8(vec![[0; 3]; grid.size.pixels()]),
            PixelFormat::LinearF16 | PixelFormat::LinearF32 => {
                Pixels::Linear(vec![[0.0; 3]; grid.size.pixels()])
            }
        };
        Self {
            grid,
            pixels,
            filled: vec![false; grid.len() as usize],
            missing: grid.len(),
        }
    }

    /// Puts in those tiles of `run` that are not there yet and returns how many they are.
    pub(super) fn fill(&mut self, run: TileRun, pixels: &TilePixels) -> u32 {
        let mut start = 0;
        let mut filled = 0;
        for index in run.indices() {
            let tile = self.grid.tile(index);
            if !self.filled[index as usize] {
                self.copy(tile, pixels, start);
                self.filled[index as usize] = true;
                filled += 1;
            }
            start += tile.pixels();
        }
        self.missing -= filled;
        filled
    }

    pub(super) fn is_complete(&self) -> bool {
        self.missing == 0
    }

    /// The tiles from `range` that are not there and that `wanted` accepts.
    pub(super) fn missing(&self, range: TileRun, wanted: impl Fn(u32) -> bool) -> Vec<TileRun> {
        let mut runs = Vec::new();
        for tile in range.indices() {
            if !self.filled[tile as usize] && wanted(tile) {
                push_tile(&mut runs, tile);
            }
        }
        runs
    }

    /// The picture as it is.
    pub(super) fn pixels(&self) -> &Pixels {
        &self.pixels
    }

    /// The picture.
    pub(super) fn into_pixels(self) -> Pixels {
        self.pixels
    }

    fn copy(&mut self, tile: Tile, from: &TilePixels, start: usize) {
        let width = self.grid.size.width as usize;
        match (&mut self.pixels, from) {
            (Pixels::Srgb8(to), TilePixels::Srgb8(from)) => {
                copy_rows(to, width, tile, &from[start..]);
            }
            (Pixels::Linear(to), TilePixels::Linear(from)) => {
                copy_rows(to, width, tile, &from[start..]);
            }
            _ => unreachable!("a session decodes pixels to the format that was asked for"),
        }
    }
}

/// Whether all pixels are numbers.
pub(super) fn is_finite(pixels: &TilePixels) -> bool {
    match pixels {
        TilePixels::Srgb8(_) => true,
        TilePixels::Linear(pixels) => pixels.iter().flatten().all(|value| value.is_finite()),
    }
}

fn copy_rows<T: Copy>(to: &mut [T], image_width: usize, tile: Tile, from: &[T]) {
    let width = tile.width as usize;
    let rows = from.chunks_exact(width).take(tile.height as usize);
    for (row, pixels) in rows.enumerate() {
        let start = (tile.y as usize + row) * image_width + tile.x as usize;
        to[start..start + width].copy_from_slice(pixels);
    }
}
