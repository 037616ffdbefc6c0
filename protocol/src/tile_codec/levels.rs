//! The levels that are kept of a channel's 256 values, each value by itself, so that an error depends
//! on nothing beside the pixel.

use super::predict::sized;
use super::split::Channels;

/// `from`, each channel at the nearest level that `step` keeps.
pub(super) fn round(pixels: &mut [[u8; 3]], step: u8, from: &[[u8; 3]]) {
    if step == 1 {
        return pixels.copy_from_slice(from);
    }
    let levels = levels(step);
    for (pixel, from) in pixels.iter_mut().zip(from) {
        *pixel = from.map(|channel| levels[usize::from(channel)] * step);
    }
}

/// A copy by [`round`].
pub(super) fn rounded(step: u8, pixels: &[[u8; 3]]) -> Box<[[u8; 3]]> {
    let mut rounded: Box<[[u8; 3]]> = pixels.into();
    if step != 1 {
        round(&mut rounded, step, pixels);
    }
    rounded
}

/// The level of each channel, in steps.
pub(super) fn of(step: u8, pixels: &[[u8; 3]]) -> Vec<[u8; 3]> {
    if step == 1 {
        return pixels.to_vec();
    }
    let levels = levels(step);
    let level = |channel: u8| levels[usize::from(channel)];
    pixels.iter().map(|pixel| pixel.map(level)).collect()
}

/// The level of each value, in steps.
pub(super) fn levels(step: u8) -> &'static [u8; 256] {
    match step {
        1 => const { &levels_of(1) },
        3 => const { &levels_of(3) },
        5 => const { &levels_of(5) },
        _ => unreachable!("no precision has steps of {step}"),
    }
}

const fn levels_of(step: u16) -> [u8; 256] {
    assert!(255 % step == 0, "black and white are levels");
    let mut levels = [0; 256];
    let mut value = 0;
    while value < 256 {
        levels[value as usize] = ((value + step / 2) / step) as u8;
        value += 1;
    }
    levels
}

pub(super) fn quantise(planes: &mut Channels, levels: &[u8; 256], pixels: &[[u8; 3]]) {
    let [g, r, b] = planes.each_mut().map(|plane| sized(plane, pixels.len()));
    for (((pixel, g), r), b) in pixels.iter().zip(g).zip(r).zip(b) {
        *r = levels[usize::from(pixel[0])];
        *g = levels[usize::from(pixel[1])];
        *b = levels[usize::from(pixel[2])];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_is_within_half_a_step() {
        for step in [1, 3, 5] {
            let values: Vec<[u8; 3]> = (0..=255).map(|value| [value; 3]).collect();
            for (value, rounded) in values.iter().zip(rounded(step, &values)) {
                assert!(value[0].abs_diff(rounded[0]) <= step / 2, "{value:?}");
            }
            let again = rounded(step, &rounded(step, &values));
            assert_eq!(again, rounded(step, &values));
        }
    }
}
