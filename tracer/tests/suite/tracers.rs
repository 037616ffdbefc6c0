//! Every tracer of the crate: each law is tested on each of them.

use std::sync::LazyLock;

use carom_tracer::gpu::{AdapterChoice, GpuTracer, adapters};
use carom_tracer::{CpuTracer, ScalarTracer, Tracer};

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
