//! Input of the filter per pixel: light divided by albedo, its variance, and AOVs.

use super::weights::{ALBEDO_MIN, half_ratio};
use crate::aov::AOV_CHANNELS;
use crate::{Aovs, CompiledScene, Error, ImageSize, RenderSettings, Tile, TraceJob, TraceStats};

/// A traced tile before it is denoised.
pub(crate) struct DenoiseInputTile {
    /// Index into the job's tiles.
    pub(crate) index: usize,
    pub(crate) tile: Tile,
    pub(crate) pixels: DenoiseInput,
    pub(crate) dropped_samples: u32,
}

/// The filter's input for some pixels in row-major order, as one column per channel.
#[derive(Default)]
pub(crate) struct DenoiseInput {
    pub(super) columns: [Vec<f32>; COLUMNS],
}

/// Radiance without the light of [`crate::Aovs::emission`], divided by albedo (demodulated).
pub(super) const LIGHT: usize = 0;
/// Variance of the pixel's mean light, summed over the channels; empty if there is a single sample
/// per pixel.
pub(super) const VARIANCE: usize = 3;
/// First column of the AOVs of the samples' first hits.
pub(super) const ALBEDO: usize = 4;
pub(super) const NORMAL: usize = 7;
pub(super) const INVERSE_DEPTH: usize = 10;
/// Light that is not filtered, from [`crate::Aovs::emission`].
pub(super) const EMISSION: usize = 11;
const COLUMNS: usize = 14;

/// Sums over the samples of some pixels, as columns.
pub(crate) struct SampleSums<'a> {
    /// Number of samples in the sums and in `half`; 1 if means are given instead.
    pub(crate) counts: [u32; 2],
    /// Sum of radiance without emission.
    pub(crate) radiance: [&'a [f32]; 3],
    /// The same of the first half of the samples (rounded down); arbitrary if there is a single
    /// sample.
    pub(crate) half: [&'a [f32]; 3],
    /// Sums of the columns of [`crate::Aovs`].
    pub(crate) hits: [&'a [f32]; AOV_CHANNELS],
}

impl DenoiseInput {
    /// Appends pixels of `samples` samples each. All columns must be equally long.
    #[inline(always)]
    pub(crate) fn extend(&mut self, samples: u32, sums: &SampleSums<'_>) {
        let pixels = sums.radiance[0].len();
        let [share, half_share] = sums.counts.map(|count| 1.0 / count as f32);
        let begin = self.columns[LIGHT].len();
        for (column, hits) in self.columns[ALBEDO..].iter_mut().zip(sums.hits) {
            column.resize(begin + pixels, 0.0);
            for (to, hit) in column[begin..].iter_mut().zip(hits) {
                *to = hit * share;
            }
        }
        let (before, hits) = self.columns.split_at_mut(ALBEDO);
        let variance_of = (samples > 1).then(|| half_ratio(samples));
        if variance_of.is_some() {
            before[VARIANCE].resize(begin + pixels, 0.0);
        }
        for channel in 0..3 {
            let albedo = &hits[channel][begin..];
            let light = sums.radiance[channel];
            before[LIGHT + channel].resize(begin + pixels, 0.0);
            let to = before[LIGHT + channel][begin..].iter_mut();
            for ((to, light), albedo) in to.zip(light).zip(albedo) {
                // Demodulated light varies slowly, so the filter can average it across texture
                // detail, which multiplication by the albedo restores.
                *to = light * share / (albedo + ALBEDO_MIN);
            }
            let Some(ratio) = variance_of else { continue };
            let to = before[VARIANCE][begin..].iter_mut();
            let halves = light.iter().zip(sums.half[channel]);
            for ((to, (light, half)), albedo) in to.zip(halves).zip(albedo) {
                // Both halves estimate the same light, so their difference is pure noise.
                let apart = ratio * (half * half_share - light * share) / (albedo + ALBEDO_MIN);
                *to += apart * apart;
            }
        }
    }

    /// The sum over the channels of each pixel's emission.
    pub(super) fn brightness(&self) -> Vec<f32> {
        let [.., r, g, b] = &self.columns;
        r.iter()
            .zip(g)
            .zip(b)
            .map(|((r, g), b)| r + g + b)
            .collect()
    }

    /// The light that is not filtered; `None` if it is all black.
    pub(super) fn into_emission(self) -> Option<[Vec<f32>; 3]> {
        let [.., r, g, b] = self.columns;
        let emission = [r, g, b];
        let is_black = emission
            .iter()
            .all(|column| column.iter().all(|&c| c == 0.0));
        (!is_black).then_some(emission)
    }

    /// Appends the pixels of `more`.
    pub(crate) fn append(&mut self, more: Self) {
        for (column, mut more) in self.columns.iter_mut().zip(more.columns) {
            column.append(&mut more);
        }
    }
}

/// A tracer that provides the filter's input.
pub(crate) trait DenoiseSource {
    /// As [`crate::Tracer::trace`], but hands over noisy tiles with their guides.
    fn trace_denoise_input(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(DenoiseInputTile) + Sync),
    ) -> Result<TraceStats, Error>;

    /// First hits of the camera rays of single pixels, given as columns and rows of the job's
    /// image: means over the samples of `settings`.
    fn trace_hits(
        &self,
        scene: &CompiledScene,
        size: ImageSize,
        settings: RenderSettings,
        pixels: &[(u32, u32)],
    ) -> Vec<Aovs>;
}
