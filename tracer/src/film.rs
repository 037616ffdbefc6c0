//! Film: accumulates tiles and ranges of samples into an image.

use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use crate::image::RadianceImage;
use crate::metrics::Estimate;
use crate::{
    CompiledScene, Error, ImageSize, RenderSettings, Tile, TileGrid, TileRadiance, TraceJob, Tracer,
};

/// Sums of samples per pixel, from tiles in any order and with any range of samples.
///
/// Sums are f64, so that the mean of a million frames is as exact as that of one. Pixels that are
/// not finite are dropped here and counted.
///
/// ```
/// use carom_tracer::film::{Film, trace_image};
/// use carom_tracer::{CompiledScene, ImageSize, ScalarTracer, RenderSettings, Scene};
///
/// let pool = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/scenes/pool.json");
/// let scene = CompiledScene::new(&Scene::load(pool)?)?;
/// let size = ImageSize::new(32, 18);
/// let film: Film = trace_image(&ScalarTracer, &scene, size, RenderSettings::default())?;
/// assert_eq!(film.dropped_samples(), 0);
/// let mean = film.image().pixels[9 * 32 + 16];
/// assert!(mean[1] > mean[0], "the cloth is green");
/// # Ok::<(), carom_tracer::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Film {
    size: ImageSize,
    pixels: Vec<Pixel>,
    dropped_samples: u64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Pixel {
    sum: [f64; 3],
    samples: u64,
}

/// Edge length in pixels of the tiles of [`trace_image`].
const TILE_EDGE: u16 = 32;

/// Traces a whole image and waits for it.
///
/// # Errors
/// As for [`Tracer::trace`].
pub fn trace_image(
    tracer: &dyn Tracer,
    scene: &CompiledScene,
    size: ImageSize,
    settings: RenderSettings,
) -> Result<Film, Error> {
    size.validate()?;
    let grid = TileGrid::new(size, TILE_EDGE);
    let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
    trace_tiles(tracer, scene, size, settings, &tiles)
}

/// Traces parts of an image and waits for them; the rest of the film stays black.
///
/// # Errors
/// As for [`Tracer::trace`].
pub fn trace_tiles(
    tracer: &dyn Tracer,
    scene: &CompiledScene,
    size: ImageSize,
    settings: RenderSettings,
    tiles: &[Tile],
) -> Result<Film, Error> {
    let job = TraceJob {
        size,
        tiles,
        settings,
        cancelled: &AtomicBool::new(false),
    };
    job.validate()?;
    let film = Mutex::new(Film::new(size));
    tracer.trace(scene, &job, &|done: TileRadiance| {
        let mut film = film
            .lock()
            .expect("a sink that panicked has ended the call");
        film.add(tiles[done.index], &done.radiance, settings.samples)
            .expect("the job's tiles lie in its image");
        film.count_dropped(done.dropped_samples);
    })?;
    Ok(film
        .into_inner()
        .expect("a sink that panicked has ended the call"))
}

/// Traces `tiles` as `batches` independent images of `settings.samples` samples each, and estimates
/// the standard error of their mean from their variance. Batches have consecutive seeds, beginning
/// with that of `settings`: samples of the same seed are stratified and so not independent.
///
/// # Errors
/// As for [`Tracer::trace`]; [`Error::InvalidSettings`] if there are fewer than two batches.
pub fn trace_estimate(
    tracer: &dyn Tracer,
    scene: &CompiledScene,
    size: ImageSize,
    settings: RenderSettings,
    tiles: &[Tile],
    batches: u32,
) -> Result<Estimate, Error> {
    let trace_batch = |batch: u32| {
        let settings = RenderSettings {
            seed: settings.seed.wrapping_add(batch),
            ..settings
        };
        Ok(trace_tiles(tracer, scene, size, settings, tiles)?.image())
    };
    let pictures = (0..batches)
        .map(trace_batch)
        .collect::<Result<Vec<_>, Error>>()?;
    Estimate::from_batches(&pictures)
}

impl Film {
    /// A film without samples.
    pub fn new(size: ImageSize) -> Self {
        Self {
            size,
            pixels: vec![Pixel::default(); size.pixels()],
            dropped_samples: 0,
        }
    }

    /// Adds a tile's mean radiance over `samples` samples per pixel, in row-major order. If a pixel
    /// is not finite, all its samples are dropped and counted.
    ///
    /// # Errors
    /// [`Error::InvalidSettings`] if the tile does not lie in the film or `radiance` has another
    /// number of pixels; the film is then unchanged.
    pub fn add(&mut self, tile: Tile, radiance: &[[f32; 3]], samples: u32) -> Result<(), Error> {
        let right = u64::from(tile.x) + u64::from(tile.width);
        let bottom = u64::from(tile.y) + u64::from(tile.height);
        if right > u64::from(self.size.width) || bottom > u64::from(self.size.height) {
            let size = self.size;
            return Err(Error::settings(format!(
                "{tile:?} does not lie in a film of {size} pixels"
            )));
        }
        if radiance.len() != tile.pixels() {
            let pixels = radiance.len();
            return Err(Error::settings(format!(
                "{tile:?} comes with {pixels} pixels"
            )));
        }
        if tile.width == 0 {
            return Ok(());
        }
        for (y, row) in (tile.y..).zip(radiance.chunks_exact(tile.width as usize)) {
            let start = y as usize * self.size.width as usize + tile.x as usize;
            for (pixel, &mean) in self.pixels[start..].iter_mut().zip(row) {
                if mean.iter().all(|channel| channel.is_finite()) {
                    pixel.add(mean, samples);
                } else {
                    self.dropped_samples = self.dropped_samples.saturating_add(u64::from(samples));
                }
            }
        }
        Ok(())
    }

    /// Counts samples that a tracer has dropped, which are black in its means.
    pub fn count_dropped(&mut self, samples: u32) {
        self.dropped_samples = self.dropped_samples.saturating_add(u64::from(samples));
    }

    /// The film as bytes, for [`Film::from_bytes`]: dropped samples, then each pixel's sums and
    /// number of samples, 8 bytes each, little-endian.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(Self::bytes_of(self.size));
        bytes.extend(self.dropped_samples.to_le_bytes());
        for pixel in &self.pixels {
            bytes.extend(pixel.sum.iter().flat_map(|sum| sum.to_le_bytes()));
            bytes.extend(pixel.samples.to_le_bytes());
        }
        bytes
    }

    /// Size in bytes of [`Film::to_bytes`] for a film of `size`.
    pub const fn bytes_of(size: ImageSize) -> usize {
        8 + size.pixels() * PIXEL_BYTES
    }

    /// A film of `size` from the bytes of [`Film::to_bytes`]; `None` if their number does not
    /// match, or if a pixel's sums are impossible: not finite, or not 0 without samples.
    pub fn from_bytes(size: ImageSize, bytes: &[u8]) -> Option<Self> {
        let (words, rest) = bytes.as_chunks::<8>();
        let (&dropped_samples, words) = words.split_first()?;
        if !rest.is_empty() || words.len() != size.pixels() * PIXEL_BYTES / 8 {
            return None;
        }
        let (pixels, _) = words.as_chunks::<4>();
        let pixels = pixels.iter().map(|&[r, g, b, samples]| {
            let pixel = Pixel {
                sum: [r, g, b].map(f64::from_le_bytes),
                samples: u64::from_le_bytes(samples),
            };
            let is_finite = pixel.mean().iter().all(|channel| channel.is_finite());
            let has_samples = pixel.samples > 0 || pixel.sum == [0.0; 3];
            (is_finite && has_samples).then_some(pixel)
        });
        Some(Self {
            size,
            pixels: pixels.collect::<Option<_>>()?,
            dropped_samples: u64::from_le_bytes(dropped_samples),
        })
    }

    /// Removes all samples.
    pub fn clear(&mut self) {
        self.pixels.fill(Pixel::default());
        self.dropped_samples = 0;
    }

    /// Width and height in pixels.
    pub fn size(&self) -> ImageSize {
        self.size
    }

    /// Number of samples dropped because they were not finite, in tracers or here.
    pub fn dropped_samples(&self) -> u64 {
        self.dropped_samples
    }

    /// Smallest number of samples of any pixel: 0 while parts of the image are missing.
    pub fn samples_min(&self) -> u64 {
        let samples = self.pixels.iter().map(|pixel| pixel.samples);
        samples.min().unwrap_or(0)
    }

    /// Largest number of samples of any pixel.
    pub fn samples_max(&self) -> u64 {
        let samples = self.pixels.iter().map(|pixel| pixel.samples);
        samples.max().unwrap_or(0)
    }

    /// Mean radiance; black where there are no samples.
    pub fn image(&self) -> RadianceImage {
        RadianceImage {
            size: self.size,
            pixels: self.pixels.iter().map(Pixel::mean).collect(),
        }
    }
}

/// Bytes per pixel in [`Film::to_bytes`].
const PIXEL_BYTES: usize = 32;

impl Pixel {
    fn add(&mut self, mean: [f32; 3], samples: u32) {
        for (sum, mean) in self.sum.iter_mut().zip(mean) {
            *sum += f64::from(mean) * f64::from(samples);
        }
        self.samples += u64::from(samples);
    }

    fn mean(&self) -> [f32; 3] {
        let samples = self.samples.max(1) as f64;
        self.sum.map(|sum| (sum / samples) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIXEL: Tile = Tile {
        x: 1,
        y: 2,
        width: 1,
        height: 1,
    };

    fn film() -> Film {
        Film::new(ImageSize::new(3, 4))
    }

    #[test]
    fn a_million_frames_do_not_drift() {
        let mut film = film();
        for _ in 0..1_000_000 {
            film.add(PIXEL, &[[0.1, 1e-20, 1e6]], 16).unwrap();
        }
        let mean = film.image().pixels[2 * 3 + 1];
        for (mean, exact) in mean.into_iter().zip([0.1f32, 1e-20, 1e6]) {
            assert!(
                (f64::from(mean) / f64::from(exact) - 1.0).abs() < 1e-7,
                "{mean} {exact}"
            );
        }
    }

    #[test]
    fn ranges_of_samples_weigh_by_their_number() {
        let mut film = film();
        film.add(PIXEL, &[[1.0, 0.0, 4.0]], 1).unwrap();
        film.add(PIXEL, &[[0.0, 4.0, 4.0]], 3).unwrap();
        assert_eq!(film.image().pixels[2 * 3 + 1], [0.25, 3.0, 4.0]);
        assert_eq!(film.samples_min(), 0);
    }

    #[test]
    fn what_is_not_finite_is_dropped_and_counted() {
        let mut film = film();
        film.add(PIXEL, &[[1.0, 2.0, 3.0]], 2).unwrap();
        film.add(PIXEL, &[[f32::NAN, 2.0, 3.0]], 4).unwrap();
        film.add(PIXEL, &[[1.0, f32::INFINITY, 3.0]], 8).unwrap();
        film.count_dropped(1);
        assert_eq!(film.image().pixels[2 * 3 + 1], [1.0, 2.0, 3.0]);
        assert_eq!(film.dropped_samples(), 13);
        film.clear();
        assert_eq!(
            (film.dropped_samples(), film.image().pixels[7]),
            (0, [0.0; 3])
        );
    }

    #[test]
    fn film_round_trips_and_refuses_other_bytes() {
        let mut film = film();
        film.add(PIXEL, &[[0.1, 1e30, 3.0]], 7).unwrap();
        film.count_dropped(5);
        let bytes = film.to_bytes();
        let back = Film::from_bytes(film.size(), &bytes).unwrap();
        assert_eq!(back.to_bytes(), bytes);
        assert_eq!(back.image(), film.image());
        for size in [ImageSize::new(3, 3), ImageSize::new(4, 4)] {
            assert!(Film::from_bytes(size, &bytes).is_none());
        }
        assert!(Film::from_bytes(film.size(), &bytes[1..]).is_none());
        assert!(Film::from_bytes(film.size(), &[]).is_none());
    }

    #[test]
    fn tiles_that_do_not_fit_are_refused() {
        let mut film = film();
        let outside = Tile {
            x: u32::MAX,
            ..PIXEL
        };
        assert!(film.add(outside, &[[1.0; 3]], 1).is_err());
        assert!(film.add(PIXEL, &[[1.0; 3]; 2], 1).is_err());
        let empty = Tile { width: 0, ..PIXEL };
        film.add(empty, &[], 1).unwrap();
        assert!(film.image().pixels.iter().all(|&pixel| pixel == [0.0; 3]));
    }
}
