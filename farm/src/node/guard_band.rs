//! Guard bands of denoised tiles: the pixels traced beyond their own, and where they may be divided.

use carom_tracer::denoise::SUPPORT;
use carom_tracer::{ImageSize, Tile, TileGrid, TileRange};

/// Edge in pixels of the blocks that guard bands consist of: all blocks that the denoiser's support around
/// a tile touches.
pub(super) const BLOCK: u32 = 8;

/// Number of pixels traced for a denoised rectangle of a picture of `size`.
pub(super) fn guarded_pixels(tile: Tile, size: ImageSize) -> usize {
    let (columns, rows) = (
        Span::new(tile.x, tile.width, size.width),
        Span::new(tile.y, tile.height, size.height),
    );
    // Its own pixels plus the touched blocks, less the blocks that lie wholly inside it: those that it
    // covers in part are counted twice, as they are traced again for the band.
    tile.pixels() + columns.touched * rows.touched - columns.covered * rows.covered
}

/// Upper bound of the pixels traced for a run of denoised tiles: its complete rows share a guard band, and
/// the incomplete ones at its ends are counted with their own.
pub(super) fn guarded_pixels_of_run(grid: TileGrid, run: TileRange) -> usize {
    let (mut pixels, mut first) = (0, run.first);
    while first < run.end() {
        let (column, left) = (first % grid.columns(), run.end() - first);
        // From a row's start, all complete rows form one rectangle; otherwise the rest of the row does.
        let rows = if column == 0 {
            left / grid.columns()
        } else {
            0
        };
        let count = match rows {
            0 => left.min(grid.columns() - column),
            _ => rows * grid.columns(),
        };
        let (from, to) = (grid.tile(first), grid.tile(first + count - 1));
        let rectangle = Tile {
            width: to.x + to.width - from.x,
            height: to.y + to.height - from.y,
            ..from
        };
        pixels += guarded_pixels(rectangle, grid.size);
        first += count;
    }
    pixels
}

/// The smallest part of a denoised tile that is traced by itself, at the tile's beginning.
pub(super) fn first_block(tile: Tile) -> Tile {
    let edge = |begin: u32, length: u32| length.min(BLOCK - begin % BLOCK);
    Tile {
        width: edge(tile.x, tile.width),
        height: edge(tile.y, tile.height),
        ..tile
    }
}

/// A denoised tile cut along a block border, so that no block is shared by both halves; `None` for a tile
/// in one block.
pub(super) fn halves(tile: Tile) -> Option<[Tile; 2]> {
    let by_columns = || {
        let width = middle(tile.x, tile.width)?;
        let right = Tile {
            x: tile.x + width,
            width: tile.width - width,
            ..tile
        };
        Some([Tile { width, ..tile }, right])
    };
    let by_rows = || {
        let height = middle(tile.y, tile.height)?;
        let lower = Tile {
            y: tile.y + height,
            height: tile.height - height,
            ..tile
        };
        Some([Tile { height, ..tile }, lower])
    };
    match tile.width > tile.height {
        true => by_columns().or_else(by_rows),
        false => by_rows().or_else(by_columns),
    }
}

/// Pixels from `begin` to the block border nearest to the middle; `None` if there is none inside.
fn middle(begin: u32, length: u32) -> Option<u32> {
    let edge = (begin + length / 2 + BLOCK / 2) / BLOCK * BLOCK;
    let before = edge.checked_sub(begin)?;
    (0 < before && before < length).then_some(before)
}

/// Columns or rows of a picture that a rectangle and its guard band involve.
struct Span {
    /// Those of blocks within the denoiser's support.
    touched: usize,
    /// Those of blocks wholly inside the rectangle.
    covered: usize,
}

impl Span {
    fn new(begin: u32, length: u32, edge: u32) -> Self {
        let end = begin + length;
        let from = begin.saturating_sub(SUPPORT) / BLOCK * BLOCK;
        let to = (end + SUPPORT).next_multiple_of(BLOCK).min(edge);
        // A block cut by the picture's edge counts as whole.
        let whole = if end == edge {
            end
        } else {
            end / BLOCK * BLOCK
        };
        Self {
            touched: (to - from) as usize,
            covered: whole.saturating_sub(begin.next_multiple_of(BLOCK)) as usize,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn tile(x: u32, y: u32, width: u32, height: u32) -> Tile {
        Tile {
            x,
            y,
            width,
            height,
        }
    }

    #[test]
    fn a_guard_band_is_a_block_wide_inside_a_picture() {
        let size = ImageSize::new(203, 117);
        assert_eq!(guarded_pixels(tile(32, 32, 32, 32), size), 48 * 48);
        assert_eq!(guarded_pixels(tile(8, 8, 8, 8), size), 24 * 24);
        assert_eq!(guarded_pixels(tile(0, 0, 32, 32), size), 40 * 40);
        assert_eq!(guarded_pixels(tile(0, 0, 203, 117), size), 203 * 117);
        let corner = (11 + 8) * (21 + 8);
        assert_eq!(guarded_pixels(tile(192, 96, 11, 21), size), corner);
        // Blocks that a tile has a part of are traced as a whole beside it.
        assert_eq!(guarded_pixels(tile(13, 13, 1, 1), size), 24 * 24 + 1);
        assert_eq!(guarded_pixels(tile(12, 12, 8, 8), size), 32 * 32 + 64);
    }

    #[test]
    fn a_run_is_priced_by_its_rectangles() {
        let grid = TileGrid::new(ImageSize::new(203, 117), 32);
        let run = |first, count| guarded_pixels_of_run(grid, TileRange { first, count });
        assert_eq!(run(0, grid.len()), 203 * 117);
        assert_eq!(run(9, 1), 48 * 48);
        assert_eq!(run(9, 3), (3 * 32 + 16) * 48);
        let (end, begin) = ((64 + 11 + 8) * 40, (64 + 8) * 48);
        assert_eq!(run(4, 5), end + begin);
        assert_eq!(run(4, 12), end + 203 * 48 + begin);
    }

    #[test]
    fn whatever_is_in_two_blocks_is_halved_between_them() {
        for (x, width) in (0..20).flat_map(|x| (1..40).map(move |width| (x, width))) {
            let whole = tile(x, 3, width, 5);
            let is_in_one_block = x / BLOCK == (x + width - 1) / BLOCK;
            assert_eq!(halves(whole).is_none(), is_in_one_block, "{whole:?}");
            let Some([left, right]) = halves(whole) else {
                continue;
            };
            assert_eq!(right.x % BLOCK, 0);
            assert_eq!(left.x + left.width, right.x);
            assert_eq!(left.width + right.width, width);
        }
        let [upper, lower] = halves(tile(8, 8, 16, 32)).unwrap();
        assert_eq!([upper, lower], [tile(8, 8, 16, 16), tile(8, 24, 16, 16)]);
        assert_eq!(first_block(tile(13, 8, 32, 4)), tile(13, 8, 3, 4));
    }
}
