//! Inverse plane transform of sRGB tiles: planes of differences to sRGB bytes.

use carom_tracer::Tile;
use fearless_simd::{Level, dispatch};

use super::quantise::{dequantise, quantised};

/// Inverse transform of the tiles of a message, one after the other.
pub(crate) struct InverseTransform<'a> {
    masks: &'a [u8],
    /// Unread remainders of the green, red and blue planes.
    planes: [&'a [u8]; 3],
    level: Level,
}

impl<'a> InverseTransform<'a> {
    /// Number of bytes of a delta tile's mask.
    pub(crate) fn mask_bytes(tile: Tile) -> usize {
        tile.pixels().div_ceil(8)
    }

    /// An inverse transform of masks, which are the first `mask_bytes` bytes, and planes. `None` if the
    /// planes do not have exactly the length of `intra` pixels and the marked ones.
    pub(crate) fn new(
        level: Level,
        planes: &'a [u8],
        mask_bytes: usize,
        intra: usize,
    ) -> Option<Self> {
        let (masks, rest) = planes.split_at_checked(mask_bytes)?;
        let length = intra + count_marked(masks);
        // Checked once for the whole message: from here on no plane can be too short.
        (rest.len() == 3 * length).then(|| Self {
            masks,
            planes: [0, 1, 2].map(|channel| &rest[channel * length..][..length]),
            level,
        })
    }

    /// Writes the pixels of an intra tile.
    pub(crate) fn intra_tile(&mut self, pixels: &mut [[u8; 3]], step: u8, width: usize) {
        dispatch!(self.level, _ => self.intra_tile_wide(pixels, step, width));
    }

    /// Plain loops over bytes, which the compiler vectorises for each instruction set of `dispatch!`.
    #[inline(always)]
    fn intra_tile_wide(&mut self, pixels: &mut [[u8; 3]], step: u8, width: usize) {
        let differences = self.take(pixels.len());
        add_neighbours(pixels, differences, width);
        dequantise(step, width, pixels);
    }

    /// Writes the pixels of a delta tile. `None` if its mask marks pixels outside the tile.
    pub(crate) fn delta_tile(
        &mut self,
        pixels: &mut [[u8; 3]],
        step: u8,
        tile: Tile,
        reference: &[[u8; 3]],
    ) -> Option<()> {
        dispatch!(self.level, _ => self.delta_tile_wide(pixels, step, tile, reference))
    }

    #[inline(always)]
    fn delta_tile_wide(
        &mut self,
        pixels: &mut [[u8; 3]],
        step: u8,
        tile: Tile,
        reference: &[[u8; 3]],
    ) -> Option<()> {
        let width = tile.width as usize;
        let (mask, rest) = self.masks.split_at(Self::mask_bytes(tile));
        self.masks = rest;
        let differences = self.take(count_marked(mask));
        // Requantised to this precision, as by the encoder, whatever precision the reference was sent at.
        pixels.copy_from_slice(&quantised(step, width, reference));
        add_marked(pixels, mask, differences)?;
        dequantise(step, width, pixels);
        Some(())
    }

    #[inline(always)]
    fn take(&mut self, count: usize) -> [&'a [u8]; 3] {
        self.planes.each_mut().map(|plane| {
            let (taken, rest) = plane.split_at(count);
            *plane = rest;
            taken
        })
    }
}

#[inline(always)]
fn count_marked(mask: &[u8]) -> usize {
    mask.iter().map(|byte| byte.count_ones() as usize).sum()
}

/// Prefix sums of all three channels at once: each sum depends on the one before it, and three
/// independent chains hide that latency.
#[inline(always)]
fn add_neighbours(pixels: &mut [[u8; 3]], [g, r, b]: [&[u8]; 3], width: usize) {
    let mut differences = g.iter().zip(r).zip(b);
    let mut above = [0u8; 3];
    for row in pixels.chunks_mut(width) {
        let mut left = above;
        for (pixel, ((g, r), b)) in row.iter_mut().zip(&mut differences) {
            let [red, green, blue] = left;
            left = [
                red.wrapping_add(*r),
                green.wrapping_add(*g),
                blue.wrapping_add(*b),
            ];
            *pixel = left;
        }
        above = row[0];
    }
}

/// Adds the differences of the marked pixels to `levels`, which are the reference's.
#[inline(always)]
fn add_marked(levels: &mut [[u8; 3]], mask: &[u8], [g, r, b]: [&[u8]; 3]) -> Option<()> {
    let mut differences = g.iter().zip(r).zip(b);
    for (group, &mask) in levels.chunks_mut(8).zip(mask) {
        let mut mask = mask;
        while mask != 0 {
            // A hostile mask may mark pixels past the end of the last group.
            let pixel = group.get_mut(mask.trailing_zeros() as usize)?;
            let ((g, r), b) = differences.next()?;
            let [red, green, blue] = *pixel;
            *pixel = [
                red.wrapping_add(*r),
                green.wrapping_add(*g),
                blue.wrapping_add(*b),
            ];
            mask &= mask - 1; // clears the lowest bit
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::super::srgb_forward::ForwardTransform;
    use super::*;
    use crate::tile_codec::header::TileMode;
    use crate::tile_codec::transform::quantise::rounded;

    const TILE: Tile = Tile {
        x: 0,
        y: 0,
        width: 37,
        height: 29,
    };

    /// A smooth gradient in which one pixel in `part` is noisy.
    fn picture(seed: u32, part: u32) -> Vec<[u8; 3]> {
        let pixel = |index: u32| {
            let soft = 40 + index / 11;
            let seed = if index.is_multiple_of(part) { seed } else { 1 };
            let noise = (index ^ seed).wrapping_mul(0x9e37_79b9) >> 27;
            [soft + noise, soft + noise / 2, soft / 2 + noise].map(|value| value as u8)
        };
        (0..TILE.pixels() as u32).map(pixel).collect()
    }

    /// The two ends of a connection may have processors with different instruction sets.
    #[test]
    fn simd_levels_transform_alike() {
        let (now, dense, sparse) = (picture(1, 1), picture(2, 1), picture(2, 5));
        let levels = [Level::baseline(), Level::new()];
        for (step, reference) in [
            (1, None),
            (3, None),
            (5, Some(&dense[..])),
            (1, Some(&dense[..])),
            (1, Some(&sparse[..])),
        ] {
            let planes = levels.map(|level| {
                let mut forward = ForwardTransform::default();
                let (mode, _) = forward.append(level, step, TILE, &now, reference);
                let mut planes = Vec::new();
                forward.write(&mut planes);
                (mode, planes)
            });
            assert_eq!(planes[0], planes[1]);
            let (mode, planes) = &planes[0];
            for level in levels {
                let mut pixels = vec![[0; 3]; TILE.pixels()];
                let width = TILE.width as usize;
                if *mode == TileMode::Intra {
                    InverseTransform::new(level, planes, 0, TILE.pixels())
                        .unwrap()
                        .intra_tile(&mut pixels, step, width);
                } else {
                    InverseTransform::new(level, planes, InverseTransform::mask_bytes(TILE), 0)
                        .unwrap()
                        .delta_tile(&mut pixels, step, TILE, reference.unwrap())
                        .unwrap();
                }
                assert_eq!(pixels, *rounded(step, width, &now));
            }
        }
    }
}
