//! Samples to byte planes of small numbers, and back.
//!
//! A sample is the integer of a channel: sRGB steps, or the bits of a float, whose integer
//! differences are roughly differences of logarithms. Red and blue become their differences from
//! green; each is predicted by its left neighbour, in the first column by the one above; and of
//! the differences, all modulo 2ⁿ, each byte goes to a plane of its own, where bytes of equal
//! meaning lie side by side.

use carom_tracer::Tile;

/// The integer of a channel.
pub(super) trait Sample: Copy + Default {
    /// Bytes, which is the number of planes of a channel.
    const BYTES: usize;
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    /// A difference, such that small ones of either sign have zeros in their upper bytes.
    fn fold(self) -> Self;
    /// The inverse of [`Sample::fold`].
    fn unfold(self) -> Self;
    /// Byte number `index` from the top.
    fn byte(self, index: usize) -> u8;
    /// The sample with `byte` as its next lower byte.
    fn push(self, byte: u8) -> Self;
}

/// Fills `planes` with those of the samples of all tiles.
///
/// # Panics
/// If `planes` has another length than the samples.
#[inline(always)]
pub(super) fn split<S: Sample>(
    planes: &mut [u8],
    tiles: &[(Tile, &[[f32; 3]])],
    sample: impl Fn([f32; 3]) -> [S; 3],
) {
    let pixels = planes.len() / (3 * S::BYTES);
    let mut differences = Vec::new();
    let mut start = 0;
    for (tile, radiance) in tiles {
        let mut above = [S::default(); 3];
        for row in radiance.chunks_exact(tile.width as usize) {
            let mut left = above;
            differences.clear();
            differences.extend(row.iter().map(|&pixel| {
                let value = subtract_green(sample(pixel));
                let difference = difference(value, left);
                left = value;
                difference
            }));
            above = subtract_green(sample(row[0]));
            for plane in 0..3 * S::BYTES {
                let (channel, byte) = (plane / S::BYTES, plane % S::BYTES);
                let bytes = &mut planes[plane * pixels + start..][..row.len()];
                for (to, from) in bytes.iter_mut().zip(&differences) {
                    *to = from[channel].byte(byte);
                }
            }
            start += row.len();
        }
    }
    assert_eq!(start, pixels, "pixels of the tiles");
}

/// The pixels of all tiles from their planes.
///
/// # Panics
/// If `planes` has another length than the samples.
#[inline(always)]
pub(super) fn join<S: Sample, P>(
    planes: &[u8],
    tiles: &[Tile],
    pixel: impl Fn([S; 3]) -> P,
) -> Vec<P> {
    let count = planes.len() / (3 * S::BYTES);
    let mut pixels = Vec::with_capacity(count);
    let mut differences = Vec::new();
    for tile in tiles {
        let mut above = [S::default(); 3];
        for _ in 0..tile.height {
            differences.clear();
            differences.resize(tile.width as usize, [S::default(); 3]);
            for plane in 0..3 * S::BYTES {
                let channel = plane / S::BYTES;
                let bytes = &planes[plane * count + pixels.len()..][..differences.len()];
                for (to, &from) in differences.iter_mut().zip(bytes) {
                    to[channel] = to[channel].push(from);
                }
            }
            let mut left = above;
            pixels.extend(differences.iter().map(|&difference| {
                left = sum(difference, left);
                pixel(add_green(left))
            }));
            above = sum(differences[0], above);
        }
    }
    assert_eq!(pixels.len(), count, "pixels of the tiles");
    pixels
}

#[inline(always)]
fn subtract_green<S: Sample>([r, g, b]: [S; 3]) -> [S; 3] {
    [g, r.minus(g), b.minus(g)]
}

#[inline(always)]
fn add_green<S: Sample>([g, r, b]: [S; 3]) -> [S; 3] {
    [r.plus(g), g, b.plus(g)]
}

#[inline(always)]
fn difference<S: Sample>(value: [S; 3], prediction: [S; 3]) -> [S; 3] {
    std::array::from_fn(|channel| value[channel].minus(prediction[channel]).fold())
}

#[inline(always)]
fn sum<S: Sample>(difference: [S; 3], prediction: [S; 3]) -> [S; 3] {
    std::array::from_fn(|channel| prediction[channel].plus(difference[channel].unfold()))
}

impl Sample for u8 {
    const BYTES: usize = 1;

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }

    /// With a single plane there is no upper byte to save.
    #[inline(always)]
    fn fold(self) -> Self {
        self
    }

    #[inline(always)]
    fn unfold(self) -> Self {
        self
    }

    #[inline(always)]
    fn byte(self, _: usize) -> u8 {
        self
    }

    #[inline(always)]
    fn push(self, byte: u8) -> Self {
        byte
    }
}

impl Sample for u16 {
    const BYTES: usize = 2;

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }

    #[inline(always)]
    fn fold(self) -> Self {
        (self << 1) ^ (self.cast_signed() >> 15).cast_unsigned()
    }

    #[inline(always)]
    fn unfold(self) -> Self {
        (self >> 1) ^ (self & 1).wrapping_neg()
    }

    #[inline(always)]
    fn byte(self, index: usize) -> u8 {
        (self >> (8 * (1 - index))) as u8
    }

    #[inline(always)]
    fn push(self, byte: u8) -> Self {
        self << 8 | Self::from(byte)
    }
}

impl Sample for u32 {
    const BYTES: usize = 4;

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }

    #[inline(always)]
    fn fold(self) -> Self {
        (self << 1) ^ (self.cast_signed() >> 31).cast_unsigned()
    }

    #[inline(always)]
    fn unfold(self) -> Self {
        (self >> 1) ^ (self & 1).wrapping_neg()
    }

    #[inline(always)]
    fn byte(self, index: usize) -> u8 {
        (self >> (8 * (3 - index))) as u8
    }

    #[inline(always)]
    fn push(self, byte: u8) -> Self {
        self << 8 | Self::from(byte)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folding_loses_nothing_and_keeps_small_differences_small() {
        for value in 0..=u16::MAX {
            assert_eq!(value.fold().unfold(), value);
            let wide = u32::from(value).wrapping_sub(1 << 15);
            assert_eq!(wide.fold().unfold(), wide);
        }
        let small = |difference: i32| difference.cast_unsigned().fold() < 256;
        assert!((-128..128).all(small));
    }
}
