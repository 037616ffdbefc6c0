//! Codec of the pixels of a tile message.
//!
//! ```text
//!            transform                      delta                       entropy
//! radiance ▶ sRGB bytes ▶ quantised levels ▶ minus the left neighbour ▶ planes ▶ zstd level 1
//!                      │                  ├▶ mask, and minus reference ▶ planes ▶ zstd level 1
//!                      │                  └▶ mask, and minus reference ▶ range coder
//!                      └▶ JPEG (the lossy precisions)
//!          ▶ bits of f16 or f32 ▶ minus green, minus the left neighbour ▶ byte planes ▶ zstd level 1
//! ```
//!
//! `protocol/WIRE.md` specifies a payload's bytes. The tiles of a message, eight of 32×32 pixels, are
//! transformed one by one and compressed together. A tile is delta-coded against a [`ReferenceTile`]
//! that the client has stated it holds; the two sessions agree on which tile has which reference.
//!
//! # Decisions
//!
//! A part stays if the pool table at 1280×720 and 60 frames a second takes at least 10 % more bytes
//! without it where it applies. Each figure is the change in bytes against the codec at the time of the
//! measurement, with all other parts on, over the precisions `exact`, `within1` and `within2` and over frames
//! of 4 samples, the same denoised, and of 64 samples. "Balls" are six that roll under a still camera.
//! `carom-bench codec` reproduces the rows of parts that exist.
//!
//! | part | without it: intra | balls | moving camera | decision |
//! |---|---|---|---|---|
//! | delta coding, against intra planes under zstd | | ×3.8 to ×13.5 | ×1.3 to ×4.0 | stays |
//! | delta mask, in planes under zstd | | 0 to +16 % | +10 to +27 % | stays |
//! | range coder, against zstd of mask and values | | +20 to +73 % | +4 to +17 % | stays |
//! | its chroma from the nearest neighbour | | +9 to +30 % | -1 to +4 % | stays |
//! | its green from the median of neighbours | | -4 to +9 % | -2 to +2 % | stays: no code less |
//! | its chroma scaled, not shifted, with green | | -1 to +4 % | -2 to +1 % | gone |
//! | planes of all differences to the reference | | 0 to +1 % | 0 to +9 % | gone: the mask serves |
//! | red and blue minus green's difference | -2 to +1 % | 0 % | -1 to 0 % | gone |
//! | red and blue minus their ratio to green's | 0 to +1 % | 0 to +2 % | +1 to +4 % | gone |
//! | red and blue by themselves | 0 to +23 % | 0 to +1 % | +1 to +3 % | stays, alone |
//! | levels that alternate by row | -27 to -2 % | -10 to -1 % | -12 to -2 % | stays: FLIP is ×1.5 to ×3.4 without |
//!
//! The removal of all parts that are gone changes the bytes by -2 to +6 % at 640×360, most with exact pixels
//! and six rolling balls, and makes the encoder 10 to 20 % faster; for 128×72 noisy pixels, exact and right
//! after a camera cut, it costs 19 %. Mbit/s with 4 samples / denoised, and MB/s of sRGB pixels that a core
//! encodes and decodes:
//!
//! | precision | intra | encode | decode | balls | encode | decode | moving camera | encode | decode |
//! |---|---|---|---|---|---|---|---|---|---|
//! | exact | 482 / 169 | 209 / 243 | 823 / 802 | 36 / 44 | 285 / 260 | 459 / 578 | 154 / 132 | 192 / 189 | 579 / 570 |
//! | within1 | 314 / 116 | 143 / 180 | 610 / 869 | 25 / 20 | 180 / 179 | 415 / 415 | 85 / 75 | 144 / 141 | 425 / 441 |
//! | within2 | 253 / 99 | 151 / 182 | 612 / 881 | 20 / 16 | 186 / 188 | 453 / 467 | 64 / 55 | 147 / 151 | 419 / 439 |
//! | lossy90 | 57 / 39 | 132 / 136 | 455 / 506 | 50 / 32 | 160 / 164 | 577 / 628 | 55 / 37 | 143 / 148 | 521 / 575 |
//! | lossy75 | 21 / 18 | 195 / 197 | 381 / 394 | 17 / 15 | 226 / 226 | 497 / 489 | 20 / 17 | 205 / 206 | 443 / 448 |
//! | lossy50 | 15 / 14 | 197 / 200 | 391 / 405 | 12 / 11 | 230 / 228 | 517 / 504 | 14 / 13 | 208 / 207 | 460 / 449 |
//!
//! The column "intra" is also what zstd planes and JPEG alone take, whatever moves. A still camera
//! whose frames repeat takes 1 Mbit/s at each precision. Each precision takes at least 10 % fewer
//! bytes than the one before, intra and with a moving camera, so all six stay.
//!
//! Left prediction and zstd level 1 were the best trade of 20 measured on such frames; higher levels
//! and the median predictor of JPEG-LS were slower and no smaller. On synthetic frames `cargo run
//! --release -p carom-protocol --example codec_speed` measures linear pixels on one core:
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
mod transform;

use std::sync::Arc;

use carom_tracer::Tile;
use carom_tracer::tonemap::srgb8;

use self::decode::from_f16;
pub(crate) use self::decode::{NO_STORAGE, check_frame, undecompressed};
use self::encode::f16_bits;
use crate::message::PixelFormat;

pub use decode::{Decoder, SrgbTiles};
pub use delta::reference::{DeltaStats, ReferenceTile};
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

    /// The pixels that a decoder returns for these tiles after an exact encoder, bit for bit.
    pub fn of(format: PixelFormat, tiles: &[(Tile, &[[f32; 3]])]) -> Self {
        let radiance = tiles.iter().flat_map(|(_, radiance)| *radiance);
        let count = tiles.iter().map(|(_, radiance)| radiance.len()).sum();
        match format {
            PixelFormat::Srgb8 { exposure } => {
                let mut pixels = Vec::with_capacity(count);
                pixels.extend(radiance.map(|light| srgb8(*light, exposure)));
                Self::Srgb8(pixels)
            }
            PixelFormat::LinearF16 => {
                let bits: Vec<[u16; 3]> = radiance.map(|light| f16_bits(*light)).collect();
                Self::Linear(from_f16(&bits))
            }
            PixelFormat::LinearF32 => Self::Linear(radiance.copied().collect()),
        }
    }

    /// Whether they are `count` pixels of that format.
    pub fn fits(&self, format: PixelFormat, count: usize) -> bool {
        let is_srgb = matches!(format, PixelFormat::Srgb8 { .. });
        is_srgb == matches!(self, Self::Srgb8(_)) && self.len() == count
    }

    /// Bytes that the pixels occupy in memory.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Srgb8(pixels) => size_of_val(&pixels[..]),
            Self::Linear(pixels) => size_of_val(&pixels[..]),
        }
    }

    /// Whether there is no pixel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A traced tile to be encoded as sRGB.
#[derive(Clone, Copy, Debug)]
pub struct TileInput<'a> {
    /// Its place in the frame.
    pub tile: Tile,
    /// Its pixels, row-major.
    pub radiance: &'a [[f32; 3]],
    /// The tile that the client holds at this place.
    pub reference: Option<&'a Arc<ReferenceTile>>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_pixels_are_those_of_the_codec() {
        let tile = |x| Tile {
            x,
            y: 0,
            width: 8,
            height: 4,
        };
        let mut light = 1e-6;
        let mut radiance = || -> Vec<[f32; 3]> {
            let mut next = || {
                light *= 1.13;
                light
            };
            (0..32).map(|_| [next(), -next(), next()]).collect()
        };
        let (near, far) = (radiance(), radiance());
        let tiles = [(tile(0), &near[..]), (tile(8), &far[..])];
        for format in [
            PixelFormat::Srgb8 { exposure: 0.7 },
            PixelFormat::LinearF16,
            PixelFormat::LinearF32,
        ] {
            let payload = Encoder::new().encode(format, &tiles);
            let decoded = Decoder::new().decode(format, &[tile(0), tile(8)], &payload);
            let shared = TilePixels::of(format, &tiles);
            assert!(shared.fits(format, 64));
            assert_eq!(Ok(shared), decoded);
        }
    }
}
