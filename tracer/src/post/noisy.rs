//! Tracing what the filter needs, and handing out what it makes of it.

use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::filter::Filter;
use super::region::{Region, leading};
use crate::cpu::Level;
use crate::layers::Layers;
use crate::{CompiledScene, Error, Tile, TileRadiance, TraceJob, TraceStats};

/// A tile before it is denoised.
pub(crate) struct NoisyTile {
    /// Index into the job's tiles.
    pub(crate) index: usize,
    pub(crate) tile: Tile,
    /// Mean radiance per pixel without the light that is in [`Layers::emission`].
    pub(crate) radiance: Vec<[f32; 3]>,
    /// The same of the first half of the samples, rounded down; of a single sample nothing.
    pub(crate) half: Vec<[f32; 3]>,
    /// First hits of the same samples.
    pub(crate) hits: Vec<Layers>,
    /// First hits of [`crate::layers::smooth`] samples, if they are more.
    pub(crate) smooth_layers: Vec<Layers>,
    pub(crate) dropped_samples: u32,
}

impl NoisyTile {
    /// First hits of as many camera rays as there are.
    pub(super) fn smoothest_layers(&self) -> &[Layers] {
        if self.smooth_layers.is_empty() {
            &self.hits
        } else {
            &self.smooth_layers
        }
    }
}

/// A tracer that gives what the filter needs.
pub(crate) trait NoisyTracer {
    /// [`crate::Tracer::trace`] for noisy tiles.
    fn trace_noisy(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(NoisyTile) + Sync),
    ) -> Result<TraceStats, Error>;
}

/// Traces the job's tiles and their guard band, and hands over the denoised tiles.
pub(crate) fn trace_denoised(
    tracer: &(impl NoisyTracer + ?Sized),
    level: Level,
    scene: &CompiledScene,
    job: &TraceJob<'_>,
    sink: &(dyn Fn(TileRadiance) + Sync),
) -> Result<TraceStats, Error> {
    in_parts(job, u64::MAX, sink, |part, sink| {
        trace_together(tracer, level, scene, part, sink)
    })
}

/// Gives `trace` as many of the job's tiles at a time as may be filtered together, in a region of at
/// most `pixels_max` where it has more than one.
pub(crate) fn in_parts(
    job: &TraceJob<'_>,
    pixels_max: u64,
    sink: &(dyn Fn(TileRadiance) + Sync),
    trace: impl Fn(&TraceJob<'_>, &(dyn Fn(TileRadiance) + Sync)) -> Result<TraceStats, Error>,
) -> Result<TraceStats, Error> {
    let mut stats = TraceStats::default();
    let mut first = 0;
    while first < job.tiles.len() {
        let count = leading(&job.tiles[first..], job.settings.samples, pixels_max);
        let part = TraceJob {
            tiles: &job.tiles[first..first + count],
            ..*job
        };
        stats += trace(&part, &|tile| {
            let index = first + tile.index;
            sink(TileRadiance { index, ..tile });
        })?;
        first += count;
    }
    Ok(stats)
}

fn trace_together(
    tracer: &(impl NoisyTracer + ?Sized),
    level: Level,
    scene: &CompiledScene,
    job: &TraceJob<'_>,
    sink: &(dyn Fn(TileRadiance) + Sync),
) -> Result<TraceStats, Error> {
    let region = Region::around(job.tiles, job.size);
    let wider = TraceJob {
        tiles: &region.tiles,
        ..*job
    };
    let noisy = Mutex::new(Vec::with_capacity(region.tiles.len()));
    let stats = tracer.trace_noisy(scene, &wider, &|tile| {
        noisy
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(tile);
    })?;
    let noisy = noisy.into_inner().unwrap_or_else(PoisonError::into_inner);
    if noisy.len() < region.tiles.len() || job.cancelled.load(Ordering::Relaxed) {
        return Ok(stats);
    }
    let filtered = Filter::new(region.bounds, job.settings.samples, &noisy).run(level);
    let wanted = noisy.par_iter().filter(|tile| tile.index < job.tiles.len());
    wanted.for_each(|tile| {
        sink(TileRadiance {
            index: tile.index,
            radiance: filtered.tile(tile),
            dropped_samples: tile.dropped_samples,
        });
    });
    Ok(stats)
}
