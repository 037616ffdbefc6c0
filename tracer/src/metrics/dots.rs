//! Outlier pixels ("fireflies"): single pixels that noise has made far brighter than their
//! surroundings.

use super::compared_pixels;
use crate::{Error, ImageSize};

/// Number of outlier pixels per million.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dots {
    /// Anywhere in the image.
    pub all: f64,
    /// Those where the reference is smooth: no channel varies by [`DOT_LEVELS`] or more among a
    /// pixel and its neighbours. The others lie at edges and in details of a pixel's size, whose
    /// own contrast exceeds the threshold in the test image but not in the reference.
    pub smooth: f64,
}

/// Outliers of an 8-bit image: pixels of which a channel is [`DOT_LEVELS`] or more above the median
/// of the eight pixels around it, but is not in the reference.
///
/// # Errors
/// [`Error::InvalidSettings`] if the number of pixels of an image is not that of `size`, or is 0.
pub fn dots_per_million(
    size: ImageSize,
    test: &[[u8; 3]],
    reference: &[[u8; 3]],
) -> Result<Dots, Error> {
    let pixels = compared_pixels(size, test, reference)?;
    let is_dot = |index: &usize| {
        (0..3).any(|c| {
            rise(size, test, *index, c) >= DOT_LEVELS
                && rise(size, reference, *index, c) < DOT_LEVELS
        })
    };
    let dots: Vec<usize> = (0..pixels).filter(is_dot).collect();
    let is_smooth = |index: &&usize| (0..3).all(|c| span(size, reference, **index, c) < DOT_LEVELS);
    let smooth = dots.iter().filter(is_smooth).count();
    let per_million = |count: usize| count as f64 * 1e6 / pixels as f64;
    Ok(Dots {
        all: per_million(dots.len()),
        smooth: per_million(smooth),
    })
}

/// Levels (of 255) above the median of its neighbours from which a pixel is an outlier.
pub const DOT_LEVELS: i32 = 24;

/// Difference between a channel and the median of the pixels around it; of an even number, the
/// upper median.
fn rise(size: ImageSize, picture: &[[u8; 3]], index: usize, channel: usize) -> i32 {
    let (mut around, mut count) = ([0; 8], 0);
    for place in around_pixel(size, index) {
        around[count] = picture[place][channel];
        count += 1;
    }
    let around = &mut around[..count];
    around.sort_unstable();
    let median = around.get(count / 2).copied().unwrap_or_default();
    i32::from(picture[index][channel]) - i32::from(median)
}

/// Range of a channel among a pixel and those around it.
fn span(size: ImageSize, picture: &[[u8; 3]], index: usize, channel: usize) -> i32 {
    let (mut least, mut most) = (picture[index][channel], picture[index][channel]);
    for place in around_pixel(size, index) {
        let level = picture[place][channel];
        (least, most) = (least.min(level), most.max(level));
    }
    i32::from(most) - i32::from(least)
}

/// Indices of the pixels around one, eight of them inside the image.
fn around_pixel(size: ImageSize, index: usize) -> impl Iterator<Item = usize> {
    let (width, height) = (size.width as usize, size.height as usize);
    let (x, y) = (index % width, index / width);
    let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
    let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
    let places = rows.flat_map(move |v| columns.clone().map(move |u| v * width + u));
    places.filter(move |place| *place != index)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: ImageSize = ImageSize::new(20, 10);

    /// Grey, except for one pixel with a different blue.
    fn with_blue(index: usize, blue: u8) -> Vec<[u8; 3]> {
        let mut picture = vec![[100; 3]; SIZE.pixels()];
        picture[index][2] = blue;
        picture
    }

    #[test]
    fn one_bright_channel_is_a_dot() {
        let plain = with_blue(0, 100);
        let dots = |index, blue| {
            dots_per_million(SIZE, &with_blue(index, blue), &plain)
                .unwrap()
                .all
        };
        for corner_edge_or_middle in [0, 19, 60, 199, 105] {
            assert_eq!(dots(corner_edge_or_middle, 124), 5000.0);
            assert_eq!(dots(corner_edge_or_middle, 123), 0.0);
            assert_eq!(dots(corner_edge_or_middle, 0), 0.0);
        }
    }

    #[test]
    fn what_the_reference_shows_is_no_dot() {
        let glint = with_blue(105, 255);
        assert_eq!(dots_per_million(SIZE, &glint, &glint).unwrap().all, 0.0);
        assert!(dots_per_million(ImageSize::new(0, 0), &[], &[]).is_err());
    }

    #[test]
    fn dots_in_details_of_the_reference_are_not_among_the_smooth() {
        let dots = |index, reference: &[[u8; 3]]| {
            dots_per_million(SIZE, &with_blue(index, 124), reference).unwrap()
        };
        let expected = |all, smooth| Dots { all, smooth };
        // A neighbour that differs by 23 levels of green counts as smooth, one that differs by 24
        // as detail.
        let mut reference = with_blue(0, 100);
        reference[104][1] = 123;
        assert_eq!(dots(105, &reference), expected(5000.0, 5000.0));
        reference[104][1] = 124;
        assert_eq!(dots(105, &reference), expected(5000.0, 0.0));
        assert_eq!(dots(107, &reference), expected(5000.0, 5000.0));
    }
}
