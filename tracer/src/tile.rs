//! An image as tiles in a fixed order: the unit in which work is handed out.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::Error;

/// Width and height in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ImageSize {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl ImageSize {
    /// With `scale` times the edges, rounded, of a pixel at least.
    pub fn scaled(self, scale: f64) -> Self {
        let edge = |pixels: u32| ((f64::from(pixels) * scale).round() as u32).max(1);
        Self::new(edge(self.width), edge(self.height))
    }

    /// The widest and highest image that is traced; pixel coordinates share a 32-bit hash key.
    pub const EDGE_MAX: u32 = 16_384;

    /// An image of `width` columns and `height` rows.
    pub const fn new(width: u32, height: u32) -> Self {
        Self { width, height }
    }

    /// Number of pixels.
    pub const fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Checks that there is something to trace, and not too much.
    ///
    /// # Errors
    /// [`Error::InvalidSettings`] with the size and the range.
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

/// `WIDTHxHEIGHT`.
impl fmt::Display for ImageSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// `WIDTHxHEIGHT` in pixels, as people write it, checked by [`ImageSize::validate`].
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

/// A rectangle of pixels; row-major wherever its pixels are listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Tile {
    /// Leftmost column.
    pub x: u32,
    /// Topmost row.
    pub y: u32,
    /// Columns, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
}

impl Tile {
    /// Number of pixels.
    pub const fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }
}

/// An image cut into square tiles, numbered row by row from the top left. Those at the right and
/// bottom edges are as narrow as what is left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct TileGrid {
    /// The whole image.
    pub size: ImageSize,
    /// Pixels along a tile's edge, at least 1.
    pub edge: u16,
}

impl TileGrid {
    /// Cuts `size` into tiles of `edge` × `edge` pixels.
    ///
    /// # Panics
    /// If `edge` is 0.
    pub const fn new(size: ImageSize, edge: u16) -> Self {
        assert!(edge > 0);
        Self { size, edge }
    }

    /// Tiles in a row.
    pub const fn columns(self) -> u32 {
        self.size.width.div_ceil(self.edge as u32)
    }

    /// Tiles in a column.
    pub const fn rows(self) -> u32 {
        self.size.height.div_ceil(self.edge as u32)
    }

    /// Tiles in the image.
    pub const fn len(self) -> u32 {
        self.columns() * self.rows()
    }

    /// Whether the image has no pixel.
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// All tiles as one run.
    pub const fn all(self) -> TileRange {
        TileRange {
            first: 0,
            count: self.len(),
        }
    }

    /// The tile of number `index`.
    ///
    /// # Panics
    /// If `index` is not below [`TileGrid::len`].
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

    /// The tiles of a run, in order.
    pub fn tiles(self, run: TileRange) -> impl ExactSizeIterator<Item = Tile> {
        (run.first..run.end()).map(move |index| self.tile(index))
    }

    /// Number of pixels in a run's tiles.
    pub fn pixels(self, run: TileRange) -> usize {
        self.pixels_before(run.end()) - self.pixels_before(run.first)
    }

    /// Pixels of the tiles below `index`: whole rows of tiles, and the beginning of one.
    fn pixels_before(self, index: u32) -> usize {
        let (columns, edge) = (self.columns().max(1), u32::from(self.edge));
        let (row, column) = (index / columns, index % columns);
        let top = row.saturating_mul(edge).min(self.size.height);
        let height = edge.min(self.size.height - top);
        let width = column.saturating_mul(edge).min(self.size.width);
        top as usize * self.size.width as usize + width as usize * height as usize
    }
}

/// Tiles that follow one another in a [`TileGrid`]'s order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct TileRange {
    /// Number of the first tile.
    pub first: u32,
    /// How many tiles.
    pub count: u32,
}

impl TileRange {
    /// The number after the last tile, saturating.
    pub const fn end(self) -> u32 {
        self.first.saturating_add(self.count)
    }

    /// The tile numbers.
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
