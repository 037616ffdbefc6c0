//! Presentation without a GPU: the CPU scales the picture and draws the user interface.

use std::num::NonZeroU32;
use std::sync::Arc;

use carom_tracer::ImageSize;
use winit::event_loop::OwnedDisplayHandle;
use winit::window::Window;

use super::raster::{Canvas, Rasterizer};
use super::{DisplayFault, DisplayFrame, UiFrame};

/// Display of a window through a buffer in memory.
pub struct SoftwareDisplay {
    surface: softbuffer::Surface<OwnedDisplayHandle, Arc<Window>>,
    size: ImageSize,
    rasterizer: Rasterizer,
    /// The picture scaled to the window's size, and the serial number and size for which it was made.
    scaled: Vec<u32>,
    scaled_of: Option<(u64, ImageSize)>,
}

impl SoftwareDisplay {
    /// Opens the window's buffer.
    ///
    /// # Errors
    /// The system's reason.
    pub fn open(window: Arc<Window>, display: OwnedDisplayHandle) -> Result<Self, DisplayFault> {
        let context = softbuffer::Context::new(display)?;
        let surface = softbuffer::Surface::new(&context, window)?;
        Ok(Self {
            surface,
            size: ImageSize::new(0, 0),
            rasterizer: Rasterizer::default(),
            scaled: Vec::new(),
            scaled_of: None,
        })
    }

    /// Adapts to the window's size.
    pub fn resize(&mut self, size: ImageSize) {
        self.size = size;
    }

    /// Draws and presents a frame.
    ///
    /// # Errors
    /// The system's reason.
    pub fn show(
        &mut self,
        picture: Option<&DisplayFrame>,
        ui: &UiFrame,
    ) -> Result<(), DisplayFault> {
        self.rasterizer.set_textures(&ui.textures);
        let shown = self.draw(picture, ui);
        self.rasterizer.free_textures(&ui.textures);
        Ok(shown?)
    }

    fn draw(
        &mut self,
        picture: Option<&DisplayFrame>,
        ui: &UiFrame,
    ) -> Result<(), softbuffer::SoftBufferError> {
        let [width, height] = [self.size.width, self.size.height].map(NonZeroU32::new);
        let (Some(width), Some(height)) = (width, height) else {
            return Ok(());
        };
        self.surface.resize(width, height)?;
        self.scale(picture);
        let mut buffer = self.surface.buffer_mut()?;
        if self.scaled.len() == buffer.len() {
            buffer.copy_from_slice(&self.scaled);
        }
        let mut canvas = Canvas {
            width: width.get() as usize,
            pixels: &mut buffer,
        };
        self.rasterizer
            .draw(&mut canvas, &ui.primitives, ui.pixels_per_point);
        buffer.present()
    }

    fn scale(&mut self, picture: Option<&DisplayFrame>) {
        let Some(picture) = picture else {
            self.scaled.clear();
            self.scaled.resize(self.size.pixels(), 0);
            self.scaled_of = None;
            return;
        };
        let of = Some((picture.serial, self.size));
        if self.scaled_of != of {
            scale_linear(picture, self.size, &mut self.scaled);
            self.scaled_of = of;
        }
    }
}

/// Scales `picture` to `size` with bilinear filtering between pixel centres, as a GPU does; writes 0RGB
/// words.
pub fn scale_linear(picture: &DisplayFrame, size: ImageSize, out: &mut Vec<u32>) {
    out.clear();
    let columns = taps(picture.size.width, size.width);
    for (top, bottom, fy) in taps(picture.size.height, size.height) {
        let row = |y: usize| &picture.rgba[y * picture.size.width as usize..];
        let (upper, lower) = (row(top), row(bottom));
        out.extend(columns.iter().map(|&(left, right, fx)| {
            let channel = |i: usize| {
                // Weights of 8 fractional bits in each direction: their products have 16, rounded at the end.
                let mix = |row: &[[u8; 4]]| {
                    u32::from(row[left][i]) * (256 - fx) + u32::from(row[right][i]) * fx
                };
                (mix(upper) * (256 - fy) + mix(lower) * fy + (1 << 15)) >> 16
            };
            channel(0) << 16 | channel(1) << 8 | channel(2)
        }));
    }
}

/// For each of `to` pixels the two of `from` between whose centres it lies, and the second's weight of 256.
fn taps(from: u32, to: u32) -> Vec<(usize, usize, u32)> {
    let last = f64::from(from) - 1.0;
    (0..to)
        .map(|i| {
            let center = (f64::from(i) + 0.5) * f64::from(from) / f64::from(to) - 0.5;
            let center = center.clamp(0.0, last);
            let first = center.floor();
            let second = (first + 1.0).min(last);
            (
                first as usize,
                second as usize,
                ((center - first) * 256.0).round() as u32,
            )
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scaled(picture: &DisplayFrame, width: u32, height: u32) -> Vec<u32> {
        let mut out = Vec::new();
        scale_linear(picture, ImageSize::new(width, height), &mut out);
        out
    }

    fn picture(width: u32, height: u32, gray: &[u8]) -> DisplayFrame {
        DisplayFrame {
            update: carom_tracer::SceneUpdate::default(),
            serial: 1,
            size: ImageSize::new(width, height),
            rgba: gray.iter().map(|&v| [v, v, v, 255]).collect(),
        }
    }

    #[test]
    fn the_same_size_is_the_same_picture() {
        let picture = picture(3, 2, &[0, 50, 100, 150, 200, 250]);
        let expected: Vec<u32> = [0, 50, 100, 150, 200, 250].map(|v| v * 0x01_01_01).to_vec();
        assert_eq!(scaled(&picture, 3, 2), expected);
    }

    #[test]
    fn a_gradient_stays_a_gradient_and_edges_are_kept() {
        let wide = scaled(&picture(2, 1, &[0, 200]), 8, 3);
        let row: Vec<u32> = wide[..8].iter().map(|p| p & 0xFF).collect();
        assert_eq!(row, [0, 0, 25, 75, 125, 175, 200, 200]);
        assert_eq!(wide[..8], wide[16..]);
    }
}
