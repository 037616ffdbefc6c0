//! Speed of the GPU on a scene: `gpu_speed [width height spp frames in_flight [denoise]] [SCENE.json]`.
//!
//! Without a scene file the pool table is traced.
//! Prints the GPU's own time per frame, the mean and that of the fastest (a GPU that waits between frames lowers
//! its clock), samples and rays per second of it, and frames per second
//! by the clock with each frame read back: first with one frame in flight, then with `in_flight`.
//! With `denoise` also what the denoiser takes of it: first hits, and the filter's passes.
//! Frames that overlap count each other's GPU time, so that the first figure is the device's.
//! `CAROM_GPU` names an adapter; without it the first real GPU is used, software if there is none.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread;
use std::time::Instant;

use carom_tracer::gpu::{AdapterChoice, adapters};
use carom_tracer::{
    CompiledScene, Error, GpuTracer, ImageSize, RenderSettings, Scene, Tile, TileGrid, TraceJob,
    TraceStats, Tracer,
};

/// What to measure.
struct Measurement {
    scene: String,
    size: ImageSize,
    samples: u32,
    frames: u32,
    in_flight: u32,
    denoise: bool,
}

fn main() -> Result<(), Error> {
    let run = arguments();
    for (index, adapter) in adapters().iter().enumerate() {
        println!("GPU {index}: {} ({})", adapter.name, adapter.driver);
    }
    let choice = std::env::var("CAROM_GPU").map_or(AdapterChoice::Any, AdapterChoice::Name);
    let started = Instant::now();
    let tracer = GpuTracer::new(&choice)?;
    println!(
        "{}: ready after {:.2?}",
        tracer.info().name,
        started.elapsed()
    );
    let scene = CompiledScene::new(&Scene::load(&run.scene)?)?;
    // Compiles the kernel, allocates the buffers and learns the speed.
    for seed in 0..3 {
        frame(&tracer, &scene, &run, seed)?;
    }
    for in_flight in [1, run.in_flight] {
        measure(&tracer, &scene, &run, in_flight)?;
    }
    Ok(())
}

fn arguments() -> Measurement {
    let mut given: Vec<String> = std::env::args().skip(1).collect();
    let pool = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/scenes/pool.json");
    let scene = given.pop_if(|last| last.ends_with(".json"));
    let denoise = given.pop_if(|last| last == "denoise").is_some();
    let given: Vec<u32> = given
        .iter()
        .map(|text| text.parse().expect("width height spp frames in_flight"))
        .collect();
    let argument = |index: usize, default| given.get(index).copied().unwrap_or(default);
    Measurement {
        scene: scene.unwrap_or_else(|| pool.to_owned()),
        size: ImageSize::new(argument(0, 1920), argument(1, 1080)),
        samples: argument(2, 16),
        frames: argument(3, 100),
        in_flight: argument(4, 2),
        denoise,
    }
}

fn measure(
    tracer: &GpuTracer,
    scene: &CompiledScene,
    run: &Measurement,
    in_flight: u32,
) -> Result<(), Error> {
    let total = Mutex::new((TraceStats::default(), u64::MAX));
    let next = AtomicU32::new(0);
    let started = Instant::now();
    let worker = || -> Result<(), Error> {
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed >= run.frames {
                return Ok(());
            }
            let stats = frame(tracer, scene, run, seed)?;
            let mut total = total.lock().expect("no worker panics");
            total.0 += stats;
            total.1 = total.1.min(stats.device_nanos);
        }
    };
    thread::scope(|scope| {
        let workers: Vec<_> = (0..in_flight).map(|_| scope.spawn(worker)).collect();
        workers
            .into_iter()
            .try_for_each(|worker| worker.join().expect("no worker panics"))
    })?;
    report(
        run,
        in_flight,
        total.into_inner().expect("no worker panics"),
        started.elapsed().as_secs_f64(),
    );
    Ok(())
}

fn frame(
    tracer: &GpuTracer,
    scene: &CompiledScene,
    run: &Measurement,
    seed: u32,
) -> Result<TraceStats, Error> {
    let grid = TileGrid::new(run.size, 32);
    let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
    let job = TraceJob {
        size: run.size,
        tiles: &tiles,
        settings: RenderSettings {
            samples: run.samples,
            seed,
            denoise: run.denoise,
            ..RenderSettings::default()
        },
        cancelled: &AtomicBool::new(false),
    };
    tracer.trace(scene, &job, &|tile| {
        std::hint::black_box(tile);
    })
}

fn report(
    run: &Measurement,
    in_flight: u32,
    (total, nanos_min): (TraceStats, u64),
    wall_secs: f64,
) {
    let device_secs = total.device_nanos as f64 * 1e-9;
    let frames = f64::from(run.frames);
    println!(
        "{}x{}, {} spp, {} frames, {} in flight",
        run.size.width, run.size.height, run.samples, run.frames, in_flight
    );
    println!(
        "GPU time        {:9.3} ms/frame, {:.3} the fastest",
        device_secs * 1e3 / frames,
        nanos_min as f64 * 1e-6
    );
    if run.denoise {
        let millis = |nanos: u64| nanos as f64 * 1e-6 / frames;
        println!(
            "  first hits    {:9.3} ms/frame",
            millis(total.first_hits_nanos)
        );
        println!(
            "  filter        {:9.3} ms/frame",
            millis(total.filter_nanos)
        );
    }
    println!(
        "GPU rate        {:9.1} Msample/s, {:.3} Gray/s",
        total.samples as f64 * 1e-6 / device_secs,
        total.rays as f64 * 1e-9 / device_secs
    );
    println!(
        "over Mitsuba    {:9.1} times its {MITSUBA_MSAMPLES} Msample/s on an H200",
        total.samples as f64 * 1e-6 / device_secs / MITSUBA_MSAMPLES
    );
    println!(
        "rays            {:9.2} per sample",
        total.rays as f64 / total.samples as f64
    );
    println!("with read-back  {:9.2} frames/s", frames / wall_secs);
}

/// Mitsuba 3.9's CUDA back end on one H200: the pool table, 1920x1080, 16 samples, 68.7 ms.
const MITSUBA_MSAMPLES: f64 = 483.0;
