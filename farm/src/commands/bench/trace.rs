//! `carom-farm bench trace`: pixel samples and rays per second of each back end.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use anyhow::Context;
use carom_tracer::{
    CompiledScene, ImageSize, RenderSettings, Tile, TileGrid, TileRadiance, TraceJob, Tracer,
};
use cpu_time::ProcessTime;
use serde::Serialize;

use crate::commands::Failure;
use crate::commands::backend::{self, Backend, Opened};
use crate::commands::inputs;

/// Pixel samples and rays per second of each back end of this machine.
///
/// A pixel sample is one path of at most 5 scatterings. Core-seconds are CPU time of this process,
/// so that other programs on the machine do not count. The best of the repetitions is shown.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Scene file [default: the built-in pool table].
    #[arg(long)]
    scene: Option<PathBuf>,
    /// Pixels.
    #[arg(long, default_value = "1280x720")]
    size: ImageSize,
    /// Samples per pixel of one repetition [default: 4; 1 for the reference].
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    spp: Option<u32>,
    /// Repetitions after one that warms up.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repetitions: u32,
    /// Only this back end [default: every one that this machine has].
    #[arg(long)]
    backend: Option<Backend>,
    /// Threads of the CPU back end; 0 is one per core.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: u16,
}

#[derive(Serialize)]
struct Report {
    scene: String,
    backends: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    backend: &'static str,
    device: String,
    width: u32,
    threads: u32,
    msamples_per_core_second: f64,
    msamples_per_second: f64,
    /// Absent where the device does not count rays.
    mrays_per_second: Option<f64>,
}

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    let named = inputs::scene(args.scene.as_deref())?;
    let scene = CompiledScene::new(&named.scene)?;
    let mut backends = Vec::new();
    for opened in backend::open_all(args.backend, usize::from(args.threads))? {
        let row = measure(&opened, &scene, args)
            .with_context(|| format!("back end {}", opened.backend.name()))?;
        backends.push(row);
    }
    let report = Report {
        scene: named.name,
        backends,
    };
    if args.json {
        let json = serde_json::to_string(&report).context("results as JSON")?;
        println!("{json}");
    } else {
        print_table(&report, args.size);
    }
    Ok(())
}

/// What one repetition took.
#[derive(Clone, Copy)]
struct Cost {
    wall_secs: f64,
    core_secs: f64,
    samples: u64,
    rays: u64,
}

fn measure(opened: &Opened, scene: &CompiledScene, args: &Args) -> anyhow::Result<Row> {
    let tracer = opened.tracer.as_ref();
    // Compiles kernels, starts threads and fills caches.
    trace(tracer, scene, args.size, 1)?;
    let samples = args.spp.unwrap_or(samples_default(opened.backend));
    let costs = (0..args.repetitions)
        .map(|_| trace(tracer, scene, args.size, samples))
        .collect::<Result<Vec<Cost>, _>>()?;
    let least = |cost: fn(&Cost) -> f64| costs.iter().map(cost).fold(f64::INFINITY, f64::min);
    let (wall_secs, core_secs) = (least(|c| c.wall_secs), least(|c| c.core_secs));
    let Cost { samples, rays, .. } = costs[0];
    let info = tracer.info();
    Ok(Row {
        backend: opened.backend.name(),
        device: info.name,
        width: info.width,
        threads: info.threads,
        msamples_per_core_second: samples as f64 * 1e-6 / core_secs,
        msamples_per_second: samples as f64 * 1e-6 / wall_secs,
        mrays_per_second: (rays > 0).then_some(rays as f64 * 1e-6 / wall_secs),
    })
}

/// Enough for a second or so of work on one core, if the machine is no faster than that.
fn samples_default(backend: Backend) -> u32 {
    match backend {
        Backend::Cpu => 4,
        Backend::Gpu => 16,
        Backend::Reference => 1,
    }
}

fn trace(
    tracer: &dyn Tracer,
    scene: &CompiledScene,
    size: ImageSize,
    samples: u32,
) -> Result<Cost, carom_tracer::Error> {
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
    let (wall, core) = (Instant::now(), ProcessTime::now());
    let stats = tracer.trace(scene, &job, &|_: TileRadiance| {})?;
    Ok(Cost {
        wall_secs: wall.elapsed().as_secs_f64(),
        core_secs: core.elapsed().as_secs_f64(),
        samples: stats.samples,
        rays: stats.rays,
    })
}

/// The farm's own tiles.
const TILE_EDGE: u16 = 32;

fn print_table(report: &Report, size: ImageSize) {
    let ImageSize { width, height } = size;
    println!(
        "{}, {width}x{height}, at most 5 scatterings, best repetition",
        report.scene
    );
    println!(
        "{:<10} {:>5} {:>7} {:>15} {:>11} {:>8}  device",
        "back end", "width", "threads", "Msample/core-s", "Msample/s", "Mray/s"
    );
    for row in &report.backends {
        let rays = row
            .mrays_per_second
            .map_or_else(|| "-".to_owned(), |rays| format!("{rays:.1}"));
        println!(
            "{:<10} {:>5} {:>7} {:>15.2} {:>11.2} {:>8}  {}",
            row.backend,
            row.width,
            row.threads,
            row.msamples_per_core_second,
            row.msamples_per_second,
            rays,
            row.device
        );
    }
}
