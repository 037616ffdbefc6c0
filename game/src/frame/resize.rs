//! Pictures at another size: interpolated where it is larger, averaged where it is smaller.

use carom_tracer::ImageSize;
use rayon::prelude::*;

/// The pixels of a picture at another size, interpolated as the window interpolates them.
pub(super) fn interpolated(pixels: &[[u8; 4]], from: ImageSize, to: ImageSize) -> Vec<[u8; 4]> {
    let columns: Vec<(usize, usize, f32)> = (0..to.width)
        .map(|x| taps(x, to.width, from.width))
        .collect();
    let rows = (0..to.height).flat_map(|y| {
        let (top, bottom, down) = taps(y, to.height, from.height);
        let row = |y: usize| &pixels[y * from.width as usize..][..from.width as usize];
        let (top, bottom) = (row(top), row(bottom));
        columns.iter().map(move |&(left, right, along)| {
            std::array::from_fn(|channel| {
                let mix = |row: &[[u8; 4]]| {
                    let (a, b) = (
                        f32::from(row[left][channel]),
                        f32::from(row[right][channel]),
                    );
                    a + (b - a) * along
                };
                let (above, below) = (mix(top), mix(bottom));
                (above + (below - above) * down + 0.5) as u8
            })
        })
    });
    rows.collect()
}

/// The two pixels of `from` beside the middle of pixel `at` of `to`, and the share of the second.
fn taps(at: u32, to: u32, from: u32) -> (usize, usize, f32) {
    let place = (at as f32 + 0.5) * from as f32 / to as f32 - 0.5;
    let place = place.clamp(0.0, from as f32 - 1.0);
    let first = place as usize;
    (first, (first + 1).min(from as usize - 1), place.fract())
}

/// The pixels of a picture at a smaller size, each the mean of the area that it covers, on the threads of the current pool.
/// The result replaces what is in `averaged`.
pub(super) fn average_into(
    pixels: &[[u8; 4]],
    from: ImageSize,
    to: ImageSize,
    averaged: &mut Vec<[u8; 4]>,
) {
    let (wide, narrow) = (from.width as usize, to.width as usize);
    averaged.resize(to.pixels(), [0; 4]);
    if averaged.is_empty() {
        return;
    }
    let columns: Vec<Span> = (0..to.width)
        .map(|x| Span::new(x, to.width, from.width))
        .collect();
    let area = f64::from(from.width) * f64::from(from.height) / to.pixels() as f64;
    let share = (1.0 / area) as f32;
    let rows = averaged.par_chunks_mut(narrow).enumerate();
    rows.for_each_init(
        || vec![[0.0_f32; 4]; wide],
        |sums, (y, row)| {
            sums.fill([0.0; 4]);
            let lines = Span::new(y as u32, to.height, from.height);
            for (line, weight) in lines.weights() {
                let line = &pixels[line * wide..][..wide];
                for (sum, pixel) in sums.iter_mut().zip(line) {
                    for channel in 0..4 {
                        sum[channel] += weight * f32::from(pixel[channel]);
                    }
                }
            }
            for (pixel, column) in row.iter_mut().zip(&columns) {
                let mut mean = [0.5_f32; 4];
                for (x, weight) in column.weights() {
                    for channel in 0..4 {
                        mean[channel] += share * weight * sums[x][channel];
                    }
                }
                for channel in 0..4 {
                    pixel[channel] = mean[channel] as u8;
                }
            }
        },
    );
}

/// The pixels of a row that one pixel of a smaller row covers.
#[derive(Clone, Copy, Debug)]
struct Span {
    first: usize,
    last: usize,
    /// Shares of the first and of the last one that it covers.
    ends: [f32; 2],
}

impl Span {
    fn new(at: u32, to: u32, from: u32) -> Self {
        let edge = |at: u32| f64::from(at) * f64::from(from) / f64::from(to);
        let (start, end) = (edge(at), edge(at + 1));
        let first = start as usize;
        let last = (end.ceil() as usize - 1).max(first);
        let leading = end.min(first as f64 + 1.0) - start;
        Self {
            first,
            last,
            ends: [leading as f32, (end - last as f64) as f32],
        }
    }

    /// Each pixel and its share.
    fn weights(self) -> impl Iterator<Item = (usize, f32)> {
        (self.first..=self.last).map(move |at| {
            let weight = match at {
                at if at == self.first => self.ends[0],
                at if at == self.last => self.ends[1],
                _ => 1.0,
            };
            (at, weight)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row whose levels rise by `step`, of so many pixels, on top of each other.
    fn ramp(size: ImageSize, step: usize) -> Vec<[u8; 4]> {
        let level = |place: usize| (place % size.width as usize * step) as u8;
        (0..size.pixels()).map(|i| [level(i), 7, 0, 255]).collect()
    }

    #[test]
    fn an_interpolated_ramp_stays_a_ramp() {
        let size = ImageSize::new(4, 4);
        let wide = interpolated(&ramp(size, 80), size, ImageSize::new(8, 4));
        let row: Vec<u8> = wide[..8].iter().map(|pixel| pixel[0]).collect();
        assert_eq!(row, [0, 20, 60, 100, 140, 180, 220, 240]);
    }

    #[test]
    fn an_averaged_pixel_is_the_mean_of_its_area() {
        let size = ImageSize::new(6, 3);
        let mut averaged = vec![[9; 4]; 99];
        average_into(&ramp(size, 30), size, ImageSize::new(4, 2), &mut averaged);
        // A pixel and a half each: (0 + 30/2) / 1.5, (30/2 + 60) / 1.5, …
        let row = [10, 50, 100, 140].map(|level| [level, 7, 0, 255]);
        assert_eq!(averaged, [row, row].concat());
    }

    #[test]
    fn averaging_keeps_the_mean_at_any_size() {
        let from = ImageSize::new(97, 41);
        let noisy = |i: usize| [(i as u32).wrapping_mul(2_654_435_761).to_le_bytes()[3]; 4];
        let pixels: Vec<[u8; 4]> = (0..from.pixels()).map(noisy).collect();
        let mean = |pixels: &[[u8; 4]]| {
            let sum: f64 = pixels.iter().map(|pixel| f64::from(pixel[2])).sum();
            sum / pixels.len() as f64
        };
        let mut averaged = Vec::new();
        for (width, height) in [(97, 41), (96, 40), (50, 21), (13, 41), (1, 1)] {
            average_into(&pixels, from, ImageSize::new(width, height), &mut averaged);
            assert_eq!(averaged.len(), (width * height) as usize);
            assert!((mean(&averaged) - mean(&pixels)).abs() < 0.5);
            assert_eq!(averaged == pixels, (width, height) == (97, 41));
        }
    }
}
