//! Every tracer of the crate: each law is tested on each of them.

use std::sync::LazyLock;

use carom_tracer::film::trace_estimate;
use carom_tracer::gpu::{AdapterChoice, GpuTracer, adapters};
use carom_tracer::metrics::{compare, region};
use carom_tracer::{
    CompiledScene, CpuTracer, ImageSize, RenderSettings, ScalarTracer, Tile, TileGrid, Tracer,
};

static TRACERS: LazyLock<Vec<Box<dyn Tracer>>> = LazyLock::new(|| {
    let mut tracers: Vec<Box<dyn Tracer>> =
        vec![Box::new(ScalarTracer), Box::new(CpuTracer::new().unwrap())];
    tracers.extend(gpu());
    tracers
});

/// One of each back end; those whose device this machine lacks are left out.
pub(crate) fn tracers() -> &'static [Box<dyn Tracer>] {
    &TRACERS
}

/// A GPU, in software if need be. One that is there but fails is an error, not an absence.
fn gpu() -> Option<Box<dyn Tracer>> {
    if adapters().is_empty() {
        eprintln!("Vulkan offers no device: the GPU tracer is not tested");
        return None;
    }
    Some(Box::new(GpuTracer::new(&AdapterChoice::Any).unwrap()))
}

/// Checks that all tracers agree with the scalar one in the means of the picture and of its regions of 8 × 8 pixels, within
/// 4 standard errors over so many batches of samples.
pub(crate) fn assert_agreement_in_the_mean(
    scene: &CompiledScene,
    size: ImageSize,
    settings: RenderSettings,
    batches: u32,
) {
    let grid = TileGrid::new(size, 8);
    let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
    let estimate = |tracer: &dyn Tracer| {
        trace_estimate(tracer, scene, size, settings, &tiles, batches).unwrap()
    };
    let scalar = estimate(&ScalarTracer);
    for tracer in tracers().iter().skip(1) {
        let picture = estimate(tracer.as_ref());
        let whole = TileGrid::new(size, u16::MAX).tile(0);
        let whole = region(&picture, &scalar, whole).unwrap();
        let (of_regions, _) = compare(&picture, &scalar, 8)
            .unwrap()
            .worst_region()
            .unwrap();
        let z = whole.z.into_iter().map(f64::abs).fold(of_regions, f64::max);
        let name = tracer.info().name;
        assert!(z < 4.0, "{name}: {z} standard errors");
    }
}
