//! A tile that takes longer than a slice, traced in parts: blocks of columns, or a part of one column.
//!
//! A pixel does not depend on what it is traced with, so the parts have the bits of the whole tile. Denoised tiles
//! cannot be divided: each part would need a guard band of its own.

use carom_tracer::{Tile, TileRadiance};

/// The pixels of a tile that have been traced, column by column from the left.
pub(super) struct PartialTile {
    /// The tile's number in its grid.
    pub(super) index: u32,
    tile: Tile,
    radiance: Vec<[f32; 3]>,
    traced: u32,
    dropped_samples: u32,
}

impl PartialTile {
    /// None of the pixels of the tile of this number.
    pub(super) fn new(index: u32, tile: Tile) -> Self {
        Self {
            index,
            tile,
            radiance: vec![[0.0; 3]; tile.pixels()],
            traced: 0,
            dropped_samples: 0,
        }
    }

    /// The next pixels to trace, at most `pixels` but for the first: high parts, since tracers divide rows
    /// among their threads.
    pub(super) fn next(&self, pixels: u32) -> Tile {
        let Tile { width, height, .. } = self.tile;
        let (column, row) = (self.traced / height, self.traced % height);
        let (columns, rows) = match row {
            0 if pixels >= height => ((pixels / height).min(width - column), height),
            _ => (1, pixels.clamp(1, height - row)),
        };
        Tile {
            x: self.tile.x + column,
            y: self.tile.y + row,
            width: columns,
            height: rows,
        }
    }

    /// Takes in what has been traced of [`PartialTile::next`].
    pub(super) fn put(&mut self, part: Tile, traced: &TileRadiance) {
        let (left, top) = (part.x - self.tile.x, part.y - self.tile.y);
        let rows = traced.radiance.chunks_exact(part.width as usize);
        for (y, row) in (top..).zip(rows) {
            let first = (y * self.tile.width + left) as usize;
            self.radiance[first..first + row.len()].copy_from_slice(row);
        }
        self.traced += part.pixels() as u32;
        self.dropped_samples = self.dropped_samples.saturating_add(traced.dropped_samples);
    }

    /// The whole tile, once all of it has been traced.
    pub(super) fn whole(self) -> Result<(Vec<[f32; 3]>, u32), Self> {
        match self.traced as usize == self.radiance.len() {
            true => Ok((self.radiance, self.dropped_samples)),
            false => Err(self),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each pixel's place, as if it had been traced.
    fn places(part: Tile) -> TileRadiance {
        let pixel = |index: u32| {
            let (x, y) = (part.x + index % part.width, part.y + index / part.width);
            [x as f32, y as f32, 0.0]
        };
        TileRadiance {
            index: 0,
            radiance: (0..part.pixels() as u32).map(pixel).collect(),
            dropped_samples: 1,
        }
    }

    #[test]
    fn parts_of_any_size_make_the_whole_tile() {
        let tile = Tile {
            x: 64,
            y: 32,
            width: 7,
            height: 5,
        };
        for sizes in [
            vec![1],
            vec![3],
            vec![5],
            vec![12],
            vec![35],
            vec![1, 30, 2, 11],
            vec![0],
        ] {
            let mut partial = PartialTile::new(9, tile);
            let mut parts = 0;
            let mut next_sizes = sizes.iter().copied().cycle();
            let (radiance, dropped_samples) = loop {
                let pixels = next_sizes.next().unwrap();
                let part = partial.next(pixels);
                assert!(part.pixels() as u32 <= pixels.max(1), "{part:?}");
                partial.put(part, &places(part));
                parts += 1;
                match partial.whole() {
                    Ok(whole) => break whole,
                    Err(rest) => partial = rest,
                }
            };
            assert_eq!(radiance, places(tile).radiance, "parts of {sizes:?}");
            assert_eq!(dropped_samples, parts);
        }
    }
}
