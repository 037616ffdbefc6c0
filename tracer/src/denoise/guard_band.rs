//! Tiles with the guard band of surrounding pixels that the filter needs.

use super::SUPPORT;
use crate::{ImageSize, Tile};

/// Edge length in pixels of the square blocks that guard bands consist of.
const BLOCK: u32 = 8;
/// Maximum width of a guard tile in pixels: shorter tiles are distributed over threads more evenly.
const GUARD_WIDTH_MAX: u32 = 64;

/// The part of an image that has to be traced so that some tiles can be filtered.
#[derive(Debug)]
pub(crate) struct GuardedRegion {
    /// Smallest rectangle around the wanted tiles and all pixels within the filter's reach.
    pub(crate) bounds: Tile,
    /// The wanted tiles, then those of the guard band.
    pub(crate) tiles: Vec<Tile>,
}

impl GuardedRegion {
    /// The region around the `wanted` tiles, of which there must be at least one, in an image of
    /// `size`.
    pub(crate) fn around(wanted: &[Tile], size: ImageSize) -> Self {
        let grown: Vec<Tile> = wanted.iter().map(|&tile| grown(tile, size)).collect();
        let (columns, rows) = (size.width.div_ceil(BLOCK), size.height.div_ceil(BLOCK));
        let mut needed = vec![false; (columns * rows) as usize];
        let mut mark = |tile: Tile, value: bool, blocks: fn(u32, u32, u32) -> (u32, u32)| {
            let (left, right) = blocks(tile.x, tile.x + tile.width, size.width);
            let (top, bottom) = blocks(tile.y, tile.y + tile.height, size.height);
            for y in top..bottom {
                let row = (y * columns) as usize;
                for x in left..right.max(left) {
                    needed[row + x as usize] = value;
                }
            }
        };
        // All blocks within reach of a wanted tile, except those that wanted tiles cover entirely,
        // which are traced with these.
        for &tile in &grown {
            mark(tile, true, blocks_touched);
        }
        for &tile in wanted {
            mark(tile, false, blocks_covered);
        }
        let mut tiles = wanted.to_vec();
        for (y, row) in (0..).zip(needed.chunks(columns as usize)) {
            push_spans(&mut tiles, y, row, size);
        }
        let bounds = grown.into_iter().reduce(joined).unwrap_or(EMPTY);
        Self { bounds, tiles }
    }

    /// Rows of the bounds, counted from 0, that have pixels which are not traced.
    pub(super) fn rows_with_holes(&self) -> Vec<usize> {
        let bounds = self.bounds;
        let width = bounds.width as usize;
        let mut traced = vec![false; bounds.pixels()];
        for tile in &self.tiles {
            // Blocks may extend beyond the bounds.
            let clipped = |begin: u32, length: u32, first: u32, bound: u32| {
                let place = |x: u32| x.saturating_sub(first).min(bound) as usize;
                place(begin)..place(begin + length)
            };
            let columns = clipped(tile.x, tile.width, bounds.x, bounds.width);
            for y in clipped(tile.y, tile.height, bounds.y, bounds.height) {
                traced[y * width..][columns.clone()].fill(true);
            }
        }
        let rows = traced.chunks_exact(width.max(1)).enumerate();
        let holed = rows.filter(|(_, row)| row.contains(&false));
        holed.map(|(y, _)| y).collect()
    }
}

/// Limits of a region of more than one tile: a node that delivered nothing until the end of a long
/// job would seem dead, and the filter's planes of a hundred bytes per pixel would become large.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RegionLimits {
    pub(crate) samples: u64,
    pub(crate) pixels: u64,
}

/// Number of leading tiles that may be filtered together, at least 1.
pub(crate) fn leading(tiles: &[Tile], samples: u32, limits: RegionLimits) -> usize {
    let mut bounds = EMPTY;
    let within = |tile: &&Tile| {
        bounds = if bounds.width == 0 {
            **tile
        } else {
            joined(bounds, **tile)
        };
        let pixels = bounds.pixels() as u64;
        pixels * u64::from(samples) <= limits.samples && pixels <= limits.pixels
    };
    tiles.iter().take_while(within).count().max(1)
}

/// Number of samples that are traced before their tiles are handed over, unless a device is faster:
/// a frame of 1280×720 at 4 samples, which takes a slow processor some seconds. Fewer would need
/// more guard bands.
pub(crate) const REGION_SAMPLES: u64 = 1 << 22;

pub(super) const EMPTY: Tile = Tile {
    x: 0,
    y: 0,
    width: 0,
    height: 0,
};

fn grown(tile: Tile, size: ImageSize) -> Tile {
    let (x, y) = (
        tile.x.saturating_sub(SUPPORT),
        tile.y.saturating_sub(SUPPORT),
    );
    Tile {
        x,
        y,
        width: (tile.x + tile.width + SUPPORT).min(size.width) - x,
        height: (tile.y + tile.height + SUPPORT).min(size.height) - y,
    }
}

fn joined(a: Tile, b: Tile) -> Tile {
    let (x, y) = (a.x.min(b.x), a.y.min(b.y));
    Tile {
        x,
        y,
        width: (a.x + a.width).max(b.x + b.width) - x,
        height: (a.y + a.height).max(b.y + b.height) - y,
    }
}

/// Range of the blocks that have a pixel in `begin..end`.
fn blocks_touched(begin: u32, end: u32, _: u32) -> (u32, u32) {
    (begin / BLOCK, end.div_ceil(BLOCK))
}

/// Range of the blocks all of whose pixels, in an image that ends at `edge`, lie in `begin..end`.
// A block that is covered only in part stays in the guard band, as the rest of it belongs to no
// wanted tile.
fn blocks_covered(begin: u32, end: u32, edge: u32) -> (u32, u32) {
    let last = if end == edge {
        end.div_ceil(BLOCK)
    } else {
        end / BLOCK
    };
    (begin.div_ceil(BLOCK), last)
}

/// Adds the needed blocks of one row as tiles.
fn push_spans(tiles: &mut Vec<Tile>, row: u32, needed: &[bool], size: ImageSize) {
    let y = row * BLOCK;
    let mut first = 0;
    for span in needed.chunk_by(|a, b| a == b) {
        let (begin, end) = (first * BLOCK, (first + span.len() as u32) * BLOCK);
        first += span.len() as u32;
        if span[0] {
            let end = end.min(size.width);
            tiles.extend(
                (begin..end)
                    .step_by(GUARD_WIDTH_MAX as usize)
                    .map(|x| Tile {
                        x,
                        y,
                        width: GUARD_WIDTH_MAX.min(end - x),
                        height: BLOCK.min(size.height - y),
                    }),
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TileGrid, TileRange};

    fn covers(tiles: &[Tile], x: u32, y: u32) -> bool {
        let holds =
            |t: &Tile| (t.x..t.x + t.width).contains(&x) && (t.y..t.y + t.height).contains(&y);
        tiles.iter().any(holds)
    }

    #[test]
    fn guard_band_covers_the_support_and_little_more() {
        let size = ImageSize::new(203, 151);
        for (edge, first, count) in [(32, 0, 1), (32, 9, 8), (13, 40, 50), (203, 0, 1), (8, 7, 1)] {
            let grid = TileGrid::new(size, edge);
            let wanted: Vec<Tile> = grid.tiles(TileRange { first, count }).collect();
            let region = GuardedRegion::around(&wanted, size);
            assert_eq!(region.tiles[..wanted.len()], wanted);
            for (x, y) in (0..size.height).flat_map(|y| (0..size.width).map(move |x| (x, y))) {
                let near = wanted
                    .iter()
                    .any(|&tile| covers(&[grown(tile, size)], x, y));
                let traced = covers(&region.tiles, x, y);
                assert!(traced || !near, "({x}, {y}) is missing");
                let far = |t: &Tile| {
                    x + SUPPORT + BLOCK < t.x
                        || y + SUPPORT + BLOCK < t.y
                        || x > t.x + t.width + SUPPORT + BLOCK
                        || y > t.y + t.height + SUPPORT + BLOCK
                };
                assert!(!(traced && wanted.iter().all(far)), "({x}, {y}) is too far");
                assert!(!near || covers(&[region.bounds], x, y));
            }
        }
    }

    #[test]
    fn what_is_filtered_together_is_bounded() {
        let grid = TileGrid::new(ImageSize::new(16_384, 16_384), 128);
        let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
        let limits = RegionLimits {
            samples: REGION_SAMPLES,
            pixels: u64::MAX,
        };
        let count = leading(&tiles, 1, limits);
        assert!(
            GuardedRegion::around(&tiles[..count], grid.size)
                .bounds
                .pixels()
                < 1 << 23
        );
        assert_eq!(leading(&tiles, u32::MAX, limits), 1);
        assert_eq!(leading(&[tiles[0], tiles[tiles.len() - 1]], 1, limits), 1);
        let grid = TileGrid::new(ImageSize::new(1280, 720), 32);
        let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
        assert_eq!(leading(&tiles, 4, limits), tiles.len());
        assert!((1..tiles.len() / 10).contains(&leading(&tiles, 64, limits)));
    }

    #[test]
    fn a_whole_image_has_no_guard_band() {
        let size = ImageSize::new(203, 151);
        let grid = TileGrid::new(size, 32);
        let wanted: Vec<Tile> = grid.tiles(grid.all()).collect();
        let mut region = GuardedRegion::around(&wanted, size);
        assert_eq!(region.tiles, wanted);
        assert!(region.rows_with_holes().is_empty());
        // A duplicate tile does not compensate for a missing one.
        region.tiles[3] = region.tiles[2];
        assert_eq!(region.rows_with_holes(), (0..32).collect::<Vec<_>>());
    }
}
