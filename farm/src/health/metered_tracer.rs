//! Tracer that counts the work of its device.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use carom_tracer::{
    CompiledScene, DeviceInfo, Error, RenderSettings, TileAovs, TileRadiance, TileSrgb8, TraceJob,
    TraceStats, Tracer,
};

use super::NodeCounters;

/// Wrapper of a tracer that counts its work.
pub struct MeteredTracer {
    tracer: Arc<dyn Tracer>,
    counters: Arc<NodeCounters>,
}

/// Guard of a device call, which ends when it is dropped, also by a panic.
struct DeviceCall<'a>(&'a NodeCounters);

impl<'a> DeviceCall<'a> {
    fn begin(counters: &'a NodeCounters) -> Self {
        counters.device_begins();
        Self(counters)
    }
}

impl Drop for DeviceCall<'_> {
    fn drop(&mut self) {
        self.0.device_ends();
    }
}

impl MeteredTracer {
    /// Counts the work of `tracer` from now on.
    pub const fn new(tracer: Arc<dyn Tracer>, counters: Arc<NodeCounters>) -> Self {
        Self { tracer, counters }
    }

    /// Counts a tile of a job.
    fn count(&self, job: &TraceJob<'_>, pixels: usize, dropped_samples: u32) {
        let samples = pixels as u64 * u64::from(job.settings.samples);
        let counters = &self.counters;
        counters.tiles.fetch_add(1, Ordering::Relaxed);
        counters.samples.fetch_add(samples, Ordering::Relaxed);
        counters
            .dropped_samples
            .fetch_add(u64::from(dropped_samples), Ordering::Relaxed);
    }
}

impl Tracer for MeteredTracer {
    fn info(&self) -> DeviceInfo {
        self.tracer.info()
    }

    fn is_ready(&self, scene: &CompiledScene, settings: &RenderSettings) -> bool {
        self.tracer.is_ready(scene, settings)
    }

    fn trace(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error> {
        let _call = DeviceCall::begin(&self.counters);
        let counted = |tile: TileRadiance| {
            self.count(job, tile.radiance.len(), tile.dropped_samples);
            sink(tile);
        };
        self.tracer.trace(scene, job, &counted)
    }

    fn trace_srgb8(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        exposure: f32,
        sink: &(dyn Fn(TileSrgb8) + Sync),
    ) -> Result<TraceStats, Error> {
        let _call = DeviceCall::begin(&self.counters);
        let counted = |tile: TileSrgb8| {
            self.count(job, tile.pixels.len(), tile.dropped_samples);
            sink(tile);
        };
        self.tracer.trace_srgb8(scene, job, exposure, &counted)
    }

    fn aovs(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileAovs) + Sync),
    ) -> Result<(), Error> {
        let _call = DeviceCall::begin(&self.counters);
        self.tracer.aovs(scene, job, sink)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;
    use std::time::Duration;

    use carom_tracer::{ImageSize, RenderSettings, ScalarTracer, Scene, Tile};

    use super::*;

    #[test]
    fn tiles_samples_and_busy_time_are_counted() {
        let scene = Scene::from_json(include_str!("../../../assets/scenes/pool.json")).unwrap();
        let scene = CompiledScene::new(&scene).unwrap();
        let counters = Arc::new(NodeCounters::default());
        let tracer = MeteredTracer::new(Arc::new(ScalarTracer), Arc::clone(&counters));
        let tile = |x| Tile {
            x,
            y: 0,
            width: 4,
            height: 2,
        };
        let job = TraceJob {
            size: ImageSize::new(8, 2),
            tiles: &[tile(0), tile(4)],
            settings: RenderSettings {
                samples: 3,
                ..RenderSettings::default()
            },
            cancelled: &AtomicBool::new(false),
        };
        tracer.trace(&scene, &job, &|_| ()).unwrap();
        let figures = counters.figures();
        assert_eq!((figures.tiles, figures.samples), (2, 48));
        assert!(figures.busy > Duration::ZERO);
    }
}
