//! Compiled environment map: radiance by direction, and a sampling density.
//!
//! The map is an equirectangular image: its centre shows +y, its right half +x, its upper edge +z. Radiance
//! is interpolated bilinearly between pixel centres. A pixel is drawn in proportion to the mean luminance
//! over its area times the sine of its colatitude: a row by the marginal distribution, a pixel of the row
//! by the conditional one (Pharr, Jakob and Humphreys, "Physically Based Rendering", 3rd edition, section
//! 14.2.4), and a point in it uniformly, so that nearby random numbers give nearby directions.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::Error;
use crate::scene::EnvironmentMap;
use crate::scene::validate::map_fault;
#[cfg(feature = "image-io")]
use crate::{ImageSize, RadianceImage};

/// Environment map of a scene, shared between copies; its size is 0 if there is none.
#[derive(Clone, Debug, Default)]
pub struct CompiledEnvironment {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Rotation about +z in turns, added to the image's horizontal coordinate, in [0, 1).
    pub turn: f32,
    /// Probability with which light sampling chooses the environment rather than another kind of light.
    pub probability: f32,
    /// Marginal CDF of the rows (`height + 1` numbers); conditional CDF of the pixels of each row
    /// (`width + 1` numbers each); red, green and blue of each pixel, W·sr⁻¹·m⁻².
    pub numbers: Arc<Vec<f32>>,
}

/// A sampled point of the environment map.
#[derive(Clone, Copy, Debug)]
pub struct EnvironmentSample {
    /// Horizontal and vertical coordinate in the image, in [0, 1).
    pub uv: [f32; 2],
    /// Its density in the unit square.
    pub density: f32,
}

impl CompiledEnvironment {
    /// Compiles `map`, whose radiance is multiplied by `scale`.
    ///
    /// # Errors
    /// [`Error::InvalidScene`] if the map's file is broken.
    pub(super) fn new(
        map: Option<&EnvironmentMap>,
        scale: Vec3,
        has_area_lights: bool,
    ) -> Result<Self, Error> {
        let Some(map) = map else {
            return Ok(Self::default());
        };
        let compiled = compile(map, scale, has_area_lights);
        compiled.map_err(|why| Error::InvalidScene(map_fault(why)))
    }

    /// Whether there is no map.
    pub fn is_empty(&self) -> bool {
        self.width == 0
    }

    /// Sine of the colatitude of a direction, and its coordinates in the image.
    pub fn uv(&self, direction: DVec3) -> (f64, [f32; 2]) {
        let sine = direction.x.hypot(direction.y);
        let across = 0.5 + direction.x.atan2(direction.y) / (2.0 * PI) + f64::from(self.turn);
        let down = sine.atan2(direction.z) / PI;
        (sine, [(across - across.floor()) as f32, down as f32])
    }

    /// Unit direction of image coordinates, and the sine of its colatitude.
    pub fn direction(&self, [across, down]: [f32; 2]) -> (DVec3, f64) {
        let azimuth = 2.0 * PI * (f64::from(across) - f64::from(self.turn) - 0.5);
        let (sine, cosine) = (PI * f64::from(down)).sin_cos();
        let direction = DVec3::new(sine * azimuth.sin(), sine * azimuth.cos(), cosine);
        (direction, sine)
    }

    /// Radiance at image coordinates, W·sr⁻¹·m⁻².
    pub fn radiance(&self, [across, down]: [f32; 2]) -> [f32; 3] {
        let x = across * self.width as f32 - 0.5;
        let y = (down * self.height as f32 - 0.5).clamp(0.0, (self.height - 1) as f32);
        let (left, top) = (x.floor(), y.floor());
        let (share_x, share_y) = (x - left, y - top);
        let last = self.width - 1;
        // Wraps around horizontally; clamped at the poles.
        let left = if left < 0.0 {
            last
        } else {
            (left as u32).min(last)
        };
        let right = if left == last { 0 } else { left + 1 };
        let top = top as u32;
        let bottom = (top + 1).min(self.height - 1);
        let row = |y: u32| {
            let (a, b) = (self.pixel(left, y), self.pixel(right, y));
            std::array::from_fn(|i| a[i] + share_x * (b[i] - a[i]))
        };
        let (top, bottom): ([f32; 3], [f32; 3]) = (row(top), row(bottom));
        std::array::from_fn(|i| top[i] + share_y * (bottom[i] - top[i]))
    }

    /// Draws image coordinates by importance.
    pub fn sample(&self, [u, v]: [f32; 2]) -> EnvironmentSample {
        let (y, row_share, down) = draw(&self.numbers[..=self.height as usize], v);
        let (x, share, across) = draw(self.conditional(y), u);
        EnvironmentSample {
            uv: [
                (x as f32 + across) / self.width as f32,
                (y as f32 + down) / self.height as f32,
            ],
            density: row_share * share * (self.width as f32 * self.height as f32),
        }
    }

    /// Density with which [`CompiledEnvironment::sample`] draws image coordinates.
    pub fn density(&self, [across, down]: [f32; 2]) -> f32 {
        let place = |at: f32, count: u32| ((at * count as f32) as u32).min(count - 1) as usize;
        let (x, y) = (place(across, self.width), place(down, self.height));
        let row = self.numbers[y + 1] - self.numbers[y];
        let sums = self.conditional(y);
        row * (sums[x + 1] - sums[x]) * (self.width as f32 * self.height as f32)
    }

    /// Conditional CDF of row `y`.
    fn conditional(&self, y: usize) -> &[f32] {
        let first = self.height as usize + 1 + y * (self.width as usize + 1);
        &self.numbers[first..=first + self.width as usize]
    }

    fn pixel(&self, x: u32, y: u32) -> [f32; 3] {
        let (width, height) = (self.width as usize, self.height as usize);
        let first = height + 1 + height * (width + 1) + 3 * (y as usize * width + x as usize);
        [0, 1, 2].map(|channel| self.numbers[first + channel])
    }
}

/// Inverts a CDF: the interval in which `u` lies, its length, and the position in it.
fn draw(sums: &[f32], u: f32) -> (usize, f32, f32) {
    // The last interval that begins at or below `u`: so intervals of length 0 are skipped, as the next one
    // begins at or below `u` as well.
    let first = sums[1..sums.len() - 1].partition_point(|sum| *sum <= u);
    let share = sums[first + 1] - sums[first];
    let within = if share > 0.0 {
        (u - sums[first]) / share
    } else {
        0.5
    };
    (first, share, within.min(BELOW_1))
}

/// Largest f32 below 1.
const BELOW_1: f32 = 1.0 - 0.5 * f32::EPSILON;

#[cfg(not(feature = "image-io"))]
fn compile(_: &EnvironmentMap, _: Vec3, _: bool) -> Result<CompiledEnvironment, String> {
    Err(
        "this program was built without image files: build it with the feature `image-io`"
            .to_owned(),
    )
}

#[cfg(feature = "image-io")]
fn compile(
    map: &EnvironmentMap,
    scale: Vec3,
    has_area_lights: bool,
) -> Result<CompiledEnvironment, String> {
    let file = map.image.bytes().ok_or("its file has not been read")?;
    let picture = crate::environment_file::decode(file)?;
    let ImageSize { width, height } = picture.size;
    let luminance = |[r, g, b]: [f32; 3]| {
        let scaled = scale * Vec3::new(r, g, b);
        // Luminance of linear Rec. 709 colours.
        f64::from(scaled.dot(Vec3::new(0.2126, 0.7152, 0.0722)))
    };
    let mut rows = Vec::with_capacity(height as usize);
    let mut conditional = Vec::new();
    for y in 0..height {
        // The solid angle of a row's pixels is proportional to the sine of its colatitude.
        let sine = (PI * (f64::from(y) + 0.5) / f64::from(height)).sin();
        let weights = (0..width).map(|x| shown(&picture, x, y, &luminance));
        let weights: Vec<f64> = weights.collect();
        rows.push(sine * weights.iter().sum::<f64>());
        conditional.extend(sums(&weights));
    }
    let probability = match (rows.iter().sum::<f64>() > 0.0, has_area_lights) {
        (false, _) => 0.0,
        (true, true) => 0.5,
        (true, false) => 1.0,
    };
    let mut numbers = sums(&rows);
    numbers.extend(conditional);
    numbers
        .extend((picture.pixels.iter()).flat_map(|pixel| (scale * Vec3::from(*pixel)).to_array()));
    let turn = map.turn_deg / 360.0;
    Ok(CompiledEnvironment {
        width,
        height,
        turn: turn - turn.floor(),
        probability,
        numbers: Arc::new(numbers),
    })
}

/// Mean over a pixel's area of the bilinear interpolation between it and its neighbours.
#[cfg(feature = "image-io")]
fn shown(picture: &RadianceImage, x: u32, y: u32, of: &impl Fn([f32; 3]) -> f64) -> f64 {
    let ImageSize { width, height } = picture.size;
    let columns = [(x + width - 1) % width, x, (x + 1) % width];
    let rows = [y.saturating_sub(1), y, (y + 1).min(height - 1)];
    let mut mean = 0.0;
    // Integrals over the pixel of the tent functions of bilinear interpolation: that of the pixel itself, 1
    // − |x| from −½ to ½, is ¾; those of its neighbours, over half a pixel each, are ⅛.
    for (row, share_y) in rows.into_iter().zip([0.125, 0.75, 0.125]) {
        for (column, share_x) in columns.into_iter().zip([0.125, 0.75, 0.125]) {
            let pixel = picture.pixels[(row * width + column) as usize];
            mean += share_y * share_x * of(pixel);
        }
    }
    mean
}

/// CDF of weights, from 0 to 1; uniform if all are 0.
#[cfg(feature = "image-io")]
fn sums(weights: &[f64]) -> Vec<f32> {
    let total: f64 = weights.iter().sum();
    let mut sum = 0.0;
    let mut sums = vec![0.0];
    sums.extend(weights.iter().map(|weight| {
        sum += match total > 0.0 {
            true => weight / total,
            false => 1.0 / weights.len() as f64,
        };
        sum as f32
    }));
    if let Some(last) = sums.last_mut() {
        // Rounding leaves the sum slightly off 1, and random numbers beyond it could not be used. Densities
        // are computed from the same rounded sums, so that they match the sampling exactly.
        *last = 1.0;
    }
    sums
}

#[cfg(all(test, feature = "image-io"))]
mod tests {
    use super::*;
    use crate::environment_file::encode_exr;
    use crate::sampling::uniforms;

    fn compiled(size: [u32; 2], pixel: impl Fn(u32, u32) -> f32) -> CompiledEnvironment {
        let mut picture = RadianceImage::black(ImageSize::new(size[0], size[1]));
        for (place, radiance) in (0..).zip(&mut picture.pixels) {
            *radiance = [pixel(place % size[0], place / size[0]); 3];
        }
        let map = EnvironmentMap::new(encode_exr(&picture).unwrap()).turned_deg(50.0);
        CompiledEnvironment::new(Some(&map), Vec3::ONE, false).unwrap()
    }

    fn spotted() -> CompiledEnvironment {
        compiled([24, 10], |x, y| match (x, y) {
            (3, 2) => 500.0,
            (17..=19, 5..=6) => 40.0,
            (_, 8..) => 0.0,
            _ => 0.5,
        })
    }

    #[test]
    fn places_are_drawn_with_their_density() {
        let map = spotted();
        let mut drawn = [0u32; 240];
        let draws = 200_000;
        for i in 0..draws {
            let [u, v, ..] = uniforms(i, 1, 2, 3);
            let sample = map.sample([u, v]);
            let again = map.density(sample.uv);
            assert!(
                (again - sample.density).abs() <= 1e-5 * again,
                "{sample:?} {again}"
            );
            let [x, y] = [sample.uv[0] * 24.0, sample.uv[1] * 10.0].map(|at| at as usize);
            drawn[y * 24 + x] += 1;
        }
        for (place, drawn) in drawn.into_iter().enumerate() {
            let uv = [(place % 24) as f32 + 0.5, (place / 24) as f32 + 0.5];
            let density = f64::from(map.density([uv[0] / 24.0, uv[1] / 10.0]));
            let expected = density / 240.0 * f64::from(draws);
            let off = (f64::from(drawn) - expected).abs();
            assert!(
                off < 5.0 * (expected + 1.0).sqrt(),
                "{place}: {drawn} of {expected}"
            );
        }
    }

    #[test]
    fn what_is_bright_is_drawn_and_all_that_shines_can_be() {
        let map = spotted();
        let of = |x: f32, y: f32| map.density([(x + 0.5) / 24.0, (y + 0.5) / 10.0]);
        assert!(of(3.0, 2.0) > 20.0 * of(10.0, 4.0));
        // Interpolation reaches half a pixel beyond the edge of the bright area.
        assert!(of(10.0, 8.0) > 0.0 && of(10.0, 9.0) < 1e-3);
    }

    #[test]
    fn directions_and_places_are_each_others_inverse() {
        let map = spotted();
        for i in 0..1000 {
            let [u, v, ..] = uniforms(i, 5, 6, 7);
            let (direction, sine) = map.direction([u, v]);
            let (again, uv) = map.uv(direction);
            assert!((sine - again).abs() < 1e-7 && (uv[1] - v).abs() < 1e-6);
            let off = (uv[0] - u).abs();
            assert!(off.min(1.0 - off) < 1e-5, "{u} {uv:?}");
        }
    }
}
