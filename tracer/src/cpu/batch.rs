//! Work of one thread: traces a rectangle of pixels in batches of paths and sums their samples.

use std::sync::atomic::{AtomicBool, Ordering};

use fearless_simd::prelude::*;

use super::prepared::Prepared;
use super::stream::Stream;
use crate::aov::AOV_CHANNELS;
use crate::denoise::{DenoiseInput, SampleSums};
use crate::sampling::{pixel_key, sample_key};
use crate::{RenderSettings, Tile};

/// Paths per batch: enough to fill the packets of deeper vertices, few enough for the cache. Half
/// as many are as fast.
const BATCH: usize = 2048;

/// Buffers of a thread, allocated once and reused from tile to tile.
pub(super) struct Scratch {
    stream: Stream,
    /// Film position (row in the upper, column in the lower 16 bits) and random-number key of each pixel.
    films: Vec<u32>,
    keys: Vec<u32>,
    /// Per channel and pixel: a sum and its rounding error, for compensated summation (Kahan, "Pracniques:
    /// Further Remarks on Reducing Truncation Errors", CACM 8(1), 1965).
    sums: [Vec<(f32, f32)>; 3],
    /// For denoised images: sums of the first half of the samples.
    half: [Vec<f32>; 3],
    /// For denoised images: sums of the first-hit AOVs of all samples.
    aovs: [Vec<f32>; AOV_CHANNELS],
}

/// Result of a traced rectangle.
#[derive(Default)]
pub(super) struct Traced {
    /// Mean radiance per pixel; empty if the image is denoised.
    pub(super) radiance: Vec<[f32; 3]>,
    /// Input of the denoiser; empty if the image is not denoised.
    pub(super) denoise_input: DenoiseInput,
    pub(super) dropped_samples: u32,
    pub(super) rays: u64,
}

impl Scratch {
    pub(super) fn new() -> Self {
        Self {
            stream: Stream::new(BATCH),
            films: Vec::with_capacity(BATCH),
            keys: Vec::with_capacity(BATCH),
            sums: std::array::from_fn(|_| Vec::with_capacity(BATCH)),
            half: Default::default(),
            aovs: Default::default(),
        }
    }

    /// Traces `area`; returns `None` as soon as `cancelled` is seen to be true. The samples of a pixel
    /// are summed in order, independently of area and batches.
    #[inline(always)]
    pub(super) fn trace<S: Simd>(
        &mut self,
        simd: S,
        scene: &Prepared,
        settings: RenderSettings,
        area: Tile,
        cancelled: &AtomicBool,
    ) -> Option<Traced> {
        let mut traced = Traced::default();
        for first in (0..area.pixels()).step_by(BATCH) {
            let pixels = BATCH.min(area.pixels() - first);
            self.begin(area, first, pixels);
            // A small area puts several samples into a batch, so that packets stay full at depths where
            // few paths survive.
            let samples_at_once = (BATCH / pixels) as u32;
            for done in (0..settings.samples).step_by(samples_at_once as usize) {
                let samples = samples_at_once.min(settings.samples - done);
                self.fill(settings.first_sample.wrapping_add(done), samples);
                traced.rays += scene.trace(simd, &mut self.stream, cancelled);
                if cancelled.load(Ordering::Relaxed) {
                    return None;
                }
                // Place of the first sample of the second half within the batch; none if it lies in an
                // earlier batch. A half that ends with a batch is handled as sample 0 of the next.
                let half = (settings.samples / 2).checked_sub(done);
                let half = half.filter(|_| settings.denoise && settings.samples > 1);
                traced.dropped_samples += self.accumulate(samples as usize, half);
                if scene.records_aovs() {
                    self.accumulate_aovs(samples as usize, done == 0);
                }
            }
            if settings.denoise {
                self.resolve_denoise_input(simd, scene, &mut traced.denoise_input);
            } else {
                self.resolve(settings.samples, &mut traced.radiance);
            }
        }
        Some(traced)
    }

    fn begin(&mut self, area: Tile, first: usize, pixels: usize) {
        self.films.clear();
        self.keys.clear();
        let (first, pixels) = (first as u32, pixels as u32);
        let (mut x, mut y) = (first % area.width, first / area.width);
        for _ in 0..pixels {
            let (column, row) = (area.x + x, area.y + y);
            self.films.push((row << 16) | column);
            self.keys.push(pixel_key(column, row));
            x += 1;
            if x == area.width {
                (x, y) = (0, y + 1);
            }
        }
        let pixels = pixels as usize;
        for sums in &mut self.sums {
            sums.clear();
            sums.resize(pixels, (0.0, 0.0));
        }
        // Overwritten before they are read, so their previous contents need not be cleared.
        for sums in self.half.iter_mut().chain(&mut self.aovs) {
            sums.resize(pixels, 0.0);
        }
    }

    /// Fills the stream with one path per sample and pixel, samples in the outer loop.
    fn fill(&mut self, first_sample: u32, samples: u32) {
        let pixels = self.keys.len();
        let stream = &mut self.stream;
        stream.len = pixels * samples as usize;
        let films = stream.film.chunks_exact_mut(pixels);
        let keys = stream.pixel.chunks_exact_mut(pixels);
        let numbers = stream.sample.chunks_exact_mut(pixels);
        for (sample, ((films, keys), numbers)) in (0..samples).zip(films.zip(keys).zip(numbers)) {
            films.copy_from_slice(&self.films);
            keys.copy_from_slice(&self.keys);
            // With samples in the outer loop adjacent lanes are adjacent pixels, whose rays are coherent.
            numbers.fill(sample_key(first_sample.wrapping_add(sample)));
        }
        for (slot, place) in stream.slot[..stream.len].iter_mut().zip(0..) {
            *slot = place;
        }
    }

    /// Adds the batch to the sums; returns the number of samples that were not finite and count as black.
    /// Before sample `half` of the batch the sums are saved as those of the first half.
    #[inline(always)]
    fn accumulate(&mut self, samples: usize, half: Option<u32>) -> u32 {
        let pixels = self.keys.len();
        let mut dropped = 0;
        for sample in 0..samples {
            if half == Some(sample as u32) {
                self.resolve_half();
            }
            let slots = sample * pixels..(sample + 1) * pixels;
            let [r, g, b] = &mut self.stream.finished.0;
            let channels = [r, g, b].map(|channel| &mut channel[slots.clone()]);
            dropped += blacken_non_finite(channels);
            for (sums, column) in self.sums.iter_mut().zip(&self.stream.finished.0) {
                for ((sum, lost), &value) in sums.iter_mut().zip(&column[slots.clone()]) {
                    // Kahan summation: a plain f32 sum of 65,536 samples may lose a relative 2⁻⁸ in the
                    // worst case, the compensated sum about one rounding.
                    let corrected = value - *lost;
                    let next = *sum + corrected;
                    *lost = (next - *sum) - corrected;
                    *sum = next;
                }
            }
        }
        dropped
    }

    /// Saves the current sums as those of the first half of the samples.
    fn resolve_half(&mut self) {
        for (half, sums) in self.half.iter_mut().zip(&self.sums) {
            half.clear();
            half.extend(sums.iter().map(|&(sum, _)| sum));
        }
    }

    #[inline(always)]
    fn accumulate_aovs(&mut self, samples: usize, is_first: bool) {
        let pixels = self.keys.len();
        for (sums, column) in self.aovs.iter_mut().zip(&self.stream.aovs) {
            for (sample, column) in column.chunks_exact(pixels).take(samples).enumerate() {
                if is_first && sample == 0 {
                    sums.copy_from_slice(column);
                    continue;
                }
                for (sum, &value) in sums.iter_mut().zip(column) {
                    *sum += value;
                }
            }
        }
    }

    /// Appends radiance sums, half sums and AOVs of the batch's pixels to the input of the denoiser.
    #[inline(always)]
    fn resolve_denoise_input<S: Simd>(
        &mut self,
        simd: S,
        scene: &Prepared,
        denoise_input: &mut DenoiseInput,
    ) {
        let samples = scene.settings.samples;
        if !scene.records_aovs() {
            for sums in &mut self.aovs {
                sums.fill(0.0);
            }
            scene.add_first_hits(simd, &self.films, &self.keys, 0..samples, &mut self.aovs);
        }
        let radiance = (self.sums.each_ref())
            .map(|sums| sums.iter().map(|&(sum, _)| sum).collect::<Vec<f32>>());
        denoise_input.extend(
            samples,
            &SampleSums {
                counts: [samples, (samples / 2).max(1)],
                radiance: radiance.each_ref().map(Vec::as_slice),
                half: self.half.each_ref().map(Vec::as_slice),
                hits: self.aovs.each_ref().map(Vec::as_slice),
            },
        );
    }

    /// Appends the mean radiance of each pixel.
    fn resolve(&self, samples: u32, radiance: &mut Vec<[f32; 3]>) {
        let [r, g, b] = &self.sums;
        let mean = |&(sum, _): &(f32, f32)| sum / samples as f32;
        let pixels = r.iter().zip(g).zip(b);
        radiance.extend(pixels.map(|((r, g), b)| [mean(r), mean(g), mean(b)]));
    }
}

fn blacken_non_finite([r, g, b]: [&mut [f32]; 3]) -> u32 {
    let mut dropped = 0;
    for ((r, g), b) in r.iter_mut().zip(g).zip(b) {
        // `&` instead of `&&` keeps the loop branch-free, so that it is vectorised. All channels are set
        // to 0 together: a sample without its red would tint the pixel.
        let finite = r.is_finite() & g.is_finite() & b.is_finite();
        dropped += u32::from(!finite);
        if !finite {
            [*r, *g, *b] = [0.0; 3];
        }
    }
    dropped
}
