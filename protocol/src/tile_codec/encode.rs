//! Encoder of radiance into payloads.

use std::sync::Arc;

use carom_tracer::Tile;
use carom_tracer::tonemap::srgb8;
use fearless_simd::Level;
use zstd::bulk::Compressor;

use super::delta::delta_coder::DeltaCoder;
use super::delta::reference::{DeltaStats, ReferenceTile};
use super::entropy::range_coder::RangeEncoder;
use super::header::{self, JPEG, RANGE_CODED, TileMode, ZSTD};
use super::transform::float_planes;
use super::transform::quantise::{quantised, rounded};
use super::transform::srgb_forward::ForwardTransform;
use super::{TileInput, jpeg};
use crate::limits::PIXELS_PER_MESSAGE_MAX;
use crate::message::PixelFormat;
use crate::precision::PixelPrecision;

/// Encoder of payloads. Keep one per thread: its buffers and its zstd context, some 600 kB, are reused.
pub struct Encoder {
    zstd: Compressor<'static>,
    planes: Vec<u8>,
    transform: ForwardTransform,
    delta_coder: DeltaCoder,
    /// Token bucket of decoding time in nanoseconds: what recent messages have left of their allowance.
    spare_nanos: f32,
    delta: DeltaStats,
    level: Level,
}

impl Encoder {
    /// An encoder with empty buffers.
    ///
    /// # Panics
    /// If there is no memory for a zstd context.
    pub fn new() -> Self {
        Self {
            zstd: Compressor::new(ZSTD_LEVEL).expect("memory for a zstd context"),
            planes: Vec::new(),
            transform: ForwardTransform::default(),
            delta_coder: DeltaCoder::new(),
            spare_nanos: 0.0,
            delta: DeltaStats::default(),
            level: Level::new(),
        }
    }

    /// The payload of `tiles`, each with its row-major radiance, exact and without references. The same
    /// radiance gives the same payload's pixels on every machine.
    ///
    /// [`PixelFormat::LinearF16`] rounds to the nearest half float, clamped to ±65504; NaN stays NaN.
    /// [`PixelFormat::LinearF32`] keeps each bit.
    ///
    /// # Panics
    /// If a tile's radiance is not as long as the tile has pixels, or there are more than
    /// [`PIXELS_PER_MESSAGE_MAX`] pixels.
    pub fn encode(&mut self, format: PixelFormat, tiles: &[(Tile, &[[f32; 3]])]) -> Vec<u8> {
        if let PixelFormat::Srgb8 { exposure } = format {
            let input = |&(tile, radiance)| TileInput {
                tile,
                radiance,
                reference: None,
            };
            let inputs: Vec<TileInput> = tiles.iter().map(input).collect();
            return self.encode_srgb(exposure, PixelPrecision::Exact, &inputs).0;
        }
        let pixels = count_pixels(tiles.iter().map(|&(tile, radiance)| (tile, radiance.len())));
        self.planes.resize(pixels * format.bytes(), 0);
        match format {
            PixelFormat::LinearF16 => float_planes::forward(&mut self.planes, tiles, f16_bits),
            _ => float_planes::forward(&mut self.planes, tiles, |pixel| pixel.map(f32::to_bits)),
        }
        let mut payload = vec![0];
        self.pack(&mut payload);
        payload
    }

    /// The payload of sRGB tiles, and each tile as the client will remember it for later references.
    ///
    /// # Panics
    /// As [`Encoder::encode`].
    pub fn encode_srgb(
        &mut self,
        exposure: f32,
        precision: PixelPrecision,
        inputs: &[TileInput],
    ) -> (Vec<u8>, Vec<Arc<ReferenceTile>>) {
        count_pixels(inputs.iter().map(|s| (s.tile, s.radiance.len())));
        let shown: Vec<Vec<[u8; 3]>> = inputs
            .iter()
            .map(|input| input.radiance.iter().map(|l| srgb8(*l, exposure)).collect())
            .collect();
        self.delta = DeltaStats::default();
        match precision.step() {
            Some(step) => self.encode_quantised(precision, step, inputs, &shown),
            None => self.encode_lossy(precision, inputs, shown),
        }
    }

    /// Statistics of the last message.
    pub fn delta_stats(&self) -> DeltaStats {
        self.delta
    }

    fn encode_quantised<'a>(
        &mut self,
        precision: PixelPrecision,
        step: u8,
        inputs: &[TileInput<'a>],
        shown: &[Vec<[u8; 3]>],
    ) -> (Vec<u8>, Vec<Arc<ReferenceTile>>) {
        let base = |(input, pixels): (&TileInput<'a>, &Vec<[u8; 3]>)| {
            let reference = input.reference?;
            reference.base(precision, pixels.len())
        };
        let bases: Vec<Option<&[[u8; 3]]>> = inputs.iter().zip(shown).map(base).collect();
        let all: Option<Vec<&[[u8; 3]]>> = bases.iter().copied().collect();
        // Range coding takes a decoder ten times as long for a changed pixel as planes do. While the camera
        // turns all pixels change; range coding is then used only as far as the decoders' throughput allows.
        let (payload, nanos) = match all {
            // All tiles of a message or none: one header names one storage, and the range coder needs a
            // reference for each tile.
            Some(all) if self.spare_nanos >= 0.0 => {
                self.encode_range_coded(precision, step, inputs, shown, &all)
            }
            _ => self.encode_planes(precision, step, inputs, shown, &bases),
        };
        let pixels: usize = shown.iter().map(Vec::len).sum();
        // Token bucket: each pixel earns the allowed mean time, and the message spends its estimated time.
        let spare_nanos = self.spare_nanos + PIXEL_NANOS * pixels as f32 - nanos;
        // Bounded above, or the credit of a still minute would be spent on seconds of slowly decoded frames.
        // It may fall below 0 by one message, whose cost is known only afterwards.
        self.spare_nanos = spare_nanos.min(SPARE_NANOS_MAX);
        let kept = inputs.iter().zip(shown).map(|(input, pixels)| {
            // What the decoder has, not what was traced: quantisation errors would otherwise accumulate from
            // frame to frame.
            let pixels = rounded(step, input.tile.width as usize, pixels);
            Arc::new(ReferenceTile { pixels, precision })
        });
        (payload, kept.collect())
    }

    /// The payload, and the estimated time in nanoseconds that a decoder takes for it.
    fn encode_range_coded(
        &mut self,
        precision: PixelPrecision,
        step: u8,
        inputs: &[TileInput],
        shown: &[Vec<[u8; 3]>],
        references: &[&[[u8; 3]]],
    ) -> (Vec<u8>, f32) {
        let mut coder = RangeEncoder::new(vec![header::first_byte(precision, RANGE_CODED)]);
        self.delta_coder.begin();
        for ((input, pixels), reference) in inputs.iter().zip(shown).zip(references) {
            let width = input.tile.width as usize;
            let mut levels = quantised(step, width, reference);
            let new = quantised(step, width, pixels);
            if self.delta_coder.tile_changes(&mut coder, levels != new) {
                self.delta_coder
                    .tile(&mut coder, width, step, &mut levels, Some(&new));
            }
        }
        let payload = coder.finish();
        let pixels: usize = shown.iter().map(Vec::len).sum();
        (self.delta.referenced, self.delta.changed) = (pixels, self.delta_coder.changed_pixels());
        let nanos = REFERENCE_NANOS * pixels as f32
            + CHANGED_NANOS * self.delta_coder.changed_pixels() as f32
            + RANGE_CODED_BYTE_NANOS * payload.len() as f32;
        (payload, nanos)
    }

    /// The payload, and the estimated time in nanoseconds that a decoder takes for it.
    fn encode_planes(
        &mut self,
        precision: PixelPrecision,
        step: u8,
        inputs: &[TileInput],
        shown: &[Vec<[u8; 3]>],
        bases: &[Option<&[[u8; 3]]>],
    ) -> (Vec<u8>, f32) {
        self.transform.clear();
        let mut modes = Vec::with_capacity(inputs.len());
        for ((input, pixels), base) in inputs.iter().zip(shown).zip(bases) {
            let tile = input.tile;
            let (mode, changed) = self.transform.append(self.level, step, tile, pixels, *base);
            let changed = input.reference.map(|reference| match base {
                Some(_) => changed,
                None => reference.count_changed(tile.width, pixels),
            });
            self.delta.add(tile.pixels(), base.is_none(), changed);
            modes.push(mode);
        }
        self.transform.write(&mut self.planes);
        let mut payload = header::write(precision, &modes);
        self.pack(&mut payload);
        let pixels: usize = shown.iter().map(Vec::len).sum();
        (payload, PLANES_NANOS * pixels as f32)
    }

    fn encode_lossy(
        &mut self,
        precision: PixelPrecision,
        inputs: &[TileInput],
        shown: Vec<Vec<[u8; 3]>>,
    ) -> (Vec<u8>, Vec<Arc<ReferenceTile>>) {
        let mut modes = Vec::with_capacity(inputs.len());
        let mut kept = Vec::with_capacity(inputs.len());
        let mut scanned = Vec::new();
        for (input, pixels) in inputs.iter().zip(shown) {
            let reference = input.reference;
            let changed = reference.map(|known| known.count_changed(input.tile.width, &pixels));
            self.delta.add(pixels.len(), reference.is_none(), changed);
            // A tile that the client shows unchanged, at this precision or a finer one, is not sent again.
            let same = reference.filter(|known| changed == Some(0) && known.precision <= precision);
            if let Some(same) = same {
                modes.push(TileMode::Unchanged);
                kept.push(Arc::clone(same));
            } else {
                modes.push(TileMode::Intra);
                scanned.push(kept.len());
                let pixels = pixels.into_boxed_slice();
                kept.push(Arc::new(ReferenceTile { pixels, precision }));
            }
        }
        let mut payload = header::write(precision, &modes);
        if !scanned.is_empty() {
            let tiles: Vec<(Tile, &[[u8; 3]])> = scanned
                .iter()
                .map(|&index| (inputs[index].tile, &*kept[index].pixels))
                .collect();
            payload[0] |= JPEG;
            payload.extend(jpeg::encode(precision, &tiles));
        }
        (payload, kept)
    }

    /// Appends the planes, compressed if that is shorter, and sets the storage in the first byte.
    fn pack(&mut self, payload: &mut Vec<u8>) {
        if self.planes.is_empty() && payload.len() > 1 {
            return; // all tiles are unchanged
        }
        let start = payload.len();
        // The buffer is one byte shorter than the planes, so that zstd fails if it gains nothing.
        payload.resize(start + self.planes.len().saturating_sub(1), 0);
        match self
            .zstd
            .compress_to_buffer(&self.planes, &mut payload[start..])
        {
            Ok(length) => {
                payload.truncate(start + length);
                payload[0] |= ZSTD;
            }
            Err(_) => {
                payload.truncate(start);
                payload.extend_from_slice(&self.planes);
            }
        }
    }
}

impl Default for Encoder {
    fn default() -> Self {
        Self::new()
    }
}

fn count_pixels(tiles: impl Iterator<Item = (Tile, usize)>) -> usize {
    let mut pixels = 0;
    for (tile, radiance) in tiles {
        assert_eq!(tile.pixels(), radiance, "radiance of {tile:?}");
        pixels += radiance;
    }
    assert!(pixels <= PIXELS_PER_MESSAGE_MAX, "{pixels} pixels");
    pixels
}

pub(super) fn f16_bits(pixel: [f32; 3]) -> [u16; 3] {
    // Clamped, since larger values would round to infinity; `clamp` passes NaN through.
    let limit = half::f16::MAX.to_f32();
    pixel.map(|channel| half::f16::from_f32(channel.clamp(-limit, limit)).to_bits())
}

/// Mean decoding time that a pixel may take in nanoseconds, here and below on a core of 2023: 520 MB/s.
/// Spending it on range coding makes the frames of a turning camera a tenth smaller than planes alone; range
/// coding all of them would make them a third smaller and four times slower to decode.
const PIXEL_NANOS: f32 = 5.75;
/// Decoding time in nanoseconds of a pixel in planes.
const PLANES_NANOS: f32 = 5.0;
/// Decoding time in nanoseconds of any pixel of a range-coded tile.
const REFERENCE_NANOS: f32 = 0.8;
/// Additional decoding time in nanoseconds of a changed pixel of a range-coded tile.
const CHANGED_NANOS: f32 = 52.0;
/// Additional decoding time in nanoseconds of a range-coded byte.
const RANGE_CODED_BYTE_NANOS: f32 = 36.0;
/// Capacity of the token bucket: half a frame of 1280×720, since rolling balls change a quarter of one.
const SPARE_NANOS_MAX: f32 = 64.0 * 8192.0 * (PIXEL_NANOS - REFERENCE_NANOS);
/// Level 3 was larger and 2 to 4 times slower on noise, with a predictor in front of it.
const ZSTD_LEVEL: i32 = 1;
