//! The tracers of this machine.

use std::sync::Arc;

use carom_tracer::gpu::AdapterChoice;
use carom_tracer::{CpuTracer, Error, GpuTracer, Tracer};

/// The GPU if there is a real one that passes its probe, else the CPU.
///
/// # Errors
/// [`Error::Device`] if there is neither.
pub fn auto() -> Result<Arc<dyn Tracer>, Error> {
    gpu().or_else(|why| {
        tracing::info!("tracing on the CPU: {why}");
        cpu()
    })
}

/// A real GPU that passes its probe.
///
/// # Errors
/// [`Error::Device`] if there is none.
pub fn gpu() -> Result<Arc<dyn Tracer>, Error> {
    Ok(Arc::new(GpuTracer::new(&AdapterChoice::Gpu)?))
}

/// All cores.
///
/// # Errors
/// [`Error::Device`] if the system refuses threads.
pub fn cpu() -> Result<Arc<dyn Tracer>, Error> {
    Ok(Arc::new(CpuTracer::new()?))
}
