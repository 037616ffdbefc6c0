//! Denoised frames: traces tiles with their guard band, filters them, and hands them over.

use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::edge_supersampling::SupersampledEdges;
use super::filter::{Filter, FilterMemory};
use super::guard_band::{GuardedRegion, REGION_SAMPLES, RegionLimits, leading};
use super::input::DenoiseSource;
use crate::simd::Level;
use crate::{CompiledScene, Error, TileRadiance, TraceJob, TraceStats};

/// Traces the job's tiles and their guard band, and hands over the denoised tiles.
pub(crate) fn trace_denoised(
    tracer: &(impl DenoiseSource + ?Sized),
    level: Level,
    memory: &FilterMemory,
    scene: &CompiledScene,
    job: &TraceJob<'_>,
    sink: &(dyn Fn(TileRadiance) + Sync),
) -> Result<TraceStats, Error> {
    let limits = RegionLimits {
        samples: REGION_SAMPLES,
        pixels: u64::MAX,
    };
    in_parts(job, limits, |first, part| {
        trace_together(tracer, level, memory, scene, part, &|tile| {
            let index = first + tile.index;
            sink(TileRadiance { index, ..tile });
        })
    })
}

/// Calls `trace` with parts of the job, each with as many tiles as may be filtered together, and
/// the index of its first tile.
pub(crate) fn in_parts(
    job: &TraceJob<'_>,
    limits: RegionLimits,
    trace: impl Fn(usize, &TraceJob<'_>) -> Result<TraceStats, Error>,
) -> Result<TraceStats, Error> {
    let mut stats = TraceStats::default();
    let mut first = 0;
    while first < job.tiles.len() {
        let count = leading(&job.tiles[first..], job.settings.samples, limits);
        let part = TraceJob {
            tiles: &job.tiles[first..first + count],
            ..*job
        };
        stats += trace(first, &part)?;
        first += count;
    }
    Ok(stats)
}

fn trace_together(
    tracer: &(impl DenoiseSource + ?Sized),
    level: Level,
    memory: &FilterMemory,
    scene: &CompiledScene,
    job: &TraceJob<'_>,
    sink: &(dyn Fn(TileRadiance) + Sync),
) -> Result<TraceStats, Error> {
    let region = GuardedRegion::around(job.tiles, job.size);
    let wider = TraceJob {
        tiles: &region.tiles,
        ..*job
    };
    let mut filter = Filter::new(&region, job.settings.samples, memory);
    let writer = filter.writer();
    let traced = Mutex::new(Vec::with_capacity(region.tiles.len()));
    let stats = tracer.trace_denoise_input(scene, &wider, &|tile| {
        writer.put(&tile);
        let is_wanted = tile.index < job.tiles.len();
        let emission = is_wanted.then(|| tile.pixels.into_emission()).flatten();
        lock(&traced).push((tile.index, tile.dropped_samples, emission));
    })?;
    drop(writer);
    let traced = std::mem::take(&mut *lock(&traced));
    // A pixel depends on all pixels within the filter's reach: tiles next to a missing one would be
    // wrong, so none is handed over.
    if traced.len() < region.tiles.len() || job.cancelled.load(Ordering::Relaxed) {
        return Ok(stats);
    }
    filter.run(level);
    let edges = SupersampledEdges::find(tracer, level, scene, job, &filter);
    let wanted = traced
        .par_iter()
        .filter(|(index, ..)| *index < job.tiles.len());
    wanted.for_each(|(index, dropped_samples, emission)| {
        let tile = job.tiles[*index];
        let mut radiance = filter.radiance(tile);
        for (c, emission) in emission.iter().flatten().enumerate() {
            for (pixel, emission) in radiance.iter_mut().zip(emission) {
                pixel[c] += emission;
            }
        }
        for (place, hit) in edges.of_tile(*index) {
            let at = ((place.1 - tile.y) * tile.width + place.0 - tile.x) as usize;
            let mixed = filter.mixed(*place, hit, edges.share);
            // The emission of all camera rays is a mixture by `share` as well.
            radiance[at] = std::array::from_fn(|c| {
                let own = emission.as_ref().map_or(0.0, |emission| emission[c][at]);
                mixed[c] + edges.share.mul_add(hit.emission[c] - own, own)
            });
        }
        sink(TileRadiance {
            index: *index,
            radiance,
            dropped_samples: *dropped_samples,
        });
    });
    filter.give_back(memory);
    Ok(stats)
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    // A panic elsewhere cannot leave the list in an inconsistent state.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
