//! First hits, and what else the filter needs, as more outputs of the kernel.
//!
//! A dispatch each: camera rays are a small part of a path's, and the film and its read-back stay as
//! they are.

use std::sync::{Mutex, PoisonError};

use super::GpuTracer;
use super::features::Output;
use crate::layers::smooth;
use crate::post::{NoisyTile, NoisyTracer};
use crate::{CompiledScene, Error, Layers, RenderSettings, TraceJob, TraceStats};

/// Pixels and dropped samples by tile; no pixels of tiles that were cancelled.
struct Picture {
    tiles: Vec<(Vec<[f32; 3]>, u32)>,
    stats: TraceStats,
}

impl GpuTracer {
    fn picture(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        output: Output,
    ) -> Result<Picture, Error> {
        let tiles = Mutex::new(vec![(Vec::new(), 0); job.tiles.len()]);
        let stats = self.trace_output(scene, job, output, &|done| {
            let mut tiles = tiles.lock().unwrap_or_else(PoisonError::into_inner);
            tiles[done.index] = (done.radiance, done.dropped_samples);
        })?;
        let tiles = tiles.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(Picture { tiles, stats })
    }

    /// First hits by tile.
    pub(super) fn find_layers(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
    ) -> Result<Vec<Vec<Layers>>, Error> {
        let mut hits: Vec<Vec<Layers>> = vec![Vec::new(); job.tiles.len()];
        for output in [
            Output::Albedo,
            Output::Normal,
            Output::InverseDepth,
            Output::Emission,
        ] {
            let picture = self.picture(scene, job, output)?;
            for (hits, (pixels, _)) in hits.iter_mut().zip(picture.tiles) {
                hits.resize(pixels.len(), Layers::default());
                for (hit, pixel) in hits.iter_mut().zip(pixels) {
                    match output {
                        Output::Albedo => hit.albedo = pixel,
                        Output::Normal => hit.normal = pixel,
                        Output::InverseDepth => hit.inverse_depth = pixel[0],
                        _ => hit.emission = pixel,
                    }
                }
            }
        }
        Ok(hits)
    }

    /// A range of the job's samples, from the `begin`-th to before the `end`-th.
    fn reflected(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        begin: u32,
        end: u32,
    ) -> Result<Picture, Error> {
        let settings = RenderSettings {
            first_sample: job.settings.first_sample.wrapping_add(begin),
            samples: end - begin,
            ..job.settings
        };
        self.picture(scene, &TraceJob { settings, ..*job }, Output::Reflected)
    }
}

impl NoisyTracer for GpuTracer {
    fn trace_noisy(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(NoisyTile) + Sync),
    ) -> Result<TraceStats, Error> {
        let samples = job.settings.samples;
        let half = samples / 2;
        let mut pictures = vec![self.reflected(scene, job, half, samples)?];
        if half > 0 {
            pictures.push(self.reflected(scene, job, 0, half)?);
        }
        let mut hits = self.find_layers(scene, job)?;
        let mut smooth_layers = vec![Vec::new(); job.tiles.len()];
        if let Some(settings) = smooth(job.settings) {
            smooth_layers = self.find_layers(scene, &TraceJob { settings, ..*job })?;
        }
        let mut stats = TraceStats::default();
        for picture in &pictures {
            stats.samples += picture.stats.samples;
            stats.rays += picture.stats.rays;
            stats.device_nanos += picture.stats.device_nanos;
        }
        let share = half as f32 / samples as f32;
        for (index, &tile) in job.tiles.iter().enumerate() {
            let mut halves = pictures.iter_mut();
            let mut take = || {
                let picture = halves.next();
                picture.map_or_else(Default::default, |p| std::mem::take(&mut p.tiles[index]))
            };
            let ((mut radiance, dropped), (half, dropped_half)) = (take(), take());
            if radiance.len() != tile.pixels() {
                continue; // cancelled
            }
            for (mean, half) in radiance.iter_mut().flatten().zip(half.iter().flatten()) {
                *mean += share * (half - *mean);
            }
            sink(NoisyTile {
                index,
                tile,
                radiance,
                half,
                hits: std::mem::take(&mut hits[index]),
                smooth_layers: std::mem::take(&mut smooth_layers[index]),
                dropped_samples: dropped + dropped_half,
            });
        }
        Ok(stats)
    }
}
