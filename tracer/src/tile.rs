//! Images as tiles in a fixed order, the unit in which work is distributed.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::Error;

/// Width and height in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ImageSize {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
}

impl ImageSize {
    /// The size with both edges multiplied by `scale` and rounded, each at least 1.
    pub fn scaled(self, scale: f64) -> Self {
        let edge = |pixels: u32| ((f64::from(pixels) * scale).round() as u32).max(1);
        Self::new(edge(self.width), edge(self.height))
    }

    /// Maximum width and height of an image; pixel coordinates share a 32-bit hash key.
    pub const EDGE_MAX: u32 = 16_384;

    /// A size of `width` × `height` pixels.
    pub const fn new(width: u32, height: u32) -> Self {
        Self { width, height }
    }

    /// Number of pixels.
    pub const fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Checks that width and height are within their range.
    ///
    /// # Errors
    /// [`Error::InvalidSettings`] with the size and its range.
    pub fn validate(self) -> Result<(), Error> {
        let range = 1..=Self::EDGE_MAX;
        if range.contains(&self.width) && range.contains(&self.height) {
            return Ok(());
        }
        Err(Error::settings(format!(
            "the image is {self} pixels: width and height must be from 1 to {}",
            Self::EDGE_MAX
        )))
    }
}

/// Formats as `WIDTHxHEIGHT`.
impl fmt::Display for ImageSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// Parses `WIDTHxHEIGHT` in pixels and checks it with [`ImageSize::validate`].
impl FromStr for ImageSize {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let edges = text
            .split_once('x')
            .and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
        let Some((width, height)) = edges else {
            return Err(Error::settings(format!(
                "`{text}` is not WIDTHxHEIGHT in pixels, as in 1280x720"
            )));
        };
        let size = Self { width, height };
        size.validate()?;
        Ok(size)
    }
}

/// A rectangle of pixels, which are always listed in row-major order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Tile {
    /// Leftmost column.
    pub x: u32,
    /// Topmost row.
    pub y: u32,
    /// Width in pixels, at least 1.
    pub width: u32,
    /// Height in pixels, at least 1.
    pub height: u32,
}

impl Tile {
    /// Number of pixels.
    pub const fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// An image divided into square tiles, numbered row by row from the top left. Tiles at the right
/// and bottom edges may be smaller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct TileGrid {
    /// Size of the image.
    pub size: ImageSize,
    /// Edge length of a tile in pixels, at least 1.
    pub edge: u16,
}

impl TileGrid {
    /// Divides an image of `size` into tiles of `edge` × `edge` pixels.
    ///
    /// # Panics
    /// If `edge` is 0.
    pub const fn new(size: ImageSize, edge: u16) -> Self {
        assert!(edge > 0);
        Self { size, edge }
    }

    /// Number of tiles per row.
    pub const fn columns(self) -> u32 {
        self.size.width.div_ceil(self.edge as u32)
    }

    /// Number of rows of tiles.
    pub const fn rows(self) -> u32 {
        self.size.height.div_ceil(self.edge as u32)
    }

    /// Number of tiles of the image.
    pub const fn len(self) -> u32 {
        self.columns() * self.rows()
    }

    /// Whether the image has no pixels.
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// The range of all tiles.
    pub const fn all(self) -> TileRange {
        TileRange {
            first: 0,
            count: self.len(),
        }
    }

    /// The tile with index `index`.
    ///
    /// # Panics
    /// If `index` is not less than [`TileGrid::len`].
    pub fn tile(self, index: u32) -> Tile {
        assert!(index < self.len(), "tile {index} of {}", self.len());
        let edge = u32::from(self.edge);
        let (x, y) = (index % self.columns() * edge, index / self.columns() * edge);
        let width = edge.min(self.size.width - x);
        let height = edge.min(self.size.height - y);
        Tile {
            x,
            y,
            width,
            height,
        }
    }

    /// The tiles of a range, in order.
    pub fn tiles(self, run: TileRange) -> impl ExactSizeIterator<Item = Tile> {
        (run.first..run.end()).map(move |index| self.tile(index))
    }

    /// Number of pixels in the tiles of a range.
    pub fn pixels(self, run: TileRange) -> usize {
        self.pixels_before(run.end()) - self.pixels_before(run.first)
    }

    /// Number of pixels of the tiles before `index`: whole rows of tiles and a part of one.
    fn pixels_before(self, index: u32) -> usize {
        let (columns, edge) = (self.columns().max(1), u32::from(self.edge));
        let (row, column) = (index / columns, index % columns);
        let top = row.saturating_mul(edge).min(self.size.height);
        let height = edge.min(self.size.height - top);
        let width = column.saturating_mul(edge).min(self.size.width);
        top as usize * self.size.width as usize + width as usize * height as usize
    }
}

/// A range of consecutive tiles, in the order of a [`TileGrid`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct TileRange {
    /// Index of the first tile.
    pub first: u32,
    /// Number of tiles.
    pub count: u32,
}

impl TileRange {
    /// Index after the last tile, saturating.
    pub const fn end(self) -> u32 {
        self.first.saturating_add(self.count)
    }

    /// The tiles' indices.
    pub const fn indices(self) -> std::ops::Range<u32> {
        self.first..self.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_each_pixel_once() {
        let grid = TileGrid::new(ImageSize::new(101, 67), 32);
        let mut seen = vec![0u8; grid.size.pixels()];
        for tile in grid.tiles(grid.all()) {
            for y in tile.y..tile.y + tile.height {
                for x in tile.x..tile.x + tile.width {
                    seen[(y * 101 + x) as usize] += 1;
                }
            }
        }
        assert!(seen.iter().all(|&count| count == 1));
    }

    #[test]
    fn a_run_has_the_pixels_of_its_tiles() {
        let grid = TileGrid::new(ImageSize::new(101, 67), 32);
        for first in 0..grid.len() {
            for count in 0..=grid.len() - first {
                let run = TileRange { first, count };
                let pixels: usize = grid.tiles(run).map(Tile::pixels).sum();
                assert_eq!(grid.pixels(run), pixels, "{run:?}");
            }
        }
    }

    #[test]
    fn sizes_parse_and_errors_quote_the_text() {
        assert_eq!(
            "640x360".parse::<ImageSize>().unwrap(),
            ImageSize::new(640, 360)
        );
        for wrong in [
            "640",
            "x",
            "640x",
            "-1x5",
            "640x360x2",
            "640*3",
            "99999999999x1",
        ] {
            let why = wrong.parse::<ImageSize>().unwrap_err().to_string();
            assert!(why.contains(wrong), "{why}");
        }
        for wrong in ["0x5", "5x0", "5x20000", "100000x100000"] {
            let why = wrong.parse::<ImageSize>().unwrap_err().to_string();
            assert!(why.contains(wrong) && why.contains("16384"), "{why}");
        }
    }

    #[test]
    fn an_empty_image_has_no_tile() {
        assert!(TileGrid::new(ImageSize::new(0, 480), 32).is_empty());
    }
}
