//! Payloads to pixels.

use std::ops::RangeInclusive;
use std::sync::Arc;

use carom_tracer::Tile;
use fearless_simd::Level;
use half::slice::{HalfBitsSliceExt, HalfFloatSliceExt};
use zstd::bulk::Decompressor;
use zstd::zstd_safe;

use super::delta::delta_mask::Changes;
use super::entropy::range_coder::RangeDecoder;
use super::header::{CHANGES, Header, JPEG, STORED, ZSTD};
use super::mode::{Base, Mode};
use super::transform::inverse::Reader;
use super::transform::{float_planes as planes, quantise as levels};
use super::{ReferenceTile, TilePixels, jpeg};
use crate::Error;
use crate::limits::PIXELS_PER_MESSAGE_MAX;
use crate::message::PixelFormat;
use crate::precision::{PixelPrecision, PrecisionRange};

/// sRGB tiles out of a payload.
#[derive(Clone, Debug)]
pub struct SrgbTiles {
    /// Tile after tile, each row-major.
    pub pixels: Vec<[u8; 3]>,
    /// The tiles, to be remembered.
    pub references: Vec<Arc<ReferenceTile>>,
    /// What the node chose.
    pub precision: PixelPrecision,
}

/// Turns payloads into pixels. Keep one per thread or connection: its buffer and its zstd context,
/// some 160 kB, are used again.
pub struct Decoder {
    zstd: Decompressor<'static>,
    planes: Vec<u8>,
    changes: Changes,
    level: Level,
}

impl Decoder {
    /// A decoder with an empty buffer.
    ///
    /// # Panics
    /// If there is no memory for a zstd context.
    pub fn new() -> Self {
        let zstd = Decompressor::new().expect("memory for a zstd context");
        Self {
            zstd,
            planes: Vec::new(),
            changes: Changes::new(),
            level: Level::new(),
        }
    }

    /// The pixels of `tiles`, which are those that the client asked for: from them and `format`
    /// follows the one size that the payload may decompress to, and nothing beyond it is
    /// allocated, whatever the payload says. Takes what `Encoder::encode` makes.
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
        if let PixelFormat::Srgb8 { .. } = format {
            let apart: Vec<_> = tiles.iter().map(|tile| (*tile, None)).collect();
            let decoded = self.decode_srgb(PrecisionRange::EXACT, &apart, payload)?;
            return Ok(TilePixels::Srgb8(decoded.pixels));
        }
        let size = checked_pixels(tiles.iter().copied(), format)? * format.bytes();
        let planes = match payload.split_first() {
            Some((first, planes)) => self.unpack(*first, planes, size..=size)?,
            None => return Err(no_such_storage()),
        };
        Ok(TilePixels::Linear(match format {
            PixelFormat::LinearF16 => from_f16(&planes::join(planes, tiles)),
            _ => from_f32(&planes::join(planes, tiles)),
        }))
    }

    /// The pixels of sRGB tiles, each with what it may be told from, of a precision in `range`.
    ///
    /// # Errors
    /// As [`Decoder::decode`], and [`Error::Malformed`] if a tile is told from what is not there.
    pub fn decode_srgb(
        &mut self,
        range: PrecisionRange,
        tiles: &[(Tile, Option<&Arc<ReferenceTile>>)],
        payload: &[u8],
    ) -> Result<SrgbTiles, Error> {
        let format = PixelFormat::Srgb8 { exposure: 1.0 };
        let count = checked_pixels(tiles.iter().map(|(tile, _)| *tile), format)?;
        let malformed = |why: String| Error::malformed(WHAT, why);
        let header = Header::parse(payload, tiles.len()).map_err(malformed)?;
        if !range.contains(header.precision) {
            let (sent, PrecisionRange { finest, coarsest }) = (header.precision, range);
            let why = format!("it is {sent}: from {finest} to {coarsest} was asked for");
            return Err(malformed(why));
        }
        let mut decoded = SrgbTiles {
            pixels: Vec::new(),
            references: Vec::with_capacity(tiles.len()),
            precision: header.precision,
        };
        match header.precision.step() {
            Some(step) if header.storage == CHANGES => {
                let changes = self.decode_changes(&header, step, tiles, count, &mut decoded);
                changes.map_err(malformed)?;
            }
            Some(step) => self.decode_levels(&header, step, tiles, count, &mut decoded)?,
            None => decode_lossy(&header, tiles, count, &mut decoded).map_err(malformed)?,
        }
        Ok(decoded)
    }

    fn decode_levels(
        &mut self,
        header: &Header,
        step: u8,
        tiles: &[(Tile, Option<&Arc<ReferenceTile>>)],
        count: usize,
        decoded: &mut SrgbTiles,
    ) -> Result<(), Error> {
        let precision = header.precision;
        let (mut mark_bytes, mut dense, mut marked_max) = (0, 0, 0);
        for ((tile, _), mode) in tiles.iter().zip(&header.modes) {
            match mode.map(|mode| mode.base) {
                None => {}
                Some(Base::Neighbour | Base::Reference) => dense += tile.pixels(),
                Some(Base::Marked) => {
                    mark_bytes += Reader::mark_bytes(*tile);
                    marked_max += tile.pixels();
                }
            }
        }
        let least = mark_bytes + 3 * dense;
        let level = self.level;
        let planes = match (least, header.storage, header.rest) {
            (0, STORED, []) => &[],
            _ => self.unpack(header.storage, header.rest, least..=least + 3 * marked_max)?,
        };
        let reader = Reader::new(level, planes, mark_bytes, dense);
        let mut reader = reader.ok_or_else(|| Error::malformed(WHAT, "its marks do not fit"))?;
        // Not before the planes have turned out to be there.
        decoded.pixels = vec![[0; 3]; count];
        let mut pixels = &mut decoded.pixels[..];
        for ((tile, reference), mode) in tiles.iter().zip(&header.modes) {
            let (here, after) = pixels.split_at_mut(tile.pixels());
            pixels = after;
            let Some(mode) = mode else {
                let same = reference.and_then(|held| held.rounded(precision, *tile));
                let same = same.ok_or_else(|| Error::malformed(WHAT, NO_REFERENCE))?;
                here.copy_from_slice(&same.pixels);
                decoded.references.push(same);
                continue;
            };
            let base = reference.and_then(|held| held.base(precision, tile.pixels()));
            let joined = reader.join(here, *mode, step, *tile, base);
            joined.ok_or_else(|| Error::malformed(WHAT, NO_REFERENCE))?;
            let pixels = Box::from(&*here);
            let kept = ReferenceTile { pixels, precision };
            decoded.references.push(Arc::new(kept));
        }
        Ok(())
    }

    fn decode_changes(
        &mut self,
        header: &Header,
        step: u8,
        tiles: &[(Tile, Option<&Arc<ReferenceTile>>)],
        count: usize,
        decoded: &mut SrgbTiles,
    ) -> Result<(), String> {
        let precision = header.precision;
        let mut coder = RangeDecoder::new(header.rest);
        self.changes.begin();
        decoded.pixels = Vec::with_capacity(count);
        for (tile, reference) in tiles {
            let held = reference.ok_or(NO_REFERENCE)?;
            let kept = if self.changes.changes(&mut coder, false) {
                let width = tile.width as usize;
                let base = held.base(precision, tile.pixels()).ok_or(NO_REFERENCE)?;
                let mut pixels = levels::of(step, width, base);
                self.changes
                    .tile(&mut coder, width, step, &mut pixels, None);
                levels::to_values(step, width, &mut pixels);
                let pixels = pixels.into_boxed_slice();
                Arc::new(ReferenceTile { pixels, precision })
            } else {
                held.rounded(precision, *tile).ok_or(NO_REFERENCE)?
            };
            decoded.pixels.extend_from_slice(&kept.pixels);
            decoded.references.push(kept);
        }
        if coder.is_at_end() {
            return Ok(());
        }
        Err("its changes do not end where it does".into())
    }

    /// Planes of one of `sizes` bytes.
    fn unpack<'a>(
        &'a mut self,
        storage: u8,
        bytes: &'a [u8],
        sizes: RangeInclusive<usize>,
    ) -> Result<&'a [u8], Error> {
        match storage {
            STORED if sizes.contains(&bytes.len()) => Ok(bytes),
            STORED => {
                let why = format!("{} bytes are stored for {}", bytes.len(), stated(&sizes));
                Err(Error::malformed(WHAT, why))
            }
            ZSTD => self.decompress(bytes, &sizes),
            _ => Err(no_such_storage()),
        }
    }

    fn decompress(&mut self, frame: &[u8], sizes: &RangeInclusive<usize>) -> Result<&[u8], Error> {
        let size = check_frame(frame, sizes).map_err(|why| Error::malformed(WHAT, why))?;
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

fn decode_lossy(
    header: &Header,
    tiles: &[(Tile, Option<&Arc<ReferenceTile>>)],
    count: usize,
    decoded: &mut SrgbTiles,
) -> Result<(), String> {
    let precision = header.precision;
    let told = tiles.iter().zip(&header.modes);
    let scanned: Vec<Tile> = told
        .filter(|(_, mode)| mode.is_some())
        .map(|((tile, _), _)| *tile)
        .collect();
    let scan = match (scanned.is_empty(), header.storage) {
        (true, STORED) if header.rest.is_empty() => Vec::new(),
        (false, JPEG) => jpeg::decode(precision, &scanned, header.rest)?,
        _ => return Err("it is no JPEG scan".into()),
    };
    decoded.pixels = vec![[0; 3]; count];
    let mut scan = &scan[..];
    let mut shown = &mut decoded.pixels[..];
    for ((tile, reference), mode) in tiles.iter().zip(&header.modes) {
        let (here, after) = shown.split_at_mut(tile.pixels());
        shown = after;
        match (mode, reference) {
            (Some(mode), _) if *mode == Mode::USUAL => {
                let (pixels, rest) = scan.split_at(here.len());
                scan = rest;
                here.copy_from_slice(pixels);
                let pixels = Box::from(pixels);
                let tile = ReferenceTile { pixels, precision };
                decoded.references.push(Arc::new(tile));
            }
            (None, Some(same)) if same.pixels.len() == here.len() => {
                here.copy_from_slice(&same.pixels);
                decoded.references.push(Arc::clone(same));
            }
            _ => return Err(NO_REFERENCE.into()),
        }
    }
    Ok(())
}

fn checked_pixels(tiles: impl Iterator<Item = Tile>, format: PixelFormat) -> Result<usize, Error> {
    let pixels: usize = tiles.map(|tile| tile.pixels()).sum();
    if pixels <= PIXELS_PER_MESSAGE_MAX {
        return Ok(pixels);
    }
    let [bytes, max] =
        [pixels, PIXELS_PER_MESSAGE_MAX].map(|pixels| (pixels * format.bytes()) as u64);
    let what = WHAT;
    Err(Error::TooLarge { what, bytes, max })
}

fn no_such_storage() -> Error {
    Error::malformed(WHAT, "its first byte names no way of storing")
}

/// One zstd frame (RFC 8878), all of the bytes, without a dictionary, of a stated size among
/// `sizes`, which it hands out. Zstd alone would also take several frames, skippable ones among
/// them.
fn check_frame(frame: &[u8], sizes: &RangeInclusive<usize>) -> Result<usize, String> {
    if !frame.starts_with(&zstd_safe::MAGICNUMBER.to_le_bytes()) {
        return Err("it is no zstd frame".into());
    }
    if zstd_safe::get_dict_id_from_frame(frame).is_some() {
        return Err("it asks for a dictionary".into());
    }
    let size = match zstd_safe::get_frame_content_size(frame) {
        Ok(Some(size)) => usize::try_from(size).unwrap_or(usize::MAX),
        _ => return Err("it states no size".into()),
    };
    if !sizes.contains(&size) {
        return Err(format!("it states {size} bytes for {}", stated(sizes)));
    }
    match zstd_safe::find_frame_compressed_size(frame) {
        Ok(length) if length == frame.len() => Ok(size),
        Ok(length) => Err(format!("{} bytes follow its end", frame.len() - length)),
        Err(_) => Err("its frame is cut short".into()),
    }
}

fn stated(sizes: &RangeInclusive<usize>) -> String {
    let (least, most) = (sizes.start(), sizes.end());
    if least == most {
        return least.to_string();
    }
    format!("{least} to {most}")
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
const NO_REFERENCE: &str = "a tile is told from one that is not held";
