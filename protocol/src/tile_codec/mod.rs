//! The pixels of a tile message: lossless, and as small as one core can make them while a frame
//! waits.
//!
//! ```text
//! radiance ─▶ samples (sRGB bytes, f16 bits, f32 bits)
//!          ─▶ subtract green ─▶ minus the left neighbour ─▶ byte planes ─▶ zstd level 1
//! ```
//!
//! A payload is one byte that says how the planes are stored, and the planes: as they are
//! (noise does not shrink) or as one zstd frame. Left prediction and zstd level 1 were the best
//! trade of 20 measured on this content; higher levels and the median predictor of JPEG-LS were
//! slower and no smaller. The tiles of a message are predicted one by one and compressed together.
//!
//! Figures of `cargo run --release -p carom-protocol --example codec_speed` on one core of a
//! server of 2 (tiles of 32 pixels, eight to a message; rates count the bytes of the pixels):
//!
//! | picture | format | bytes left | encode MB/s | decode MB/s |
//! |---|---|---|---|---|
//! | smooth | Srgb8 | 19.5 % | 238 | 523 |
//! | smooth | LinearF16 | 32.1 % | 444 | 1008 |
//! | smooth | LinearF32 | 60.1 % | 555 | 1331 |
//! | noisy | Srgb8 | 81.3 % | 363 | 584 |
//! | noisy | LinearF16 | 80.9 % | 277 | 634 |
//! | noisy | LinearF32 | 78.1 % | 634 | 1711 |

mod planes;

use carom_tracer::Tile;
use carom_tracer::tonemap::srgb8;
use half::slice::{HalfBitsSliceExt, HalfFloatSliceExt};
use zstd::bulk::{Compressor, Decompressor};
use zstd::zstd_safe;

use crate::Error;
use crate::limits::PIXELS_PER_MESSAGE_MAX;
use crate::message::PixelFormat;

/// Decoded pixels: tile after tile, each row-major.
#[derive(Clone, Debug, PartialEq)]
pub enum TilePixels {
    /// sRGB, from [`PixelFormat::Srgb8`].
    Srgb8(Vec<[u8; 3]>),
    /// Linear radiance, from [`PixelFormat::LinearF16`] and [`PixelFormat::LinearF32`].
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

/// Turns radiance into payloads. Keep one per thread: its buffers and its zstd context, some
/// 600 kB, are used again.
pub struct Encoder {
    zstd: Compressor<'static>,
    planes: Vec<u8>,
}

impl Encoder {
    /// An encoder with empty buffers.
    ///
    /// # Panics
    /// If there is no memory for a zstd context.
    pub fn new() -> Self {
        let zstd = Compressor::new(ZSTD_LEVEL).expect("memory for a zstd context");
        let planes = Vec::new();
        Self { zstd, planes }
    }

    /// The payload of `tiles`, each with its radiance, row-major. The same radiance gives the same
    /// pixels on every machine.
    ///
    /// [`PixelFormat::LinearF16`] rounds to the nearest half float, of which ±65504 are the
    /// outermost; NaN stays NaN. [`PixelFormat::LinearF32`] keeps each bit.
    ///
    /// # Panics
    /// If a tile's radiance is not as long as the tile has pixels, or there are more than
    /// [`PIXELS_PER_MESSAGE_MAX`] pixels.
    pub fn encode(&mut self, format: PixelFormat, tiles: &[(Tile, &[[f32; 3]])]) -> Vec<u8> {
        let pixels: usize = tiles.iter().map(|(tile, _)| tile.pixels()).sum();
        assert!(pixels <= PIXELS_PER_MESSAGE_MAX, "{pixels} pixels");
        for (tile, radiance) in tiles {
            assert_eq!(tile.pixels(), radiance.len(), "radiance of {tile:?}");
        }
        self.planes.resize(pixels * format.bytes(), 0);
        match format {
            PixelFormat::Srgb8 { exposure } => {
                planes::split(&mut self.planes, tiles, |pixel| srgb8(pixel, exposure));
            }
            PixelFormat::LinearF16 => planes::split(&mut self.planes, tiles, f16_bits),
            PixelFormat::LinearF32 => {
                planes::split(&mut self.planes, tiles, |pixel| pixel.map(f32::to_bits));
            }
        }
        self.pack()
    }

    /// The planes behind their header, compressed if that gains anything.
    fn pack(&mut self) -> Vec<u8> {
        // One byte short of what storing takes: zstd fails if it does not gain.
        let mut payload = vec![0; self.planes.len().max(1)];
        payload[0] = ZSTD;
        match self
            .zstd
            .compress_to_buffer(&self.planes, &mut payload[1..])
        {
            Ok(length) => payload.truncate(1 + length),
            Err(_) => {
                payload.truncate(1);
                payload[0] = STORED;
                payload.extend_from_slice(&self.planes);
            }
        }
        payload
    }
}

impl Default for Encoder {
    fn default() -> Self {
        Self::new()
    }
}

/// Turns payloads into pixels. Keep one per thread or connection: its buffer and its zstd context,
/// some 160 kB, are used again.
pub struct Decoder {
    zstd: Decompressor<'static>,
    planes: Vec<u8>,
}

impl Decoder {
    /// A decoder with an empty buffer.
    ///
    /// # Panics
    /// If there is no memory for a zstd context.
    pub fn new() -> Self {
        let zstd = Decompressor::new().expect("memory for a zstd context");
        let planes = Vec::new();
        Self { zstd, planes }
    }

    /// The pixels of `tiles`, which are those that the client asked for: from them and `format`
    /// follows the one size that the payload may decompress to, and nothing beyond it is
    /// allocated, whatever the payload says.
    ///
    /// # Errors
    /// [`Error::TooLarge`] for more than [`PIXELS_PER_MESSAGE_MAX`] pixels; [`Error::Malformed`]
    /// if the payload is not exactly one stored or compressed set of planes of that size.
    pub fn decode(
        &mut self,
        format: PixelFormat,
        tiles: &[Tile],
        payload: &[u8],
    ) -> Result<TilePixels, Error> {
        let pixels: usize = tiles.iter().map(|tile| tile.pixels()).sum();
        if pixels > PIXELS_PER_MESSAGE_MAX {
            let (bytes, max) = (pixels, PIXELS_PER_MESSAGE_MAX);
            let [bytes, max] = [bytes, max].map(|pixels| (pixels * format.bytes()) as u64);
            return Err(Error::TooLarge {
                what: WHAT,
                bytes,
                max,
            });
        }
        let size = pixels * format.bytes();
        let planes = match payload.split_first() {
            Some((&STORED, planes)) if planes.len() == size => planes,
            Some((&STORED, planes)) => {
                let why = format!("{} bytes are stored for {size}", planes.len());
                return Err(Error::malformed(WHAT, why));
            }
            Some((&ZSTD, frame)) => self.decompress(frame, size)?,
            _ => {
                return Err(Error::malformed(
                    WHAT,
                    "its first byte names no way of storing",
                ));
            }
        };
        Ok(match format {
            PixelFormat::Srgb8 { .. } => TilePixels::Srgb8(planes::join(planes, tiles)),
            PixelFormat::LinearF16 => TilePixels::Linear(from_f16(&planes::join(planes, tiles))),
            PixelFormat::LinearF32 => TilePixels::Linear(from_f32(&planes::join(planes, tiles))),
        })
    }

    fn decompress(&mut self, frame: &[u8], size: usize) -> Result<&[u8], Error> {
        check_frame(frame, size).map_err(|why| Error::malformed(WHAT, why))?;
        self.planes.resize(size, 0);
        match self.zstd.decompress_to_buffer(frame, &mut self.planes[..]) {
            Ok(length) if length == size => Ok(&self.planes),
            Ok(length) => Err(Error::malformed(WHAT, format!("{length} bytes for {size}"))),
            Err(error) => Err(Error::malformed(WHAT, error.to_string())),
        }
    }
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

/// One zstd frame (RFC 8878), all of the bytes, without a dictionary, of a stated size that is
/// `size`. Zstd alone would also take several frames, skippable ones among them.
fn check_frame(frame: &[u8], size: usize) -> Result<(), String> {
    if !frame.starts_with(&zstd_safe::MAGICNUMBER.to_le_bytes()) {
        return Err("it is no zstd frame".into());
    }
    if zstd_safe::get_dict_id_from_frame(frame).is_some() {
        return Err("it asks for a dictionary".into());
    }
    match zstd_safe::get_frame_content_size(frame) {
        Ok(Some(stated)) if stated == size as u64 => {}
        Ok(Some(stated)) => return Err(format!("it states {stated} bytes for {size}")),
        _ => return Err("it states no size".into()),
    }
    match zstd_safe::find_frame_compressed_size(frame) {
        Ok(length) if length == frame.len() => Ok(()),
        Ok(length) => Err(format!("{} bytes follow its end", frame.len() - length)),
        Err(_) => Err("its frame is cut short".into()),
    }
}

fn f16_bits(pixel: [f32; 3]) -> [u16; 3] {
    let limit = half::f16::MAX.to_f32();
    pixel.map(|channel| half::f16::from_f32(channel.clamp(-limit, limit)).to_bits())
}

/// All at once: for one number at a time, `half` asks each time what the processor can do.
fn from_f16(bits: &[[u16; 3]]) -> Vec<[f32; 3]> {
    let mut pixels = vec![[0.0; 3]; bits.len()];
    let halves: &[half::f16] = bits.as_flattened().reinterpret_cast();
    halves.convert_to_f32_slice(pixels.as_flattened_mut());
    pixels
}

fn from_f32(bits: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let pixels = bits.iter().map(|pixel| pixel.map(f32::from_bits));
    pixels.collect()
}

const WHAT: &str = "tile payload";
/// First byte of a payload: planes as they are.
const STORED: u8 = 0;
/// First byte of a payload: planes as one zstd frame.
const ZSTD: u8 = 1;
/// Level 3 was larger and 2 to 4 times slower on noise once a predictor is used.
const ZSTD_LEVEL: i32 = 1;
