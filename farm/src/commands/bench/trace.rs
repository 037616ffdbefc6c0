//! `carom-farm bench trace`: pixel samples and rays per second of each back end.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use anyhow::Context;
use carom_farm::multi_device::MultiDeviceTracer;
use carom_tracer::{
    CompiledScene, CpuTracer, DeviceKind, ImageSize, RenderSettings, Tile, TileGrid, TileRadiance,
    TraceJob, Tracer,
};
use cpu_time::ProcessTime;
use serde::Serialize;

use super::progress::Progress;
use crate::commands::Failure;
use crate::commands::inputs;
use carom_farm::backend::{self, Backend, OpenBackend};

/// Measure samples and rays per second of each back end of this machine
///
/// A sample is one path of maximum depth 5; `primary` are camera rays alone. Core-seconds are CPU
/// time of this process, so that other programs do not count. The back ends take turns, and the
/// best repetition is shown. The GPU is compared with one thread of the scalar tracer.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Trace this scene file [default: the built-in pool table]
    #[arg(long)]
    scene: Option<PathBuf>,
    /// Set the picture's size in pixels
    #[arg(long, default_value = "1280x720", value_name = "WIDTHxHEIGHT")]
    size: ImageSize,
    /// Trace this many samples per pixel in each repetition [default: 4 on the CPU, 16 with a GPU,
    /// 1 for the scalar tracer]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    spp: Option<u32>,
    /// Repeat each measurement this many times after a warm-up
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repetitions: u32,
    /// Measure only this back end [default: all that this machine has]
    #[arg(long)]
    backend: Option<Backend>,
    /// Use this many CPU threads; 0 means one per core
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: u16,
    /// Also measure the CPU back end with 1, 2, 4, … threads
    #[arg(long)]
    scaling: bool,
}

#[derive(Serialize)]
struct Report {
    scene: String,
    backends: Vec<Row>,
    /// Ratio of the rate of all devices together to the best one's.
    hybrid_over_best_device: Option<f64>,
    /// Ratio of the GPU's rate to that of one scalar thread.
    gpu_over_scalar_thread: Option<f64>,
    scaling: Vec<Scaling>,
}

#[derive(Serialize)]
struct Row {
    backend: &'static str,
    device: String,
    width: u32,
    threads: u32,
    msamples_per_core_second: f64,
    msamples_per_second: f64,
    /// Absent if the device does not count rays.
    mrays_per_second: Option<f64>,
    /// Rate of camera rays alone; absent if the device does not count rays.
    primary_mrays_per_core_second: Option<f64>,
}

/// Speed of the CPU with some of its cores.
#[derive(Serialize)]
struct Scaling {
    threads: usize,
    msamples_per_second: f64,
    /// Rate per thread relative to that of a single thread.
    efficiency: f64,
}

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    let named = inputs::scene(args.scene.as_deref())?;
    let scene = CompiledScene::new(&named.scene)?;
    let opened = backend::open_all(args.backend, usize::from(args.threads))?;
    let backends = measure_all(&opened, &scene, args)?;
    let scaling = match args.scaling {
        true => scaling(&scene, args)?,
        false => Vec::new(),
    };
    let report = Report {
        scene: named.name,
        hybrid_over_best_device: hybrid_over_best(&opened, &backends, &scene, args)?,
        gpu_over_scalar_thread: gpu_over_scalar(&backends),
        backends,
        scaling,
    };
    if args.json {
        let json = serde_json::to_string(&report).context("results as JSON")?;
        println!("{json}");
    } else {
        print_table(&report, args.size);
    }
    Ok(())
}

/// Cost of one repetition.
#[derive(Clone, Copy)]
struct Cost {
    wall_secs: f64,
    core_secs: f64,
    samples: u64,
    rays: u64,
}

/// The minima of `costs` in wall-clock time and in CPU time, in seconds.
fn least(costs: &[Cost]) -> (f64, f64) {
    let least = |cost: fn(&Cost) -> f64| costs.iter().map(cost).fold(f64::INFINITY, f64::min);
    (least(|c| c.wall_secs), least(|c| c.core_secs))
}

fn measure_all(
    opened: &[OpenBackend],
    scene: &CompiledScene,
    args: &Args,
) -> anyhow::Result<Vec<Row>> {
    let pictures = opened.len() * (1 + 2 * args.repetitions as usize);
    let progress = Progress::start("back ends", pictures);
    for opened in opened {
        warm_up(opened, scene, args)
            .with_context(|| format!("back end {}", opened.backend.name()))?;
        progress.step();
    }
    let mut costs = vec![(Vec::new(), Vec::new()); opened.len()];
    // Back ends take turns, so that changes of the machine's clock rate affect all of them alike.
    for _ in 0..args.repetitions {
        for (opened, (paths, primary)) in opened.iter().zip(&mut costs) {
            let samples = args.spp.unwrap_or(samples_default(opened.backend));
            let tracer = opened.tracer.as_ref();
            // It has fallen back to low clocks during the others' turns.
            if tracer.info().kind == DeviceKind::Gpu {
                backend::wake(tracer, || {
                    trace(tracer, scene, args.size, settings(samples)).map(|_| ())
                })?;
            }
            for (costs, settings) in [
                (&mut *paths, settings(samples)),
                (&mut *primary, camera_rays(samples)),
            ] {
                costs.push(trace(tracer, scene, args.size, settings)?);
                progress.step();
            }
        }
    }
    let rows = opened.iter().zip(&costs);
    Ok(rows
        .map(|(opened, (paths, primary))| row(opened, paths, primary))
        .collect())
}

fn row(opened: &OpenBackend, paths: &[Cost], primary: &[Cost]) -> Row {
    let (wall_secs, core_secs) = least(paths);
    let Cost { samples, rays, .. } = paths[0];
    let (_, primary_secs) = least(primary);
    let primary = primary[0].rays;
    let info = opened.tracer.info();
    Row {
        backend: opened.backend.name(),
        device: info.name,
        width: info.width,
        threads: info.threads,
        msamples_per_core_second: samples as f64 * 1e-6 / core_secs,
        msamples_per_second: samples as f64 * 1e-6 / wall_secs,
        mrays_per_second: (rays > 0).then_some(rays as f64 * 1e-6 / wall_secs),
        primary_mrays_per_core_second: (primary > 0)
            .then_some(primary as f64 * 1e-6 / primary_secs),
    }
}

/// Compiles kernels, starts threads and fills caches; devices that share work determine their shares.
fn warm_up(
    opened: &OpenBackend,
    scene: &CompiledScene,
    args: &Args,
) -> Result<(), carom_tracer::Error> {
    let measured = args.spp.unwrap_or(samples_default(opened.backend));
    let (jobs, samples) = match opened.backend {
        Backend::Hybrid => (MultiDeviceTracer::JOBS_UNTIL_SETTLED, measured),
        Backend::Cpu | Backend::Gpu | Backend::Scalar => (1, 1),
    };
    for settings in [settings(samples), camera_rays(samples)] {
        while !opened.tracer.is_ready(scene, &settings) {
            trace(opened.tracer.as_ref(), scene, args.size, settings)?;
        }
        for _ in 0..jobs {
            trace(opened.tracer.as_ref(), scene, args.size, settings)?;
        }
    }
    Ok(())
}

fn scaling(scene: &CompiledScene, args: &Args) -> anyhow::Result<Vec<Scaling>> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let doubling = std::iter::successors(Some(1), |threads| Some(2 * threads));
    let mut counts: Vec<usize> = doubling.take_while(|threads| *threads < cores).collect();
    counts.push(cores);
    let tracers = counts
        .iter()
        .map(|&threads| CpuTracer::with_threads(threads));
    let tracers = tracers.collect::<Result<Vec<_>, _>>()?;
    let mut costs = vec![Vec::new(); counts.len()];
    let pictures = counts.len() * (1 + args.repetitions as usize);
    let progress = Progress::start("threads", pictures);
    // One more than asked for, as a warm-up; the best repetition counts.
    for _ in 0..=args.repetitions {
        for (tracer, costs) in tracers.iter().zip(&mut costs) {
            let samples = args.spp.unwrap_or(samples_default(Backend::Cpu));
            costs.push(trace(tracer, scene, args.size, settings(samples))?);
            progress.step();
        }
    }
    let rates = costs
        .iter()
        .map(|costs| costs[0].samples as f64 * 1e-6 / least(costs).0);
    let rates: Vec<f64> = rates.collect();
    let row = |(&threads, &msamples_per_second): (&usize, &f64)| Scaling {
        threads,
        msamples_per_second,
        efficiency: msamples_per_second / (rates[0] * threads as f64),
    };
    Ok(counts.iter().zip(&rates).map(row).collect())
}

fn rate(rows: &[Row], backend: Backend) -> Option<&Row> {
    rows.iter().find(|row| row.backend == backend.name())
}

/// The rate of all devices together relative to the best one alone: the median over alternating pictures. The
/// times of pictures of a few milliseconds scatter by several percent, and so does the best of a few.
fn hybrid_over_best(
    opened: &[OpenBackend],
    rows: &[Row],
    scene: &CompiledScene,
    args: &Args,
) -> anyhow::Result<Option<f64>> {
    let find = |backend| opened.iter().find(|opened| opened.backend == backend);
    let speed = |backend| rate(rows, backend).map(|row| row.msamples_per_second);
    let (Some(cpu), Some(gpu)) = (speed(Backend::Cpu), speed(Backend::Gpu)) else {
        return Ok(None);
    };
    let best = if gpu > cpu {
        Backend::Gpu
    } else {
        Backend::Cpu
    };
    let (Some(best), Some(hybrid)) = (find(best), find(Backend::Hybrid)) else {
        return Ok(None);
    };
    let samples = args.spp.unwrap_or(samples_default(Backend::Hybrid));
    let picture = |opened: &OpenBackend| {
        let traced = trace(opened.tracer.as_ref(), scene, args.size, settings(samples));
        traced.map(|cost| cost.wall_secs)
    };
    let (begun, mut ratios) = (Instant::now(), Vec::new());
    while ratios.len() < TURNS.start || ratios.len() < TURNS.end && begun.elapsed() < TURNS_TIME {
        let (alone, together) = (picture(best)?, picture(hybrid)?);
        ratios.push(alone / together);
    }
    ratios.sort_by(f64::total_cmp);
    Ok(Some(ratios[ratios.len() / 2]))
}

fn gpu_over_scalar(rows: &[Row]) -> Option<f64> {
    let scalar = rate(rows, Backend::Scalar)?.msamples_per_core_second;
    Some(rate(rows, Backend::Gpu)?.msamples_per_second / scalar)
}

/// Samples per pixel that take about a second of one core, or less on a faster machine.
fn samples_default(backend: Backend) -> u32 {
    match backend {
        Backend::Cpu => 4,
        Backend::Gpu | Backend::Hybrid => 16,
        Backend::Scalar => 1,
    }
}

fn settings(samples: u32) -> RenderSettings {
    RenderSettings {
        samples,
        ..RenderSettings::default()
    }
}

fn camera_rays(samples: u32) -> RenderSettings {
    RenderSettings {
        max_depth: 0,
        ..settings(samples)
    }
}

fn trace(
    tracer: &dyn Tracer,
    scene: &CompiledScene,
    size: ImageSize,
    settings: RenderSettings,
) -> Result<Cost, carom_tracer::Error> {
    let grid = TileGrid::new(size, TILE_EDGE);
    let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
    let job = TraceJob {
        size,
        tiles: &tiles,
        settings,
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

/// Number of comparisons of the hybrid with the best device alone.
const TURNS: Range<usize> = 5..301;
const TURNS_TIME: Duration = Duration::from_secs(5);

/// Edge of a tile in pixels, as in the farm.
const TILE_EDGE: u16 = 32;

fn print_table(report: &Report, size: ImageSize) {
    let ImageSize { width, height } = size;
    println!(
        "{}, {width}x{height}, max depth 5, best repetition",
        report.scene
    );
    println!(
        "{:<10} {:>5} {:>7} {:>15} {:>11} {:>8} {:>21}  device",
        "back end",
        "width",
        "threads",
        "Msample/core-s",
        "Msample/s",
        "Mray/s",
        "primary Mray/core-s"
    );
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.1}"));
    for row in &report.backends {
        println!(
            "{:<10} {:>5} {:>7} {:>15.2} {:>11.2} {:>8} {:>21}  {}",
            row.backend,
            row.width,
            row.threads,
            row.msamples_per_core_second,
            row.msamples_per_second,
            number(row.mrays_per_second),
            number(row.primary_mrays_per_core_second),
            row.device
        );
    }
    if let Some(ratio) = report.hybrid_over_best_device {
        println!("hybrid over the best device alone: {ratio:.3}");
    }
    if let Some(ratio) = report.gpu_over_scalar_thread {
        println!("GPU over one scalar thread: {ratio:.1}");
    }
    for row in &report.scaling {
        println!(
            "{:>3} threads: {:.2} Msample/s, {:.0} % of one thread's rate each",
            row.threads,
            row.msamples_per_second,
            100.0 * row.efficiency
        );
    }
}
