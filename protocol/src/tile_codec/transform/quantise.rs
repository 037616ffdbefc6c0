//! Quantisation: each channel value to the nearest level that a precision keeps, and back.
//!
//! Values are quantised independently, so that an error depends on nothing but the pixel and its row.

/// Green, red and blue planes of a tile, or of all tiles of a message one after the other.
pub(crate) type Channels = [Vec<u8>; 3];

#[inline(always)]
pub(crate) fn resized(plane: &mut Vec<u8>, length: usize) -> &mut [u8] {
    plane.resize(length, 0);
    plane
}

/// Offset of the levels from multiples of the step in each row, repeated cyclically: an ordered dither.
///
/// A smooth surface is rounded up in one row and down in the next, so that the eye, like the metric FLIP,
/// perceives the mean of the rows instead of bands of false colour. Denoised frames within one level have a
/// FLIP of 0.010 with it and 0.035 with the same levels in each row, for at most a quarter more bytes.
#[inline(always)]
fn shifts(step: u8) -> &'static [i8] {
    // Each residue modulo the step occurs once in a cycle, so that the levels are unbiased over it.
    match step {
        1 => &[0],
        3 => &[-1, 0, 1],
        5 => &[0, 2, -1, 1, -2],
        _ => unreachable!("no precision has steps of {step}"),
    }
}

/// Quantises a tile: values to indices of levels.
#[inline(always)]
pub(crate) fn quantised(step: u8, width: usize, pixels: &[[u8; 3]]) -> Vec<[u8; 3]> {
    let mut levels = pixels.to_vec();
    if step == 1 {
        return levels;
    }
    for (row, shift) in levels.chunks_mut(width).zip(shifts(step).iter().cycle()) {
        match step {
            3 => divide::<3>(row.as_flattened_mut(), *shift),
            _ => divide::<5>(row.as_flattened_mut(), *shift),
        }
    }
    levels
}

/// As [`quantised`], into a plane for each channel.
#[inline(always)]
pub(crate) fn quantise_planes(planes: &mut Channels, step: u8, width: usize, pixels: &[[u8; 3]]) {
    let levels = quantised(step, width, pixels);
    let [g, r, b] = planes.each_mut().map(|plane| resized(plane, pixels.len()));
    for (((level, g), r), b) in levels.iter().zip(g).zip(r).zip(b) {
        [*r, *g, *b] = *level;
    }
}

/// Indices of levels to values, in place.
#[inline(always)]
pub(crate) fn dequantise(step: u8, width: usize, levels: &mut [[u8; 3]]) {
    if step == 1 {
        return;
    }
    for (row, shift) in levels.chunks_mut(width).zip(shifts(step).iter().cycle()) {
        match step {
            3 => multiply::<3>(row.as_flattened_mut(), *shift),
            _ => multiply::<5>(row.as_flattened_mut(), *shift),
        }
    }
}

/// `pixels` with each channel at the nearest level.
#[inline(always)]
pub(crate) fn rounded(step: u8, width: usize, pixels: &[[u8; 3]]) -> Box<[[u8; 3]]> {
    let mut rounded = quantised(step, width, pixels);
    dequantise(step, width, &mut rounded);
    rounded.into_boxed_slice()
}

/// Divides to the nearest level. The step is a constant, so that the compiler multiplies by its reciprocal in
/// SIMD.
#[inline(always)]
fn divide<const STEP: u16>(values: &mut [u8], shift: i8) {
    // Level nearest to v in a row whose levels are offset by `shift`: ⌊(v − shift + ⌊step / 2⌋) / step⌋. The
    // numerator is never negative, since the shift is at most half a step.
    let half = (STEP / 2).wrapping_add_signed(-i16::from(shift));
    for value in values {
        *value = ((u16::from(*value) + half) / STEP) as u8;
    }
}

/// Multiplies levels back to values. Saturates at 0 and 255, beyond which the outermost levels of a shifted
/// row lie, and for invalid levels from hostile bytes.
#[inline(always)]
fn multiply<const STEP: u8>(levels: &mut [u8], shift: i8) {
    let [up, down] = [shift, -shift].map(|shift| shift.max(0).cast_unsigned());
    for level in levels {
        // 255 is a multiple of 3 and of 5, so the largest index is exact.
        let value = (*level).min(255 / STEP).wrapping_mul(STEP);
        *level = value.saturating_add(up).saturating_sub(down);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every byte value, in each of 12 rows of 256 pixels.
    fn values() -> Vec<[u8; 3]> {
        let pixels = (0..12).flat_map(|row| (0..=255).map(move |value| [value, 255 - value, row]));
        pixels.collect()
    }

    #[test]
    fn levels_lie_within_half_a_step() {
        let values = values();
        for step in [1, 3, 5] {
            let rounded = rounded(step, 256, &values);
            let pairs = values.as_flattened().iter().zip(rounded.as_flattened());
            for (value, rounded) in pairs {
                assert!(value.abs_diff(*rounded) <= step / 2, "{value} {rounded}");
            }
            assert_eq!(super::rounded(step, 256, &rounded), rounded);
        }
    }

    #[test]
    fn mean_over_rows_is_exact() {
        for (step, count) in [(3, 3), (5, 5)] {
            for value in step..=255 - step {
                let rounded = rounded(step, 1, &vec![[value; 3]; count]);
                let sum: usize = rounded.iter().map(|pixel| usize::from(pixel[0])).sum();
                assert_eq!(sum, count * usize::from(value), "{rounded:?}");
            }
        }
    }

    #[test]
    fn planes_hold_the_same_levels() {
        let values = values();
        for step in [1, 3, 5] {
            let mut planes = Channels::default();
            quantise_planes(&mut planes, step, 256, &values);
            let [g, r, b] = &planes;
            let levels = g.iter().zip(r).zip(b).map(|((g, r), b)| [*r, *g, *b]);
            assert!(levels.eq(quantised(step, 256, &values)));
        }
    }
}
