//! The pixels of a tile message, as small as one core can make them while a frame waits.
//!
//! ```text
//! radiance ─▶ sRGB bytes ─▶ levels (precision) ─▶ minus neighbour or reference ─▶ planes ─▶ zstd 1
//!                        │                     └▶ few changed pixels ─▶ range coder
//!                        └▶ JPEG (the lossy precisions)
//!          ─▶ f16 or f32 bits ─▶ subtract green ─▶ minus the left neighbour ─▶ planes ─▶ zstd 1
//! ```
//!
//! A payload is one byte (bits 0–1: how the planes are stored, bit 2: whether modes follow, bits
//! 3–5: the [`PixelPrecision`]), four bits of mode a tile if any is not the usual one, and the planes:
//! as they are (noise does not shrink), as one zstd frame or as a JPEG scan; or, as long as few
//! pixels change, the changes of all tiles as one message of a range coder. Left prediction and
//! zstd level 1 were the best trade of 20 measured on this content; higher levels and the median
//! predictor of JPEG-LS were slower and no smaller. The tiles of a message, eight of 32 pixels,
//! are predicted one by one and compressed together.
//!
//! A [`ReferenceTile`] is a tile that the client said it holds; where nothing or little has
//! changed since, a tile is told from it. Which tile has which reference is the two sessions'
//! business, and both must come to the same.
//!
//! `carom-bench codec` measures rates and sizes on traced frames, still and moving. On
//! synthetic ones, `cargo run --release -p carom-protocol --example codec_speed` on one core of a
//! server of 2 (rates count the bytes of the pixels):
//!
//! | picture | format | bytes left | encode MB/s | decode MB/s |
//! |---|---|---|---|---|
//! | smooth | LinearF16 | 32.1 % | 444 | 1008 |
//! | smooth | LinearF32 | 60.1 % | 555 | 1331 |
//! | noisy | LinearF16 | 80.9 % | 277 | 634 |
//! | noisy | LinearF32 | 78.1 % | 634 | 1711 |

mod decode;
mod delta;
mod encode;
mod entropy;
mod header;

mod jpeg;

mod mode;
mod transform;

use std::sync::Arc;

use carom_tracer::Tile;

use self::transform::quantise as levels;
use crate::precision::PixelPrecision;

pub use decode::{Decoder, SrgbTiles};
pub use encode::Encoder;

/// Decoded pixels: tile after tile, each row-major.
#[derive(Clone, Debug, PartialEq)]
pub enum TilePixels {
    /// sRGB, from `PixelFormat::Srgb8`.
    Srgb8(Vec<[u8; 3]>),
    /// Linear radiance, from `PixelFormat::LinearF16` and `PixelFormat::LinearF32`.
    Linear(Vec<[f32; 3]>),
}

impl TilePixels {
    /// Number of pixels.
    pub fn len(&self) -> usize {
        match self {
            Self::Srgb8(pixels) => pixels.len(),
            Self::Linear(pixels) => pixels.len(),
        }
    }

    /// Whether there is no pixel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// An sRGB tile as both ends remember it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReferenceTile {
    /// Row-major. Of a lossy tile the client keeps what it has shown, the node what it was made
    /// of: it can be repeated, but nothing can be told from it.
    pixels: Box<[[u8; 3]]>,
    precision: PixelPrecision,
}

impl ReferenceTile {
    /// Bytes in memory, nearly.
    pub fn bytes(&self) -> usize {
        self.pixels.as_flattened().len()
    }

    /// What a tile of `pixels` pixels may be told from at `precision`.
    fn base(&self, precision: PixelPrecision, pixels: usize) -> Option<&[[u8; 3]]> {
        let exact = self.precision.step().is_some() && precision.step().is_some();
        (exact && self.pixels.len() == pixels).then_some(&*self.pixels)
    }

    /// The same at `precision`, if something may be told from it at that.
    fn rounded(self: &Arc<Self>, precision: PixelPrecision, tile: Tile) -> Option<Arc<Self>> {
        let base = self.base(precision, tile.pixels())?;
        if self.precision == precision {
            return Some(Arc::clone(self));
        }
        let pixels = levels::rounded(precision.step()?, tile.width as usize, base);
        Some(Arc::new(Self { pixels, precision }))
    }

    /// How many of `pixels`, of the same tile, are shown otherwise as yet; all, if it has another size.
    fn changed(&self, width: u32, pixels: &[[u8; 3]]) -> usize {
        if self.pixels.len() != pixels.len() {
            return pixels.len();
        }
        let count = |pixels: &[[u8; 3]]| {
            let pairs = self.pixels.iter().zip(pixels);
            pairs.filter(|(before, now)| before != now).count()
        };
        match self.precision.step() {
            Some(step) if step > 1 => count(&levels::rounded(step, width as usize, pixels)),
            _ => count(pixels),
        }
    }
}

/// How a message's pixels stand to what the client was sent before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DeltaStats {
    /// Pixels of tiles that it was sent before ...
    pub referenced: usize,
    /// ... and of them, those that are others now.
    pub changed: usize,
    /// Pixels of tiles that are told from nothing, for they are new or were told with losses.
    pub intra: usize,
}

impl DeltaStats {
    /// Adds a tile; `changed` is `None` for one that the client was not sent before.
    fn add(&mut self, pixels: usize, is_intra: bool, changed: Option<usize>) {
        if let Some(changed) = changed {
            self.referenced += pixels;
            self.changed += changed;
        }
        if is_intra {
            self.intra += pixels;
        }
    }
}

/// A traced tile that is to be sent as sRGB.
#[derive(Clone, Copy, Debug)]
pub struct TileInput<'a> {
    /// Its place in the picture.
    pub tile: Tile,
    /// Row-major.
    pub radiance: &'a [[f32; 3]],
    /// What the client holds there.
    pub reference: Option<&'a Arc<ReferenceTile>>,
}
