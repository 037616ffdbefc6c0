//! Images of linear radiance.

use crate::{ImageSize, Tile};

/// Radiance per pixel: linear Rec. 709, W·sr⁻¹·m⁻².
#[derive(Clone, Debug, PartialEq)]
pub struct RadianceImage {
    /// Width and height in pixels.
    pub size: ImageSize,
    /// `size.pixels()` pixels in row-major order, from the top left.
    pub pixels: Vec<[f32; 3]>,
}

impl RadianceImage {
    /// A black image.
    pub fn black(size: ImageSize) -> Self {
        Self {
            size,
            pixels: vec![[0.0; 3]; size.pixels()],
        }
    }

    /// The pixels of a tile in row-major order.
    ///
    /// # Panics
    /// If the tile does not lie in the image.
    pub fn cut(&self, tile: Tile) -> Vec<[f32; 3]> {
        let width = self.size.width as usize;
        let columns = tile.x as usize..(tile.x + tile.width) as usize;
        let rows = (tile.y as usize..(tile.y + tile.height) as usize).map(|row| row * width);
        rows.flat_map(|row| &self.pixels[row + columns.start..row + columns.end])
            .copied()
            .collect()
    }
}
