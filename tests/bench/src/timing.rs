//! Measurement of CPU time, as wall-clock time says little on a machine that others use too.

use std::sync::atomic::AtomicBool;

use carom_tracer::{
    CompiledScene, Error, ImageSize, RenderSettings, Tile, TileGrid, TraceJob, Tracer,
};
use cpu_time::{ProcessTime, ThreadTime};

/// Minimum CPU time in ms of `runs` calls.
pub(crate) fn best_ms(runs: u32, mut call: impl FnMut()) -> f64 {
    (0..runs)
        .map(|_| {
            let begun = ThreadTime::now();
            call();
            ms_since(begun)
        })
        .fold(f64::INFINITY, f64::min)
}

/// CPU time of this thread in ms since `begun`.
pub(crate) fn ms_since(begun: ThreadTime) -> f64 {
    begun.elapsed().as_secs_f64() * 1e3
}

/// Median; NaN of no values.
pub(crate) fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let [middle] = quantiles(values, [0.5]);
    middle
}

/// Quantiles at these shares, from 0 for the minimum to 1 for the maximum; between two values, the
/// larger. NaN of no values.
pub(crate) fn quantiles<const N: usize>(
    values: impl IntoIterator<Item = f64>,
    shares: [f64; N],
) -> [f64; N] {
    let mut values: Vec<_> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    let last = values.len().saturating_sub(1) as f64;
    let value = |share: f64| values.get((last * share).ceil() as usize).copied();
    shares.map(|share| value(share).unwrap_or(f64::NAN))
}

/// Time of a whole picture in ms: the device's own where it reports that, otherwise CPU time.
///
/// # Errors
/// The tracer's.
pub(crate) fn milliseconds(
    tracer: &dyn Tracer,
    scene: &CompiledScene,
    size: ImageSize,
    samples: u32,
) -> Result<f64, Error> {
    let grid = TileGrid::new(size, TILE_EDGE);
    let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
    let job = TraceJob {
        size,
        tiles: &tiles,
        settings: RenderSettings {
            samples,
            ..RenderSettings::default()
        },
        cancelled: &AtomicBool::new(false),
    };
    let begun = ProcessTime::now();
    let stats = tracer.trace(scene, &job, &|_| {})?;
    Ok(match stats.device_nanos {
        0 => begun.elapsed().as_secs_f64() * 1e3,
        nanos => nanos as f64 * 1e-6,
    })
}

/// Edge of a tile, as in the farm.
const TILE_EDGE: u16 = 32;
