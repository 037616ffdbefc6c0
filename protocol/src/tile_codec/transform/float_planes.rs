//! Plane transform of linear pixels: bits of floats to byte planes of small differences, and back.
//!
//! Interpreted as integers, positive floats are nearly linear in the logarithms of their values, so that
//! differences stand for ratios. Red and blue become differences from green; each channel is predicted from
//! its left neighbour, in the first column from the pixel above; and each byte of the differences goes to a
//! plane of its own.

use carom_tracer::Tile;

/// Fills `planes` with those of all tiles, in the order green, red, blue.
///
/// # Panics
/// If `planes` has not the length of all samples.
#[inline(always)]
pub(crate) fn forward<S: Sample>(
    planes: &mut [u8],
    tiles: &[(Tile, &[[f32; 3]])],
    sample: impl Fn([f32; 3]) -> [S; 3],
) {
    let pixels = planes.len() / (3 * size_of::<S>());
    let channel_bytes = (planes.len() / 3).max(1);
    let mut channels = [(); 3].map(|()| vec![S::default(); pixels]);
    let mut start = 0;
    for (tile, radiance) in tiles {
        let mut above = [S::default(); 3];
        for row in radiance.chunks_exact(tile.width as usize) {
            let [g, r, b] = channels.each_mut().map(|c| &mut c[start..][..row.len()]);
            let mut left = above;
            // The first pixel of a row is predicted from the one above: the previous pixel, at the end of the
            // row before, lies at the other side of the tile.
            above = subtract_green(sample(row[0]));
            for (((pixel, g), r), b) in row.iter().zip(g).zip(r).zip(b) {
                let value = subtract_green(sample(*pixel));
                [*g, *r, *b] = difference(value, left);
                left = value;
            }
            start += row.len();
        }
    }
    assert_eq!(start, pixels, "pixels of the tiles");
    for (channel, planes) in channels.iter().zip(planes.chunks_exact_mut(channel_bytes)) {
        S::forward(channel, planes);
    }
}

/// The pixels of all tiles, from their planes.
///
/// # Panics
/// If `planes` has not the length of all samples.
#[inline(always)]
pub(crate) fn inverse<S: Sample>(planes: &[u8], tiles: &[Tile]) -> Vec<[S; 3]> {
    let count = planes.len() / (3 * size_of::<S>());
    let channel_bytes = (planes.len() / 3).max(1);
    let mut channels = [(); 3].map(|()| vec![S::default(); count]);
    for (channel, planes) in channels.iter_mut().zip(planes.chunks_exact(channel_bytes)) {
        S::inverse(channel, planes);
    }
    let mut pixels = vec![[S::default(); 3]; count];
    let mut start = 0;
    for tile in tiles {
        let width = tile.width as usize;
        let mut above = [S::default(); 3];
        for _ in 0..tile.height {
            let [g, r, b] = channels.each_ref().map(|c| &c[start..][..width]);
            let mut left = above;
            // The value of this row's first pixel, which predicts that of the next row.
            above = sum([g[0], r[0], b[0]], above);
            let row = &mut pixels[start..][..width];
            for (((pixel, &g), &r), &b) in row.iter_mut().zip(g).zip(r).zip(b) {
                left = sum([g, r, b], left);
                *pixel = add_green(left);
            }
            start += width;
        }
    }
    assert_eq!(start, count, "pixels of the tiles");
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
    std::array::from_fn(|channel| value[channel].minus(prediction[channel]))
}

#[inline(always)]
fn sum<S: Sample>(difference: [S; 3], prediction: [S; 3]) -> [S; 3] {
    std::array::from_fn(|channel| prediction[channel].plus(difference[channel]))
}

/// Integer with the bits of a channel's float.
pub(crate) trait Sample: Copy + Default {
    /// Sum modulo 2ⁿ.
    fn plus(self, other: Self) -> Self;
    /// Difference modulo 2ⁿ.
    fn minus(self, other: Self) -> Self;
    /// Writes a channel's differences to its planes, the most significant byte first. They are zigzag-coded,
    /// so that small ones of either sign have zeros in the upper planes.
    fn forward(channel: &[Self], planes: &mut [u8]);
    /// Inverse of [`Sample::forward`].
    fn inverse(channel: &mut [Self], planes: &[u8]);
}

impl Sample for u16 {
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }

    fn forward(channel: &[Self], planes: &mut [u8]) {
        let (high, low) = planes.split_at_mut(channel.len());
        for ((&difference, high), low) in channel.iter().zip(high).zip(low) {
            // Zigzag code: 0, −1, 1, −2 … become 0, 1, 2, 3 …
            let sign = (difference.cast_signed() >> 15).cast_unsigned();
            [*high, *low] = ((difference << 1) ^ sign).to_be_bytes();
        }
    }

    fn inverse(channel: &mut [Self], planes: &[u8]) {
        let (high, low) = planes.split_at(channel.len());
        for ((difference, &high), &low) in channel.iter_mut().zip(high).zip(low) {
            let folded = Self::from_be_bytes([high, low]);
            *difference = (folded >> 1) ^ (folded & 1).wrapping_neg();
        }
    }
}

impl Sample for u32 {
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }

    fn forward(channel: &[Self], planes: &mut [u8]) {
        let (high, low) = planes.split_at_mut(2 * channel.len());
        let (a, b) = high.split_at_mut(channel.len());
        let (c, d) = low.split_at_mut(channel.len());
        for ((((&difference, a), b), c), d) in channel.iter().zip(a).zip(b).zip(c).zip(d) {
            let sign = (difference.cast_signed() >> 31).cast_unsigned();
            [*a, *b, *c, *d] = ((difference << 1) ^ sign).to_be_bytes();
        }
    }

    fn inverse(channel: &mut [Self], planes: &[u8]) {
        let (high, low) = planes.split_at(2 * channel.len());
        let (a, b) = high.split_at(channel.len());
        let (c, d) = low.split_at(channel.len());
        for ((((difference, &a), &b), &c), &d) in channel.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            let folded = Self::from_be_bytes([a, b, c, d]);
            *difference = (folded >> 1) ^ (folded & 1).wrapping_neg();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn upper_plane<S: Sample>(differences: &[S]) -> Vec<u8> {
        let mut planes = vec![0; size_of_val(differences)];
        S::forward(differences, &mut planes);
        planes.truncate(differences.len());
        planes
    }

    #[test]
    fn plane_transform_is_lossless() {
        let all: Vec<u16> = (0..=u16::MAX).collect();
        let wide: Vec<u32> = all
            .iter()
            .map(|&d| u32::from(d).wrapping_mul(65_537 * 3))
            .collect();
        let (mut planes, mut back) = (vec![0; 2 * all.len()], vec![0; all.len()]);
        u16::forward(&all, &mut planes);
        u16::inverse(&mut back, &planes);
        assert_eq!(back, all);
        let (mut planes, mut back) = (vec![0; 4 * wide.len()], vec![0; wide.len()]);
        u32::forward(&wide, &mut planes);
        u32::inverse(&mut back, &planes);
        assert_eq!(back, wide);
    }

    #[test]
    fn small_differences_leave_upper_plane_empty() {
        let small: Vec<u16> = (-128..128i16).map(i16::cast_unsigned).collect();
        assert!(upper_plane(&small).iter().all(|&byte| byte == 0));
        let small: Vec<u32> = (-128..128i32).map(i32::cast_unsigned).collect();
        assert!(upper_plane(&small).iter().all(|&byte| byte == 0));
    }
}
