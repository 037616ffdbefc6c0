//! FLIP: the difference that is perceived when flipping between two images.
//!
//! After Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström and Fairchild, "FLIP: A Difference
//! Evaluator for Alternating Images", 2020, for low dynamic range. With the constants of the
//! authors' evaluator, it agrees with that within 1e-3:
//!
//! ```text
//! sRGB ─▶ YCxCz ─▶ contrast sensitivity ─▶ CIELAB, Hunt ─▶ HyAB ─▶ colour difference ──┐
//!            └──▶ edges and points of the lightness ─▶ feature difference ─────────────┴▶ FLIP
//! ```

use rayon::prelude::*;

use super::compared_pixels;
use crate::tonemap::linear;
use crate::{Error, ImageSize};

/// Perceived difference of two images, from 0 (none) to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Flip {
    /// Mean over all pixels.
    pub mean: f64,
    /// Value of each pixel, row-major from the top left.
    pub map: Vec<f32>,
}

/// Compares 8-bit sRGB images at 67 pixels per degree of the visual field: a 0.7 m wide screen of
/// 3840 pixels seen from 0.7 m.
///
/// # Errors
/// [`Error::InvalidSettings`] if the number of pixels of an image is not that of `size`, or is 0.
pub fn flip(size: ImageSize, test: &[[u8; 3]], reference: &[[u8; 3]]) -> Result<Flip, Error> {
    let pixels = compared_pixels(size, test, reference)?;
    let (test, reference) = rayon::join(
        || Perceived::new(size, test),
        || Perceived::new(size, reference),
    );
    // Green and blue have the largest distance of any two colours of the screen.
    let color_max = color_distance(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0]));
    let pixel = |index: usize| {
        let color = color_distance(test.colors[index], reference.colors[index]);
        let color = redistribute(color, color_max);
        let edge = (test.edges[index] - reference.edges[index]).abs();
        let point = (test.points[index] - reference.points[index]).abs();
        // A detector's response is the length of a vector of two components of up to 1, so at most
        // √2.
        let feature = (edge.max(point) * std::f32::consts::FRAC_1_SQRT_2).powf(FEATURE_EXPONENT);
        // As `color` is at most 1, a larger feature difference raises the result.
        color.powf(1.0 - feature)
    };
    let map: Vec<f32> = (0..pixels).into_par_iter().map(pixel).collect();
    let mean = map.iter().map(|value| f64::from(*value)).sum::<f64>() / pixels as f64;
    Ok(Flip { mean, map })
}

/// An image as it is perceived.
struct Perceived {
    /// L*a*b* after the contrast sensitivity filter and the Hunt effect.
    colors: Vec<[f32; 3]>,
    edges: Vec<f32>,
    points: Vec<f32>,
}

impl Perceived {
    fn new(size: ImageSize, picture: &[[u8; 3]]) -> Self {
        let linear: Vec<[f32; 3]> = picture.iter().map(|pixel| pixel.map(linear)).collect();
        let opponent: Vec<[f32; 3]> = linear.iter().map(|rgb| ycxcz(*rgb)).collect();
        let plane =
            |channel: usize| -> Vec<f32> { opponent.iter().map(|pixel| pixel[channel]).collect() };
        let [y, cx, cz] = [plane(0), plane(1), plane(2)];
        let blurred = [(&y, LIGHTNESS), (&cx, RED_GREEN), (&cz, BLUE_YELLOW)];
        let [by, bx, bz] = blurred.map(|(plane, sensitivity)| blur(size, plane, sensitivity));
        let pixels = by.iter().zip(&bx).zip(&bz);
        let color = |((y, x), z): ((&f32, &f32), &f32)| {
            // Filtering may produce colours outside of the gamut.
            hunt_lab(rgb_of_ycxcz([*y, *x, *z]).map(|channel| channel.clamp(0.0, 1.0)))
        };
        // Relative luminance, without the offset and scale of Y in YCxCz.
        let lightness: Vec<f32> = y.iter().map(|y| (y + 16.0) / 116.0).collect();
        Self {
            colors: pixels.map(color).collect(),
            edges: features(size, &lightness, &Detector::edge()),
            points: features(size, &lightness, &Detector::point()),
        }
    }
}

/// The two Gaussians of a contrast sensitivity function, each a weight and a width in degrees².
type Sensitivity = [(f32, f32); 2];

const LIGHTNESS: Sensitivity = [(1.0, 0.0047), (0.0, 1e-5)];
const RED_GREEN: Sensitivity = [(1.0, 0.0053), (0.0, 1e-5)];
const BLUE_YELLOW: Sensitivity = [(34.1, 0.04), (13.5, 0.025)];
/// The largest of these widths, which determines the size of all filters.
const WIDTH_MAX: f32 = 0.04;
const PIXELS_PER_DEGREE: f32 = 67.0;
/// Width of a feature in degrees.
const FEATURE_WIDTH: f32 = 0.082;
const COLOR_EXPONENT: f32 = 0.7;
const FEATURE_EXPONENT: f32 = 0.5;
/// Colour differences up to this fraction of the largest one take up [`SMALL_DIFFERENCES_TO`] of
/// the scale.
const SMALL_DIFFERENCES: f32 = 0.4;
const SMALL_DIFFERENCES_TO: f32 = 0.95;

/// Filters a plane by a contrast sensitivity function.
fn blur(size: ImageSize, plane: &[f32], sensitivity: Sensitivity) -> Vec<f32> {
    let pi = std::f32::consts::PI;
    // Three standard deviations of the widest Gaussian: exp(−π² x²/b) has σ = √(b / 2π²) degrees.
    let radius = (3.0 * (WIDTH_MAX / (2.0 * pi * pi)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let gaussian = |width: f32| -> Vec<f32> {
        let at = |x: i32| (x as f32 / PIXELS_PER_DEGREE).powi(2);
        let value = |x: i32| (-pi * pi * at(x) / width).exp();
        (-radius..=radius).map(value).collect()
    };
    let mut sum = vec![0.0; plane.len()];
    let mut total = 0.0;
    for (weight, width) in sensitivity.into_iter().filter(|(weight, _)| *weight > 0.0) {
        // A sensitivity a·exp(−b f²) over frequency is a filter a·√(π/b)·exp(−π² x²/b) over
        // position: its one-dimensional Fourier transform, as in the authors' evaluator.
        let weight = weight * (pi / width).sqrt();
        let kernel = gaussian(width);
        // The 2-D kernel is the outer product of the 1-D kernel with itself, so its sum is the
        // square.
        total += weight * kernel.iter().sum::<f32>().powi(2);
        let filtered = separable(size, plane, &kernel, &kernel);
        for (sum, value) in sum.iter_mut().zip(filtered) {
            *sum += weight * value;
        }
    }
    sum.iter_mut().for_each(|value| *value /= total);
    sum
}

/// A separable feature detector: weights across and along a feature.
struct Detector {
    across: Vec<f32>,
    along: Vec<f32>,
}

impl Detector {
    /// First derivative of a Gaussian.
    fn edge() -> Self {
        Self::new(|x, _| -x)
    }

    /// Second derivative of a Gaussian.
    fn point() -> Self {
        Self::new(|x, deviation| x * x / (deviation * deviation) - 1.0)
    }

    /// Normalised so that positive weights sum to 1 and negative ones to −1.
    fn new(shape: impl Fn(f32, f32) -> f32) -> Self {
        let deviation = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
        let radius = (3.0 * deviation).ceil() as i32;
        let gaussian = |x: f32| (-x * x / (2.0 * deviation * deviation)).exp();
        let steps = || (-radius..=radius).map(|x| x as f32);
        let along: Vec<f32> = steps().map(gaussian).collect();
        let mut across: Vec<f32> = steps().map(|x| shape(x, deviation) * gaussian(x)).collect();
        let sum_along: f32 = along.iter().sum();
        let sum = |sign: f32| -> f32 { across.iter().map(|w| (w * sign).max(0.0)).sum() };
        let (positive, negative) = (sum(1.0) * sum_along, sum(-1.0) * sum_along);
        for weight in &mut across {
            *weight /= if *weight > 0.0 { positive } else { negative };
        }
        Self { across, along }
    }
}

/// Magnitude of the detector's responses along both axes.
fn features(size: ImageSize, lightness: &[f32], detector: &Detector) -> Vec<f32> {
    let horizontal = separable(size, lightness, &detector.across, &detector.along);
    let vertical = separable(size, lightness, &detector.along, &detector.across);
    let pairs = horizontal.iter().zip(&vertical);
    pairs.map(|(x, y)| x.hypot(*y)).collect()
}

/// Correlates an image with `horizontal` ⊗ `vertical`; the image is extended by its border pixels.
fn separable(size: ImageSize, plane: &[f32], horizontal: &[f32], vertical: &[f32]) -> Vec<f32> {
    let (width, height) = (size.width as usize, size.height as usize);
    let mut rows = vec![0.0; plane.len()];
    let across = rows.par_chunks_mut(width).zip(plane.par_chunks(width));
    across.for_each(|(to, from)| {
        for (x, to) in to.iter_mut().enumerate() {
            let taps = horizontal.iter().enumerate();
            let product = |(i, weight): (usize, &f32)| weight * from[tap(x, i, horizontal, width)];
            *to = taps.map(product).sum();
        }
    });
    let mut filtered = vec![0.0; plane.len()];
    let down = filtered.par_chunks_mut(width).enumerate();
    down.for_each(|(y, to)| {
        for (i, weight) in vertical.iter().enumerate() {
            let row = tap(y, i, vertical, height) * width;
            for (to, from) in to.iter_mut().zip(&rows[row..row + width]) {
                *to += weight * from;
            }
        }
    });
    filtered
}

fn tap(at: usize, index: usize, kernel: &[f32], end: usize) -> usize {
    (at + index).saturating_sub(kernel.len() / 2).min(end - 1)
}

/// HyAB distance (Abasi et al., "Distance metrics for very large color differences", 2020), raised
/// to [`COLOR_EXPONENT`].
fn color_distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    let lightness = (a[0] - b[0]).abs();
    let chroma = (a[1] - b[1]).hypot(a[2] - b[2]);
    (lightness + chroma).powf(COLOR_EXPONENT)
}

fn redistribute(distance: f32, greatest: f32) -> f32 {
    let small = SMALL_DIFFERENCES * greatest;
    if distance < small {
        return distance / small * SMALL_DIFFERENCES_TO;
    }
    let rest = (distance - small) / (greatest - small);
    SMALL_DIFFERENCES_TO + rest * (1.0 - SMALL_DIFFERENCES_TO)
}

/// CIE XYZ of linear Rec. 709, relative to the white point.
fn xyz([r, g, b]: [f32; 3]) -> [f32; 3] {
    let row = |[x, y, z]: [f32; 3]| (x * r + y * g + z * b) / (x + y + z);
    XYZ_FROM_RGB.map(row)
}

/// YCxCz, a linearised CIELAB, in which the contrast sensitivity filters are applied.
fn ycxcz(rgb: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = xyz(rgb);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn rgb_of_ycxcz([luma, red_green, blue_yellow]: [f32; 3]) -> [f32; 3] {
    let y = (luma + 16.0) / 116.0;
    let (x, z) = (y + red_green / 500.0, y - blue_yellow / 200.0);
    let white = XYZ_FROM_RGB.map(|row| row.iter().sum::<f32>());
    let [x, y, z] = [x * white[0], y * white[1], z * white[2]];
    RGB_FROM_XYZ.map(|row| row[0] * x + row[1] * y + row[2] * z)
}

/// CIELAB with chroma reduced in proportion to lightness (Hunt effect).
fn hunt_lab(rgb: [f32; 3]) -> [f32; 3] {
    let compress = |t: f32| {
        const BREAK: f32 = 6.0 / 29.0;
        if t > BREAK.powi(3) {
            t.cbrt()
        } else {
            t / (3.0 * BREAK * BREAK) + 4.0 / 29.0
        }
    };
    let [x, y, z] = xyz(rgb).map(compress);
    let lightness = 116.0 * y - 16.0;
    let hunt = 0.01 * lightness;
    [lightness, hunt * 500.0 * (x - y), hunt * 200.0 * (y - z)]
}

/// Matrices of IEC 61966-2-1, with Lindbloom's digits.
const XYZ_FROM_RGB: [[f32; 3]; 3] = [
    [0.412_390_8, 0.357_584_33, 0.180_480_8],
    [0.212_639, 0.715_168_7, 0.072_192_32],
    [0.019_330_82, 0.119_194_78, 0.950_532_15],
];
const RGB_FROM_XYZ: [[f32; 3]; 3] = [
    [3.240_97, -1.537_383_2, -0.498_610_76],
    [-0.969_243_65, 1.875_967_5, 0.041_555_06],
    [0.055_630_08, -0.203_976_96, 1.056_971_5],
];

#[cfg(all(test, feature = "image-io"))]
mod tests {
    use std::collections::BTreeMap;
    use std::fs::File;
    use std::io::BufReader;

    use super::*;

    const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/references/flip");

    fn picture(name: &str) -> (ImageSize, Vec<[u8; 3]>) {
        let file = BufReader::new(File::open(format!("{FOLDER}/{name}.png")).unwrap());
        let mut decoder = png::Decoder::new(file);
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        assert_eq!(info.color_type, png::ColorType::Rgb);
        let pixels = bytes[..info.buffer_size()].as_chunks().0.to_vec();
        (ImageSize::new(info.width, info.height), pixels)
    }

    #[test]
    fn it_agrees_with_its_authors_evaluator() {
        let expected = std::fs::read_to_string(format!("{FOLDER}/expected.json")).unwrap();
        let expected: BTreeMap<String, BTreeMap<String, f64>> =
            serde_json::from_str(&expected).unwrap();
        assert!(expected.len() >= 4);
        for (name, expected) in expected {
            let (size, test) = picture(&format!("{name}_test"));
            let (_, reference) = picture(&format!("{name}_reference"));
            let flip = flip(size, &test, &reference).unwrap();
            let maximum = flip.map.iter().copied().fold(0.0, f32::max);
            let mean_error = (flip.mean - expected["mean"]).abs();
            let maximum_error = (f64::from(maximum) - expected["maximum"]).abs();
            assert!(mean_error < 1e-4, "{name}: {} for {expected:?}", flip.mean);
            assert!(maximum_error < 1e-3, "{name}: {maximum} for {expected:?}");
        }
    }

    #[test]
    fn flip_is_0_for_equal_and_1_for_black_on_white() {
        let size = ImageSize::new(9, 7);
        let (black, white) = (vec![[0; 3]; 63], vec![[255; 3]; 63]);
        assert_eq!(flip(size, &white, &white).unwrap().mean, 0.0);
        assert!(flip(size, &black, &white).unwrap().mean > 0.95);
        assert!(flip(size, &black[1..], &white).is_err());
        assert!(flip(ImageSize::new(0, 7), &[], &[]).is_err());
    }
}
