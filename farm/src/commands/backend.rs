//! The back ends that a command line can name, opened.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use carom_farm::local_devices;
use carom_farm::multi_device::Hybrid;
use carom_tracer::cpu::CpuTracer;
use carom_tracer::gpu::{AdapterChoice, GpuTracer};
use carom_tracer::{
    CompiledScene, DeviceKind, ImageSize, RenderSettings, ScalarTracer, Tile, TileGrid, TraceJob,
    Tracer,
};
use clap::ValueEnum;
use cpu_time::ProcessTime;

use crate::commands::Failure;

/// A back end of the benches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Backend {
    /// SIMD on every core.
    Cpu,
    /// The first real GPU, or a software one if there is no other.
    Gpu,
    /// Both at once, as a node uses them.
    Hybrid,
    /// One sample at a time in f64: slow.
    Scalar,
}

impl Backend {
    const ALL: [Self; 4] = [Self::Cpu, Self::Gpu, Self::Hybrid, Self::Scalar];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
            Self::Hybrid => "hybrid",
            Self::Scalar => "scalar",
        }
    }

    /// Opens the back end; 0 threads are one per core.
    pub(crate) fn open(self, threads: usize) -> Result<Arc<dyn Tracer>, carom_tracer::Error> {
        Ok(match self {
            Self::Cpu => Arc::new(CpuTracer::with_threads(threads)?),
            Self::Gpu => Arc::new(GpuTracer::new(&AdapterChoice::Any)?),
            Self::Hybrid => {
                let devices = vec![Self::Gpu.open(threads)?, Self::Cpu.open(threads)?];
                Arc::new(Hybrid::new(devices, Vec::new()))
            }
            Self::Scalar => Arc::new(ScalarTracer),
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

/// Lets a GPU that was idle come to its full clock, which takes it some 0.1 s: does `work` once, which
/// compiles kernels, and goes on for a while.
///
/// # Errors
/// Those of `work`.
pub(crate) fn wake<E>(
    tracer: &dyn Tracer,
    mut work: impl FnMut() -> Result<(), E>,
) -> Result<(), E> {
    work()?;
    let begun = Instant::now();
    while tracer.info().kind == DeviceKind::Gpu && begun.elapsed() < WAKING {
        work()?;
    }
    Ok(())
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
) -> Result<f64, carom_tracer::Error> {
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
const WAKING: Duration = Duration::from_millis(300);

/// What a node traces with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum NodeBackend {
    /// Every real GPU that passes its probe, and the CPU where it helps.
    Auto,
    /// SIMD on every core.
    Cpu,
    /// One real GPU, and nothing in its place if it fails.
    Gpu,
}

impl NodeBackend {
    /// Opens the back end; 0 threads are one per core.
    pub(crate) fn open(self, threads: usize) -> Result<Arc<dyn Tracer>, carom_tracer::Error> {
        match self {
            Self::Auto => local_devices::auto(threads),
            Self::Cpu => local_devices::cpu(threads),
            Self::Gpu => local_devices::gpu(),
        }
    }
}
