//! Back ends that can be named on a command line.

use std::sync::Arc;
use std::time::{Duration, Instant};

use carom_tracer::cpu::CpuTracer;
use carom_tracer::gpu::{AdapterChoice, GpuTracer};
use carom_tracer::{DeviceKind, Error, ScalarTracer, Tracer};
use clap::ValueEnum;

use crate::local_devices;
use crate::multi_device::MultiDeviceTracer;

/// A back end of the benches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Backend {
    /// SIMD on all cores
    Cpu,
    /// The first hardware GPU, or a software one if there is no other
    Gpu,
    /// The GPU and the CPU together, as a node uses them
    Hybrid,
    /// One sample at a time in f64 (slow)
    Scalar,
}

impl Backend {
    const ALL: [Self; 4] = [Self::Cpu, Self::Gpu, Self::Hybrid, Self::Scalar];

    /// The name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
            Self::Hybrid => "hybrid",
            Self::Scalar => "scalar",
        }
    }

    /// Opens the back end; 0 threads means one per core.
    ///
    /// # Errors
    /// No such device, or one that fails its self-test.
    pub fn open(self, threads: usize) -> Result<Arc<dyn Tracer>, Error> {
        Ok(match self {
            Self::Cpu => Arc::new(CpuTracer::with_threads(threads)?),
            Self::Gpu => Arc::new(GpuTracer::new(&AdapterChoice::Any)?),
            Self::Hybrid => {
                let devices = vec![Self::Gpu.open(threads)?, Self::Cpu.open(threads)?];
                Arc::new(MultiDeviceTracer::new(devices, Vec::new()))
            }
            Self::Scalar => Arc::new(ScalarTracer),
        })
    }
}

/// An opened back end.
pub struct OpenBackend {
    /// Its kind.
    pub backend: Backend,
    /// Its tracer.
    pub tracer: Arc<dyn Tracer>,
}

/// Opens one back end, or all that this machine has; the log names the missing ones.
///
/// # Errors
/// The error of the requested back end, if it cannot be opened.
pub fn open_all(wanted: Option<Backend>, threads: usize) -> Result<Vec<OpenBackend>, Error> {
    if let Some(backend) = wanted {
        let tracer = backend.open(threads)?;
        return Ok(vec![OpenBackend { backend, tracer }]);
    }
    let mut opened = Vec::new();
    for backend in Backend::ALL {
        match backend.open(threads) {
            Ok(tracer) => opened.push(OpenBackend { backend, tracer }),
            Err(why) => tracing::warn!("no {} here: {why}", backend.name()),
        }
    }
    Ok(opened)
}

/// Warms a device up: runs `work` once, which compiles kernels, and on a GPU repeats it until an idle one
/// has reached its full clock, after some 0.1 s.
///
/// # Errors
/// The errors of `work`.
pub fn wake<E>(tracer: &dyn Tracer, mut work: impl FnMut() -> Result<(), E>) -> Result<(), E> {
    work()?;
    let begun = Instant::now();
    while tracer.info().kind == DeviceKind::Gpu && begun.elapsed() < WAKING {
        work()?;
    }
    Ok(())
}

/// Duration of the warm-up of a GPU.
const WAKING: Duration = Duration::from_millis(300);

/// The devices of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum NodeBackend {
    /// All GPUs that pass the self-test, plus the CPU where it helps
    Auto,
    /// SIMD on all cores
    Cpu,
    /// One hardware GPU, without a substitute if it fails
    Gpu,
}

impl NodeBackend {
    /// Opens the back end; 0 threads means one per core.
    ///
    /// # Errors
    /// No such device, or one that fails its self-test.
    pub fn open(self, threads: usize) -> Result<Arc<dyn Tracer>, Error> {
        match self {
            Self::Auto => local_devices::auto(threads),
            Self::Cpu => local_devices::cpu(threads),
            Self::Gpu => local_devices::gpu(),
        }
    }
}
