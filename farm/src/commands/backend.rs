//! The back ends that a command line can name, opened.

use std::sync::Arc;

use carom_farm::local;
use carom_tracer::cpu::CpuTracer;
use carom_tracer::gpu::{AdapterChoice, GpuTracer};
use carom_tracer::{Reference, Tracer};
use clap::ValueEnum;

use crate::commands::Failure;

/// A back end of the benches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Backend {
    /// SIMD on every core.
    Cpu,
    /// The first real GPU, or a software one if there is no other.
    Gpu,
    /// The f64 reference: slow.
    Reference,
}

impl Backend {
    const ALL: [Self; 3] = [Self::Cpu, Self::Gpu, Self::Reference];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
            Self::Reference => "reference",
        }
    }

    /// Opens the back end; 0 threads are one per core.
    pub(crate) fn open(self, threads: usize) -> Result<Arc<dyn Tracer>, carom_tracer::Error> {
        Ok(match self {
            Self::Cpu => Arc::new(CpuTracer::with_threads(threads)?),
            Self::Gpu => Arc::new(GpuTracer::new(&AdapterChoice::Any)?),
            Self::Reference => Arc::new(Reference),
        })
    }
}

/// A back end that is ready to trace.
pub(crate) struct Opened {
    pub(crate) backend: Backend,
    pub(crate) tracer: Arc<dyn Tracer>,
}

/// Opens the one that is asked for, or else every one that this machine has.
pub(crate) fn open_all(wanted: Option<Backend>, threads: usize) -> Result<Vec<Opened>, Failure> {
    if let Some(backend) = wanted {
        let tracer = backend.open(threads)?;
        return Ok(vec![Opened { backend, tracer }]);
    }
    let mut opened = Vec::new();
    for backend in Backend::ALL {
        match backend.open(threads) {
            Ok(tracer) => opened.push(Opened { backend, tracer }),
            Err(why) => eprintln!("carom-farm: no {} here: {why}", backend.name()),
        }
    }
    Ok(opened)
}

/// What a node traces with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum NodeBackend {
    /// The GPU if there is a real one that passes its probe, else the CPU.
    Auto,
    /// SIMD on every core.
    Cpu,
    /// The GPU.
    Gpu,
}

impl NodeBackend {
    /// Opens the back end; 0 threads are one per core.
    pub(crate) fn open(self, threads: usize) -> Result<Arc<dyn Tracer>, carom_tracer::Error> {
        let cpu =
            || -> Result<Arc<dyn Tracer>, _> { Ok(Arc::new(CpuTracer::with_threads(threads)?)) };
        match self {
            Self::Auto => local::gpu().or_else(|why| {
                tracing::info!("tracing on the CPU: {why}");
                cpu()
            }),
            Self::Cpu => cpu(),
            Self::Gpu => local::gpu(),
        }
    }
}
