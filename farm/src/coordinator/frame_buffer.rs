//! Pixels of a frame while its tiles arrive.

use carom_protocol::PixelFormat;
use carom_protocol::tile_codec::TilePixels;
use carom_tracer::{Tile, TileRange, film};

use super::partition::push_tile;
use super::sample_passes::SamplePasses;
use crate::frame::Pixels;

/// Pixels of a picture, and which of its units have arrived.
#[derive(Clone, Debug)]
pub(super) struct FrameBuffer {
    passes: SamplePasses,
    content: BufferContent,
    filled: Vec<bool>,
    missing: u32,
}

#[derive(Clone, Debug)]
enum BufferContent {
    /// Pixels of a frame with a single pass.
    Pixels(Pixels),
    /// Sample sums over the passes that have arrived.
    Sums(film::Film),
}

impl FrameBuffer {
    /// An empty buffer. With several passes it holds linear pixels whatever `format` is.
    pub(super) fn new(passes: SamplePasses, format: PixelFormat) -> Self {
        let (size, units) = (passes.grid.size, passes.all().count);
        let content = match format {
            _ if passes.count() > 1 => BufferContent::Sums(film::Film::new(size)),
            PixelFormat::Srgb8 { .. } => {
                BufferContent::Pixels(Pixels::Srgb8(vec![[0; 4]; size.pixels()]))
            }
            PixelFormat::LinearF16 | PixelFormat::LinearF32 => {
                BufferContent::Pixels(Pixels::Linear(vec![[0.0; 3]; size.pixels()]))
            }
        };
        Self {
            passes,
            content,
            filled: vec![false; units as usize],
            missing: units,
        }
    }

    /// Stores those units of `run`, all of one pass, that are missing, and returns how many they were.
    pub(super) fn fill(&mut self, run: TileRange, pixels: &TilePixels) -> u32 {
        let mut start = 0;
        let mut filled = 0;
        for index in run.indices() {
            let tile = self.passes.grid.tile(self.passes.tile(index));
            // The first copy stays: sums over passes must not take in a unit twice.
            if !self.filled[index as usize] {
                self.put(index, tile, pixels, start);
                self.filled[index as usize] = true;
                filled += 1;
            }
            start += tile.pixels();
        }
        self.missing -= filled;
        filled
    }

    /// Marks units as missing again, so that another node's pixels replace them.
    pub(super) fn clear(&mut self, run: TileRange) {
        for index in run.indices() {
            let filled = std::mem::take(&mut self.filled[index as usize]);
            self.missing += u32::from(filled);
        }
    }

    pub(super) fn is_complete(&self) -> bool {
        self.missing == 0
    }

    /// Number of missing units.
    pub(super) const fn missing_count(&self) -> u32 {
        self.missing
    }

    pub(super) fn has(&self, run: TileRange) -> bool {
        self.filled[run.first as usize..run.end() as usize]
            .iter()
            .all(|filled| *filled)
    }

    /// The missing units of `range` for which `wanted` holds.
    pub(super) fn missing(&self, range: TileRange, wanted: impl Fn(u32) -> bool) -> Vec<TileRange> {
        let mut runs = Vec::new();
        for tile in range.indices() {
            if !self.filled[tile as usize] && wanted(tile) {
                push_tile(&mut runs, tile);
            }
        }
        runs
    }

    /// The tiles that miss at least one pass.
    pub(super) fn missing_tiles(&self) -> Vec<Tile> {
        let grid = self.passes.grid;
        let passes = self.filled.chunks_exact(grid.len() as usize);
        let whole = |tile: u32| passes.clone().all(|pass| pass[tile as usize]);
        let tiles = grid.all().indices().filter(|tile| !whole(*tile));
        tiles.map(|tile| grid.tile(tile)).collect()
    }

    /// The picture so far: the mean of the samples that have arrived, black where there are none.
    pub(super) fn pixels(&self) -> Pixels {
        match &self.content {
            BufferContent::Pixels(Pixels::Srgb8(pixels)) => {
                // Missing pixels still have alpha 0.
                let opaque = |&[r, g, b, _]: &[u8; 4]| [r, g, b, 255];
                Pixels::Srgb8(pixels.iter().map(opaque).collect())
            }
            BufferContent::Pixels(pixels) => pixels.clone(),
            BufferContent::Sums(sums) => Pixels::Linear(sums.image().pixels),
        }
    }

    /// The complete picture.
    pub(super) fn into_pixels(self) -> Pixels {
        match self.content {
            BufferContent::Pixels(pixels) => pixels,
            BufferContent::Sums(sums) => Pixels::Linear(sums.image().pixels),
        }
    }

    fn put(&mut self, unit: u32, tile: Tile, from: &TilePixels, start: usize) {
        let width = self.passes.grid.size.width as usize;
        match (&mut self.content, from) {
            (BufferContent::Pixels(Pixels::Srgb8(to)), TilePixels::Srgb8(from)) => {
                copy_rows(to, width, tile, &from[start..], |&[r, g, b]| [r, g, b, 255]);
            }
            (BufferContent::Pixels(Pixels::Linear(to)), TilePixels::Linear(from)) => {
                copy_rows(to, width, tile, &from[start..], |pixel| *pixel);
            }
            (BufferContent::Sums(sums), TilePixels::Linear(from)) => {
                let samples = self.passes.samples(unit).len() as u32;
                let added = sums.add(tile, &from[start..start + tile.pixels()], samples);
                added.expect("a tile of the grid lies in its picture");
            }
            _ => unreachable!("a session decodes pixels to the format that was asked for"),
        }
    }
}

/// Whether all values are finite.
pub(super) fn is_finite(pixels: &TilePixels) -> bool {
    match pixels {
        TilePixels::Srgb8(_) => true,
        TilePixels::Linear(pixels) => pixels.iter().flatten().all(|value| value.is_finite()),
    }
}

fn copy_rows<From, To>(
    to: &mut [To],
    image_width: usize,
    tile: Tile,
    from: &[From],
    pixel: impl Fn(&From) -> To,
) {
    let width = tile.width as usize;
    let rows = from.chunks_exact(width).take(tile.height as usize);
    for (row, pixels) in rows.enumerate() {
        let start = (tile.y as usize + row) * image_width + tile.x as usize;
        for (to, from) in to[start..start + width].iter_mut().zip(pixels) {
            *to = pixel(from);
        }
    }
}
