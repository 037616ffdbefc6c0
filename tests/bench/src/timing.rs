//! CPU time: on a machine that others use too, wall time says little.

use std::sync::atomic::AtomicBool;

use carom_tracer::{
    CompiledScene, Error, ImageSize, RenderSettings, Tile, TileGrid, TraceJob, Tracer,
};
use cpu_time::{ProcessTime, ThreadTime};

/// The least CPU time in ms of `runs` calls.
pub(crate) fn best_ms(runs: u32, mut call: impl FnMut()) -> f64 {
    (0..runs)
        .map(|_| {
            let begun = ThreadTime::now();
            call();
            ms_since(begun)
        })
        .fold(f64::INFINITY, f64::min)
}

/// CPU time in ms since then.
pub(crate) fn ms_since(begun: ThreadTime) -> f64 {
    begun.elapsed().as_secs_f64() * 1e3
}

/// The middle value; NaN of none.
pub(crate) fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let [middle] = quantiles(values, [0.5]);
    middle
}

/// The values at these shares of the way from the least, 0, to the largest, 1; between two, the larger. NaN of none.
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

/// Milliseconds of a whole picture: the device's own where it tells them, else CPU time.
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

/// The farm's own tiles.
const TILE_EDGE: u16 = 32;
