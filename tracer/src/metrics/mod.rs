//! Metrics of the difference between images: error, bias, and its statistical significance.

mod dots;
mod flip;

pub use dots::{DOT_LEVELS, Dots, dots_per_million};
pub use flip::{Flip, flip};

use crate::image::RadianceImage;
use crate::{Error, ImageSize, Tile, TileGrid};

/// The number of pixels of two images of `size`.
///
/// # Errors
/// [`Error::InvalidSettings`] if the number of pixels of an image is not that of `size`, or is 0.
fn compared_pixels(
    size: ImageSize,
    test: &[[u8; 3]],
    reference: &[[u8; 3]],
) -> Result<usize, Error> {
    let pixels = size.pixels();
    if pixels == 0 || test.len() != pixels || reference.len() != pixels {
        return Err(Error::settings(format!(
            "pictures of {} and {} pixels cannot be compared as {size}: each must have {pixels}, \
             and at least one",
            test.len(),
            reference.len()
        )));
    }
    Ok(pixels)
}

/// An image with the standard error of each pixel and channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Mean radiance.
    pub mean: RadianceImage,
    /// Standard error of that mean.
    pub stderr: RadianceImage,
}

/// Two images of the same view, compared by [`compare`].
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// [`rel_mse`].
    pub rel_mse: f64,
    /// [`psnr`] with a peak of 1, in dB.
    pub psnr_db: f64,
    /// [`mean_ratio`].
    pub mean_ratio: [f64; 3],
    /// Every region, row by row from the top left.
    pub regions: Vec<Region>,
}

/// A region of two images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// The region's pixels.
    pub tile: Tile,
    /// Mean radiance in the image.
    pub mean: [f64; 3],
    /// Mean radiance in the reference.
    pub reference: [f64; 3],
    /// Difference of the means in units of its standard error. Without bias it is normally
    /// distributed: |z| exceeds 4 once in 16,000 cases.
    pub z: [f64; 3],
}

/// Rounding error of f32 sums in a mean, relative to it: the only error left if all samples are
/// equal.
const ROUNDING: f64 = 1e-5;

/// Computes all metrics; regions have `region_edge` × `region_edge` pixels, fewer at the right and
/// bottom.
///
/// # Errors
/// [`Error::InvalidSettings`] if the images differ in size.
pub fn compare(
    picture: &Estimate,
    reference: &Estimate,
    region_edge: u16,
) -> Result<Comparison, Error> {
    let grid = TileGrid::new(picture.mean.size, region_edge);
    let regions = grid.tiles(grid.all());
    let regions = regions.map(|tile| region(picture, reference, tile));
    Ok(Comparison {
        rel_mse: rel_mse(&picture.mean, &reference.mean)?,
        psnr_db: psnr(&picture.mean, &reference.mean, 1.0)?,
        mean_ratio: mean_ratio(&picture.mean, &reference.mean)?,
        regions: regions.collect::<Result<_, _>>()?,
    })
}

/// Mean over pixels and channels of `(x − r)² / (r² + 0.01)`: the squared error relative to
/// brightness, much as it is perceived.
///
/// # Errors
/// [`Error::InvalidSettings`] if the images differ in size.
pub fn rel_mse(picture: &RadianceImage, reference: &RadianceImage) -> Result<f64, Error> {
    mean_of(picture, reference, |x, r| (x - r).powi(2) / (r * r + 0.01))
}

/// `10 log₁₀(peak² / mean squared error)` of linear radiance, in dB; +∞ for equal images.
///
/// # Errors
/// [`Error::InvalidSettings`] if the images differ in size.
pub fn psnr(picture: &RadianceImage, reference: &RadianceImage, peak: f64) -> Result<f64, Error> {
    let mse = mean_of(picture, reference, |x, r| (x - r).powi(2))?;
    Ok(10.0 * (peak * peak / mse).log10())
}

/// Ratio of the image's mean to the reference's, per channel: 1 without bias.
///
/// # Errors
/// [`Error::InvalidSettings`] if the images differ in size.
pub fn mean_ratio(picture: &RadianceImage, reference: &RadianceImage) -> Result<[f64; 3], Error> {
    same_size(picture.size, reference.size)?;
    let (picture, reference) = (mean(picture), mean(reference));
    Ok([0, 1, 2].map(|channel| picture[channel] / reference[channel]))
}

/// Mean radiance of an image, per channel.
pub fn mean(picture: &RadianceImage) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for pixel in &picture.pixels {
        add(&mut sum, pixel.map(f64::from));
    }
    sum.map(|sum| sum / picture.pixels.len() as f64)
}

/// Means of one region, and their difference in standard errors. Pixels are assumed to be
/// independent.
///
/// # Errors
/// [`Error::InvalidSettings`] if the images differ in size.
pub fn region(picture: &Estimate, reference: &Estimate, tile: Tile) -> Result<Region, Error> {
    for image in [&picture.stderr, &reference.mean, &reference.stderr] {
        same_size(picture.mean.size, image.size)?;
    }
    let (mean, variance) = picture.region(tile);
    let (reference, reference_variance) = reference.region(tile);
    let z = [0, 1, 2].map(|i| {
        let rounding = (ROUNDING * reference[i]).powi(2);
        let error = (variance[i] + reference_variance[i] + rounding).sqrt();
        let difference: f64 = mean[i] - reference[i];
        if difference == 0.0 {
            0.0
        } else {
            difference / error
        }
    });
    Ok(Region {
        tile,
        mean,
        reference,
        z,
    })
}

impl Estimate {
    /// Mean and standard error of independent images with the same number of samples each.
    ///
    /// # Errors
    /// [`Error::InvalidSettings`] if there are fewer than two, or they differ in size.
    pub fn from_batches(batches: &[RadianceImage]) -> Result<Self, Error> {
        let [first, _, ..] = batches else {
            let sentence = "a standard error needs at least two pictures";
            return Err(Error::settings(sentence.to_owned()));
        };
        let size = first.size;
        batches
            .iter()
            .try_for_each(|batch| same_size(size, batch.size))?;
        let (mut mean, mut stderr) = (RadianceImage::black(size), RadianceImage::black(size));
        let count = batches.len() as f64;
        for pixel in 0..size.pixels() {
            for channel in 0..3 {
                let values = || batches.iter().map(|b| f64::from(b.pixels[pixel][channel]));
                let average = values().sum::<f64>() / count;
                let squares = values().map(|value| (value - average).powi(2)).sum::<f64>();
                mean.pixels[pixel][channel] = average as f32;
                // Standard error of the mean, with Bessel's correction: √(Σ(x − x̄)² / (n(n−1))).
                stderr.pixels[pixel][channel] = (squares / (count * (count - 1.0))).sqrt() as f32;
            }
        }
        Ok(Self { mean, stderr })
    }

    /// Mean of a region, and the variance of that mean.
    fn region(&self, tile: Tile) -> ([f64; 3], [f64; 3]) {
        let (mut mean, mut variance) = ([0.0; 3], [0.0; 3]);
        for y in tile.y..tile.y + tile.height {
            for x in tile.x..tile.x + tile.width {
                let pixel = (y * self.mean.size.width + x) as usize;
                add(&mut mean, self.mean.pixels[pixel].map(f64::from));
                add(
                    &mut variance,
                    self.stderr.pixels[pixel].map(|e| f64::from(e).powi(2)),
                );
            }
        }
        let pixels = tile.pixels() as f64;
        (
            mean.map(|sum| sum / pixels),
            variance.map(|sum| sum / (pixels * pixels)),
        )
    }
}

impl Comparison {
    /// The largest `|z|` of all regions and channels, with its region; `None` without regions.
    pub fn worst_region(&self) -> Option<(f64, &Region)> {
        let worst = |region: &Region| region.z.map(f64::abs).into_iter().fold(0.0, f64::max);
        let regions = self.regions.iter().map(|region| (worst(region), region));
        regions.max_by(|a, b| a.0.total_cmp(&b.0))
    }
}

fn mean_of(
    picture: &RadianceImage,
    reference: &RadianceImage,
    error: impl Fn(f64, f64) -> f64,
) -> Result<f64, Error> {
    same_size(picture.size, reference.size)?;
    let channels = picture.pixels.as_flattened().iter();
    let pairs = channels.zip(reference.pixels.as_flattened());
    let sum: f64 = pairs
        .map(|(&x, &r)| error(f64::from(x), f64::from(r)))
        .sum();
    Ok(sum / (3 * picture.pixels.len()) as f64)
}

fn same_size(a: ImageSize, b: ImageSize) -> Result<(), Error> {
    if a == b {
        return Ok(());
    }
    Err(Error::settings(format!(
        "pictures of {a} and {b} pixels cannot be compared: trace both at one size"
    )))
}

fn add(sum: &mut [f64; 3], term: [f64; 3]) {
    for (sum, term) in sum.iter_mut().zip(term) {
        *sum += term;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::uniforms;

    const SIZE: ImageSize = ImageSize::new(32, 32);

    fn constant(value: f32) -> RadianceImage {
        RadianceImage {
            size: SIZE,
            pixels: vec![[value; 3]; SIZE.pixels()],
        }
    }

    /// Uniform noise of standard deviation 0.1 about `mean`.
    fn noisy(mean: f32, seed: u32) -> RadianceImage {
        let noise = |u: f32| mean + 0.1 * 12f32.sqrt() * (u - 0.5);
        let pixel = |i| {
            let [r, g, b, _] = uniforms(i, 0, 0, seed).map(noise);
            [r, g, b]
        };
        RadianceImage {
            size: SIZE,
            pixels: (0..SIZE.pixels() as u32).map(pixel).collect(),
        }
    }

    fn estimate(mean: f32, seed: u32) -> Estimate {
        let batches: Vec<_> = (0..8).map(|batch| noisy(mean, 8 * seed + batch)).collect();
        Estimate::from_batches(&batches).unwrap()
    }

    #[test]
    fn errors_of_constant_pictures_are_known() {
        let (picture, reference) = (constant(0.5), constant(0.3));
        let rel_mse = rel_mse(&picture, &reference).unwrap();
        assert!((rel_mse - 0.04 / 0.1).abs() < 1e-6, "{rel_mse}");
        let psnr = psnr(&picture, &reference, 1.0).unwrap();
        assert!((psnr - 13.979_400_09).abs() < 1e-5, "{psnr}");
        let ratio = mean_ratio(&picture, &reference).unwrap();
        assert!(
            ratio.iter().all(|ratio| (ratio - 5.0 / 3.0).abs() < 1e-6),
            "{ratio:?}"
        );
        assert_eq!(super::psnr(&picture, &picture, 1.0).unwrap(), f64::INFINITY);
    }

    #[test]
    fn the_standard_error_is_that_of_the_mean() {
        let estimate = estimate(1.0, 3);
        let mean_variance = estimate.stderr.pixels.as_flattened().iter();
        let mean_variance = mean_variance.map(|e| f64::from(e * e)).sum::<f64>();
        let stderr = (mean_variance / (3 * SIZE.pixels()) as f64).sqrt();
        assert!(
            (stderr / (0.1 / 8f64.sqrt()) - 1.0).abs() < 0.03,
            "{stderr}"
        );
    }

    /// Pure noise gives a z of variance 1; a bias of a tenth of the noise is detected.
    #[test]
    fn a_bias_shows_where_noise_does_not() {
        let unbiased = compare(&estimate(1.0, 1), &estimate(1.0, 2), 4).unwrap();
        let z2 = unbiased
            .regions
            .iter()
            .flat_map(|r| r.z)
            .map(|z| z * z)
            .sum::<f64>();
        let z2 = z2 / (3 * unbiased.regions.len()) as f64;
        assert!((0.75..1.3).contains(&z2), "{z2}");
        assert!(unbiased.worst_region().unwrap().0 < 4.0);

        let biased = compare(&estimate(1.01, 1), &estimate(1.0, 2), 32).unwrap();
        assert!(
            biased.regions[0].z.iter().all(|&z| z > 4.0),
            "{:?}",
            biased.regions
        );
    }

    #[test]
    fn pictures_of_other_sizes_are_refused() {
        let wide = RadianceImage::black(ImageSize::new(64, 32));
        assert!(rel_mse(&wide, &constant(0.0)).is_err());
        assert!(Estimate::from_batches(&[wide, constant(0.0)]).is_err());
        assert!(Estimate::from_batches(&[constant(0.0)]).is_err());
    }
}
