//! One thread's work: a rectangle of pixels, batch by batch through the stream, into sums.

use std::sync::atomic::{AtomicBool, Ordering};

use fearless_simd::prelude::*;

use super::prepared::Prepared;
use super::stream::Stream;
use crate::aov::AOV_CHANNELS;
use crate::denoise::{DenoiseInput, SampleSums};
use crate::sampling::{pixel_key, sample_key};
use crate::{RenderSettings, Tile};

/// Paths in a batch: enough to fill the packets of deeper vertices, few enough for the cache. Half
/// as many are as fast.
const BATCH: usize = 2048;

/// What a thread needs to trace, taken once and kept from tile to tile.
pub(super) struct Scratch {
    stream: Stream,
    /// Place on the film and key of each pixel.
    films: Vec<u32>,
    keys: Vec<u32>,
    /// Per channel and pixel: a sum and what rounding has taken from it (Kahan, "Pracniques:
    /// Further Remarks on Reducing Truncation Errors", CACM 8(1), 1965).
    sums: [Vec<(f32, f32)>; 3],
    /// Of denoised pictures: sums of the first half of the samples, and of all first hits.
    half: [Vec<f32>; 3],
    aovs: [Vec<f32>; AOV_CHANNELS],
}

/// A traced rectangle.
#[derive(Default)]
pub(super) struct Traced {
    /// Of pictures that are not denoised.
    pub(super) radiance: Vec<[f32; 3]>,
    /// Of pictures that are.
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

    /// Traces `area`, or returns `None` as soon as `cancelled` is seen to be true. A pixel's
    /// samples are summed in their order, whatever the area and the batches.
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
            // A small area takes several samples into a batch, so that packets stay full where few paths
            // are left.
            let samples_at_once = (BATCH / pixels) as u32;
            for done in (0..settings.samples).step_by(samples_at_once as usize) {
                let samples = samples_at_once.min(settings.samples - done);
                self.fill(settings.first_sample.wrapping_add(done), samples);
                traced.rays += scene.trace(simd, &mut self.stream, cancelled);
                if cancelled.load(Ordering::Relaxed) {
                    return None;
                }
                // None once the half lies in an earlier batch. One at the end of a batch is sample 0 of
                // the next.
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
        // Of these nothing is read before it is written.
        for sums in self.half.iter_mut().chain(&mut self.aovs) {
            sums.resize(pixels, 0.0);
        }
    }

    /// A path per sample and pixel, samples in the outer loop.
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
            // Samples in the outer loop: neighbouring lanes are neighbouring pixels, whose rays are
            // alike.
            numbers.fill(sample_key(first_sample.wrapping_add(sample)));
        }
        for (slot, place) in stream.slot[..stream.len].iter_mut().zip(0..) {
            *slot = place;
        }
    }

    /// Adds the batch to the sums; returns how many samples were not finite and count as black.
    /// Before sample `half` of the batch the sums are those of the first half.
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
                    // At 65,536 samples a plain f32 sum has lost a relative 2⁻⁸ in the worst case; this
                    // keeps it exact to rounding.
                    let corrected = value - *lost;
                    let next = *sum + corrected;
                    *lost = (next - *sum) - corrected;
                    *sum = next;
                }
            }
        }
        dropped
    }

    /// Keeps the sums as those of the first half.
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

    /// Appends the means of all samples with what the filter needs.
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

    /// Appends the means of all samples.
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
        // `&` keeps the loop free of branches, so that it is compiled to vectors. All channels go black
        // together: a sample without its red would tint the pixel.
        let finite = r.is_finite() & g.is_finite() & b.is_finite();
        dropped += u32::from(!finite);
        if !finite {
            [*r, *g, *b] = [0.0; 3];
        }
    }
    dropped
}
