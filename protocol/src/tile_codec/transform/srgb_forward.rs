//! Forward plane transform of sRGB tiles: levels to planes of differences.
//!
//! An intra tile consists of differences from the left neighbour, in the first column from the pixel
//! above. A delta tile consists of a mask of the pixels that differ from the reference, one bit a pixel,
//! and the differences of those alone. Channels are predicted independently of each other.

use carom_tracer::Tile;
use fearless_simd::{Level, dispatch};

use super::quantise::{Channels, quantise_planes, resized};
use crate::tile_codec::header::TileMode;

/// Forward transform of the tiles of a message, one after the other; its buffers are reused.
#[derive(Debug, Default)]
pub(crate) struct ForwardTransform {
    /// Masks of the delta tiles, one bit a pixel, the first pixel's the lowest; each tile begins a byte.
    masks: Vec<u8>,
    planes: Channels,
    levels: Channels,
    reference: Channels,
    spatial: Channels,
    temporal: Channels,
}

impl ForwardTransform {
    /// Begins a message.
    pub(crate) fn clear(&mut self) {
        self.masks.clear();
        self.planes.iter_mut().for_each(Vec::clear);
    }

    /// Writes the masks, then the planes of green, red and blue.
    pub(crate) fn write(&self, out: &mut Vec<u8>) {
        out.clear();
        out.extend_from_slice(&self.masks);
        for plane in &self.planes {
            out.extend_from_slice(plane);
        }
    }

    /// Appends a tile. Returns its mode and the number of its pixels that differ from the reference, which
    /// are all if there is none.
    pub(crate) fn append(
        &mut self,
        level: Level,
        step: u8,
        tile: Tile,
        pixels: &[[u8; 3]],
        reference: Option<&[[u8; 3]]>,
    ) -> (TileMode, usize) {
        dispatch!(level, _ => self.append_wide(step, tile, pixels, reference))
    }

    /// Plain loops over bytes, which the compiler vectorises for each instruction set of `dispatch!`.
    #[inline(always)]
    fn append_wide(
        &mut self,
        step: u8,
        tile: Tile,
        pixels: &[[u8; 3]],
        reference: Option<&[[u8; 3]]>,
    ) -> (TileMode, usize) {
        let width = tile.width as usize;
        quantise_planes(&mut self.levels, step, width, pixels);
        let mut changed = pixels.len();
        if let Some(reference) = reference {
            quantise_planes(&mut self.reference, step, width, reference);
            let pairs = self.levels.iter().zip(&self.reference);
            for (out, (levels, reference)) in self.temporal.iter_mut().zip(pairs) {
                subtract(resized(out, levels.len()), levels, reference);
            }
            changed = count_changed(&self.temporal);
            if changed == 0 {
                return (TileMode::Unchanged, 0);
            }
            if changed * MASK_PART <= pixels.len() {
                self.append_delta();
                return (TileMode::Delta, changed);
            }
        }
        for (out, levels) in self.spatial.iter_mut().zip(&self.levels) {
            subtract_neighbours(resized(out, levels.len()), levels, width);
        }
        if reference.is_some() && cost(&self.temporal) < cost(&self.spatial) {
            self.append_delta();
            return (TileMode::Delta, changed);
        }
        for (plane, differences) in self.planes.iter_mut().zip(&self.spatial) {
            plane.extend_from_slice(differences);
        }
        (TileMode::Intra, changed)
    }

    #[inline(always)]
    fn append_delta(&mut self) {
        let [green, red, blue] = &self.temporal;
        let groups = green.chunks(8).zip(red.chunks(8)).zip(blue.chunks(8));
        for ((g, r), b) in groups {
            let mut mask = 0;
            for (bit, ((g, r), b)) in g.iter().zip(r).zip(b).enumerate() {
                // Differences are modulo 256, so only equal values have difference 0.
                if (g | r | b) != 0 {
                    mask |= 1 << bit;
                    self.planes[0].push(*g);
                    self.planes[1].push(*r);
                    self.planes[2].push(*b);
                }
            }
            self.masks.push(mask);
        }
    }
}

#[inline(always)]
fn subtract(out: &mut [u8], a: &[u8], b: &[u8]) {
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        *out = a.wrapping_sub(*b);
    }
}

#[inline(always)]
fn subtract_neighbours(out: &mut [u8], levels: &[u8], width: usize) {
    let mut above = 0;
    for (out, row) in out.chunks_mut(width).zip(levels.chunks(width)) {
        out[0] = row[0].wrapping_sub(above);
        above = row[0];
        subtract(&mut out[1..], &row[1..], row);
    }
}

/// Sum of magnitudes: nearly proportional to the compressed size, and a hundredth of the time of compressing
/// both alternatives.
#[inline(always)]
fn cost(differences: &Channels) -> u32 {
    let magnitude = |difference: &u8| u32::from(difference.cast_signed().unsigned_abs());
    let planes = differences.iter();
    planes
        .map(|plane| plane.iter().map(magnitude).sum::<u32>())
        .sum()
}

/// Number of pixels with a difference in any channel.
#[inline(always)]
fn count_changed([green, red, blue]: &Channels) -> usize {
    let differences = green.iter().zip(red).zip(blue);
    differences
        .filter(|((g, r), b)| (*g | *r | *b) != 0)
        .count()
}

/// If at most one in this many pixels has changed, the tile is delta-coded without computing the intra
/// alternative: an unmarked pixel takes no byte in any plane.
const MASK_PART: usize = 2;
