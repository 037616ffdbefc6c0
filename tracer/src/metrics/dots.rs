//! Dots: single pixels that noise has left far brighter than what lies around them.

use super::compared_pixels;
use crate::{Error, ImageSize};

/// Dots in a million pixels of an 8-bit picture: a channel is [`DOT_LEVELS`] or more above the
/// median of the eight pixels around it, and in the reference it is not.
///
/// # Errors
/// [`Error::InvalidSettings`] if a picture has not as many pixels as `size`, or there are none.
pub fn dots_per_million(
    size: ImageSize,
    test: &[[u8; 3]],
    reference: &[[u8; 3]],
) -> Result<f64, Error> {
    let pixels = compared_pixels(size, test, reference)?;
    let is_dot = |index: &usize| {
        (0..3).any(|c| {
            rise(size, test, *index, c) >= DOT_LEVELS
                && rise(size, reference, *index, c) < DOT_LEVELS
        })
    };
    let dots = (0..pixels).filter(is_dot).count();
    Ok(dots as f64 * 1e6 / pixels as f64)
}

/// Steps of 255 above its neighbours' median from which a pixel is a dot.
pub const DOT_LEVELS: i32 = 24;

/// How far a channel is above the median of the pixels around it; of an even number the higher one
/// of the two in the middle.
fn rise(size: ImageSize, picture: &[[u8; 3]], index: usize, channel: usize) -> i32 {
    let (width, height) = (size.width as usize, size.height as usize);
    let (x, y) = (index % width, index / width);
    let (mut around, mut count) = ([0; 8], 0);
    for v in y.saturating_sub(1)..=(y + 1).min(height - 1) {
        for u in x.saturating_sub(1)..=(x + 1).min(width - 1) {
            if (u, v) != (x, y) {
                around[count] = picture[v * width + u][channel];
                count += 1;
            }
        }
    }
    let around = &mut around[..count];
    around.sort_unstable();
    let median = around.get(count / 2).copied().unwrap_or_default();
    i32::from(picture[index][channel]) - i32::from(median)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: ImageSize = ImageSize::new(20, 10);

    /// Grey, but for one pixel whose blue differs.
    fn with_blue(index: usize, blue: u8) -> Vec<[u8; 3]> {
        let mut picture = vec![[100; 3]; SIZE.pixels()];
        picture[index][2] = blue;
        picture
    }

    #[test]
    fn one_bright_channel_is_a_dot() {
        let plain = with_blue(0, 100);
        let dots = |index, blue| dots_per_million(SIZE, &with_blue(index, blue), &plain).unwrap();
        for corner_edge_or_middle in [0, 19, 60, 199, 105] {
            assert_eq!(dots(corner_edge_or_middle, 124), 5000.0);
            assert_eq!(dots(corner_edge_or_middle, 123), 0.0);
            assert_eq!(dots(corner_edge_or_middle, 0), 0.0);
        }
    }

    #[test]
    fn what_the_reference_shows_is_no_dot() {
        let glint = with_blue(105, 255);
        assert_eq!(dots_per_million(SIZE, &glint, &glint).unwrap(), 0.0);
        assert!(dots_per_million(ImageSize::new(0, 0), &[], &[]).is_err());
    }
}
