//! Tracers of this machine's devices.

use std::sync::Arc;

use carom_tracer::{CpuTracer, Error, Tracer};
#[cfg(feature = "gpu")]
use carom_tracer::{GpuTracer, gpu::AdapterChoice};

#[cfg(feature = "gpu")]
use crate::multi_device::MultiDeviceTracer;

/// All devices of this machine: every hardware GPU that passes its self-test, and the CPU with `threads`
/// threads, 0 for one per core.
///
/// # Errors
/// [`Error::Device`] if the CPU's threads cannot be started.
#[cfg(feature = "gpu")]
pub(crate) fn auto(threads: usize) -> Result<Arc<dyn Tracer>, Error> {
    let cpu = cpu(threads)?;
    let mut devices: Vec<Arc<dyn Tracer>> = Vec::new();
    let mut absent = Vec::new();
    for gpu in GpuTracer::all() {
        match gpu {
            Ok(gpu) => devices.push(Arc::new(gpu)),
            Err(why) => {
                tracing::warn!("a GPU is not used: {why}");
                absent.push(why.to_string());
            }
        }
    }
    // Failed GPUs are passed on, so that the tracer's name reports them.
    if devices.is_empty() && absent.is_empty() {
        tracing::info!("tracing on the CPU: there is no GPU");
        return Ok(cpu);
    }
    devices.push(cpu);
    Ok(Arc::new(MultiDeviceTracer::new(devices, absent)))
}

/// A hardware GPU that passes its self-test.
///
/// # Errors
/// [`Error::Device`] if there is none.
#[cfg(feature = "gpu")]
pub(crate) fn gpu() -> Result<Arc<dyn Tracer>, Error> {
    Ok(Arc::new(GpuTracer::new(&AdapterChoice::Gpu)?))
}

/// Without the feature `gpu`, the CPU alone.
#[cfg(not(feature = "gpu"))]
pub(crate) fn auto(threads: usize) -> Result<Arc<dyn Tracer>, Error> {
    cpu(threads)
}

#[cfg(not(feature = "gpu"))]
pub(crate) fn gpu() -> Result<Arc<dyn Tracer>, Error> {
    Err(Error::Device {
        device: "GPU".to_owned(),
        message: "this program was built without the feature `gpu` of carom-farm".to_owned(),
    })
}

/// The CPU with `threads` threads, 0 for one per core.
///
/// # Errors
/// [`Error::Device`] if the threads cannot be started.
pub(crate) fn cpu(threads: usize) -> Result<Arc<dyn Tracer>, Error> {
    Ok(Arc::new(CpuTracer::with_threads(threads)?))
}
