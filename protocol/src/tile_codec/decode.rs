//! Decoder of payloads into pixels.

use std::ops::RangeInclusive;
use std::sync::Arc;

use carom_tracer::Tile;
use fearless_simd::Level;
use half::slice::{HalfBitsSliceExt, HalfFloatSliceExt};
use zstd::bulk::Decompressor;
use zstd::zstd_safe;

use super::delta::delta_coder::DeltaCoder;
use super::delta::reference::ReferenceTile;
use super::entropy::range_coder::RangeDecoder;
use super::header::{Header, JPEG, RANGE_CODED, STORED, TileMode, ZSTD};
use super::transform::float_planes;
use super::transform::quantise::{dequantise, quantised};
use super::transform::srgb_inverse::InverseTransform;
use super::{TilePixels, jpeg};
use crate::error::{EMPTY, Error, Reason};
use crate::limits::PIXELS_PER_MESSAGE_MAX;
use crate::message::PixelFormat;
use crate::precision::{PixelPrecision, PrecisionRange};

/// Decoded sRGB tiles of a payload.
#[derive(Clone, Debug)]
pub struct SrgbTiles {
    /// The pixels, tile after tile, each row-major.
    pub pixels: Vec<[u8; 3]>,
    /// The tiles as references for later ones.
    pub references: Vec<Arc<ReferenceTile>>,
    /// The precision that the node chose.
    pub precision: PixelPrecision,
}

/// Decoder of payloads. Keep one per thread or connection: its buffer and its zstd context,
/// some 160 kB, are reused.
pub struct Decoder {
    zstd: Decompressor<'static>,
    planes: Vec<u8>,
    delta_coder: DeltaCoder,
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
            delta_coder: DeltaCoder::new(),
            level: Level::new(),
        }
    }

    /// Decodes the pixels of `tiles`, which are those that the client requested: they and `format` determine
    /// the only size that the payload may decompress to, and no more is allocated, whatever the payload says.
    /// The inverse of `Encoder::encode`.
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
            Some((first, planes)) => self
                .unpack(*first, planes, size..=size)
                .map_err(|reason| Error::malformed(WHAT, reason))?,
            None => return Err(Error::malformed(WHAT, EMPTY)),
        };
        Ok(TilePixels::Linear(match format {
            PixelFormat::LinearF16 => from_f16(&float_planes::inverse(planes, tiles)),
            _ => from_f32(&float_planes::inverse(planes, tiles)),
        }))
    }

    /// Decodes sRGB tiles, each with its reference, at a precision in `range`.
    ///
    /// # Errors
    /// As [`Decoder::decode`], and [`Error::Malformed`] if a tile needs a reference that is missing.
    pub fn decode_srgb(
        &mut self,
        range: PrecisionRange,
        tiles: &[(Tile, Option<&Arc<ReferenceTile>>)],
        payload: &[u8],
    ) -> Result<SrgbTiles, Error> {
        let format = PixelFormat::Srgb8 { exposure: 1.0 };
        let count = checked_pixels(tiles.iter().map(|(tile, _)| *tile), format)?;
        let malformed = |reason: Reason| Error::malformed(WHAT, reason);
        let header = Header::parse(payload, tiles.len()).map_err(malformed)?;
        if !range.contains(header.precision) {
            let PrecisionRange { finest, coarsest } = range;
            let sent = header.precision;
            let rule = format!("it is {sent}: from {finest} to {coarsest} was asked for");
            return Err(malformed(rule.into()));
        }
        let mut decoded = SrgbTiles {
            pixels: Vec::new(),
            references: Vec::with_capacity(tiles.len()),
            precision: header.precision,
        };
        match header.precision.step() {
            Some(step) if header.storage == RANGE_CODED => {
                self.decode_range_coded(&header, step, tiles, count, &mut decoded)
            }
            Some(step) => self.decode_planes(&header, step, tiles, count, &mut decoded),
            None => decode_lossy(&header, tiles, count, &mut decoded),
        }
        .map_err(malformed)?;
        Ok(decoded)
    }

    fn decode_planes(
        &mut self,
        header: &Header,
        step: u8,
        tiles: &[(Tile, Option<&Arc<ReferenceTile>>)],
        count: usize,
        decoded: &mut SrgbTiles,
    ) -> Result<(), Reason> {
        let precision = header.precision;
        let (mut mask_bytes, mut intra, mut delta) = (0, 0, 0);
        for ((tile, _), mode) in tiles.iter().zip(&header.modes) {
            match mode {
                TileMode::Unchanged => {}
                TileMode::Intra => intra += tile.pixels(),
                TileMode::Delta => {
                    mask_bytes += InverseTransform::mask_bytes(*tile);
                    delta += tile.pixels();
                }
            }
        }
        // The masks determine the length of the planes but are packed with them, so only bounds are known
        // here.
        let least = mask_bytes + 3 * intra;
        let level = self.level;
        let planes = match (least, header.storage, header.body) {
            (0, STORED, []) => &[],
            _ => self.unpack(header.storage, header.body, least..=least + 3 * delta)?,
        };
        let transform = InverseTransform::new(level, planes, mask_bytes, intra);
        let mut transform = transform.ok_or(DELTA_MASKS)?;
        // Allocated only once the planes are known to be there.
        decoded.pixels = vec![[0; 3]; count];
        let mut pixels = &mut decoded.pixels[..];
        for ((tile, reference), mode) in tiles.iter().zip(&header.modes) {
            let (here, after) = pixels.split_at_mut(tile.pixels());
            pixels = after;
            match mode {
                TileMode::Unchanged => {
                    let same = reference.and_then(|known| known.at_precision(precision, *tile));
                    let same = same.ok_or(MISSING_REFERENCE)?;
                    here.copy_from_slice(&same.pixels);
                    decoded.references.push(same);
                    continue;
                }
                TileMode::Intra => transform.intra_tile(here, step, tile.width as usize),
                TileMode::Delta => {
                    let base = reference.and_then(|known| known.base(precision, tile.pixels()));
                    let base = base.ok_or(MISSING_REFERENCE)?;
                    let inverted = transform.delta_tile(here, step, *tile, base);
                    inverted.ok_or(DELTA_MASKS)?;
                }
            }
            let pixels = Box::from(&*here);
            let tile = ReferenceTile { pixels, precision };
            decoded.references.push(Arc::new(tile));
        }
        Ok(())
    }

    fn decode_range_coded(
        &mut self,
        header: &Header,
        step: u8,
        tiles: &[(Tile, Option<&Arc<ReferenceTile>>)],
        count: usize,
        decoded: &mut SrgbTiles,
    ) -> Result<(), Reason> {
        let precision = header.precision;
        let mut coder = RangeDecoder::new(header.body);
        self.delta_coder.begin();
        // `count` follows from the request, not from the payload.
        decoded.pixels = Vec::with_capacity(count);
        for (tile, reference) in tiles {
            let reference = reference.ok_or(MISSING_REFERENCE)?;
            let tile = if self.delta_coder.tile_changes(&mut coder, false) {
                let width = tile.width as usize;
                let base = reference
                    .base(precision, tile.pixels())
                    .ok_or(MISSING_REFERENCE)?;
                let mut pixels = quantised(step, width, base);
                self.delta_coder
                    .tile(&mut coder, width, step, &mut pixels, None);
                dequantise(step, width, &mut pixels);
                let pixels = pixels.into_boxed_slice();
                Arc::new(ReferenceTile { pixels, precision })
            } else {
                reference
                    .at_precision(precision, *tile)
                    .ok_or(MISSING_REFERENCE)?
            };
            decoded.pixels.extend_from_slice(&tile.pixels);
            decoded.references.push(tile);
        }
        // A range decoder accepts any bytes. That it ends exactly where its encoder would have ended is the
        // only check of the stream's length.
        if coder.is_at_end() {
            return Ok(());
        }
        Err("its range coder does not end where it does".into())
    }

    /// Decompressed planes, whose length must be one of `sizes`.
    fn unpack<'a>(
        &'a mut self,
        storage: u8,
        bytes: &'a [u8],
        sizes: RangeInclusive<usize>,
    ) -> Result<&'a [u8], Reason> {
        match storage {
            STORED if sizes.contains(&bytes.len()) => Ok(bytes),
            STORED => Err(wrong_size(bytes.len(), &sizes)),
            ZSTD => self.decompress(bytes, &sizes),
            _ => Err(NO_STORAGE.into()),
        }
    }

    fn decompress(&mut self, frame: &[u8], sizes: &RangeInclusive<usize>) -> Result<&[u8], Reason> {
        let size = check_frame(frame, sizes)?;
        self.planes.resize(size, 0);
        match self.zstd.decompress_to_buffer(frame, &mut self.planes[..]) {
            Ok(length) if length == size => Ok(&self.planes),
            Ok(length) => Err(wrong_size(length, sizes)),
            Err(why) => Err(undecompressed(&why)),
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
) -> Result<(), Reason> {
    let precision = header.precision;
    let coded = tiles.iter().zip(&header.modes);
    let scanned: Vec<Tile> = coded
        .filter(|(_, mode)| **mode == TileMode::Intra)
        .map(|((tile, _), _)| *tile)
        .collect();
    // Without a scan, when all tiles are unchanged, the header keeps the storage bits of stored planes.
    let scan = match (scanned.is_empty(), header.storage) {
        (true, STORED) if header.body.is_empty() => Vec::new(),
        (false, JPEG) => jpeg::decode(precision, &scanned, header.body)?,
        _ => return Err("it is no JPEG scan".into()),
    };
    decoded.pixels = vec![[0; 3]; count];
    let mut scan = &scan[..];
    let mut shown = &mut decoded.pixels[..];
    for ((tile, reference), mode) in tiles.iter().zip(&header.modes) {
        let (here, after) = shown.split_at_mut(tile.pixels());
        shown = after;
        match (mode, reference) {
            (TileMode::Intra, _) => {
                let (pixels, rest) = scan.split_at(here.len());
                scan = rest;
                here.copy_from_slice(pixels);
                let pixels = Box::from(pixels);
                let tile = ReferenceTile { pixels, precision };
                decoded.references.push(Arc::new(tile));
            }
            // A reference of any precision can be repeated, also a lossy one, whose decoded pixels are held
            // here.
            (TileMode::Unchanged, Some(same)) if same.pixels.len() == here.len() => {
                here.copy_from_slice(&same.pixels);
                decoded.references.push(Arc::clone(same));
            }
            _ => return Err(MISSING_REFERENCE.into()),
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

/// Checks that `frame` is exactly one zstd frame (RFC 8878) without a dictionary, whose stated content size
/// is in `sizes`, and returns that size. Zstd alone would also accept several frames, skippable ones
/// included.
pub(crate) fn check_frame(frame: &[u8], sizes: &RangeInclusive<usize>) -> Result<usize, Reason> {
    if !frame.starts_with(&zstd_safe::MAGICNUMBER.to_le_bytes()) {
        return Err("it is no zstd frame".into());
    }
    if zstd_safe::get_dict_id_from_frame(frame).is_some() {
        return Err("it asks for a zstd dictionary".into());
    }
    let size = match zstd_safe::get_frame_content_size(frame) {
        Ok(Some(size)) => usize::try_from(size).unwrap_or(usize::MAX),
        _ => return Err("its zstd frame states no size".into()),
    };
    if !sizes.contains(&size) {
        return Err(wrong_size(size, sizes));
    }
    match zstd_safe::find_frame_compressed_size(frame) {
        Ok(length) if length == frame.len() => Ok(size),
        Ok(length) => Err(format!("{} bytes follow its end", frame.len() - length).into()),
        Err(_) => Err("its zstd frame is cut short".into()),
    }
}

fn wrong_size(bytes: usize, sizes: &RangeInclusive<usize>) -> Reason {
    let (min, max) = (*sizes.start(), *sizes.end());
    format!("it has planes of {bytes} bytes: it must be from {min} to {max}").into()
}

pub(crate) fn undecompressed(why: &std::io::Error) -> Reason {
    format!("its zstd frame cannot be decompressed: {why}").into()
}

/// Converts all at once: `half` would detect the processor's features again for each single number.
pub(super) fn from_f16(bits: &[[u16; 3]]) -> Vec<[f32; 3]> {
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
const MISSING_REFERENCE: &str = "a tile is delta-coded against one that is not held";
const DELTA_MASKS: &str = "its masks do not fit";
pub(crate) const NO_STORAGE: &str = "its first byte names no way of storing";
