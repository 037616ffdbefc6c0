//! Samples that the processor traces per second of processor time.
//!
//! `cargo run --release -p carom-tracer --example trace_speed -- SCENE.json [SAMPLES] [THREADS] [LEVELS]`
//!
//! `LEVELS` is how many instruction sets to measure, the best first.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use carom_tracer::{
    CompiledScene, CpuTracer, ImageSize, RenderSettings, Scene, TileGrid, TraceJob, Tracer,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("which scene file?")?;
    let samples = arguments.next().map_or(Ok(4), |text| text.parse())?;
    let threads = arguments.next().map_or(Ok(1), |text| text.parse())?;
    let levels = arguments.next().map_or(Ok(1), |text| text.parse())?;
    let scene = CompiledScene::new(&Scene::load(path)?)?;
    let size = ImageSize::new(1280, 720);
    let grid = TileGrid::new(size, 64);
    let tiles: Vec<_> = grid.tiles(grid.all()).collect();
    for level in CpuTracer::levels_available().into_iter().take(levels) {
        let tracer = CpuTracer::with_level(threads, level)?;
        let settings = RenderSettings {
            samples,
            ..RenderSettings::default()
        };
        let job = TraceJob {
            size,
            tiles: &tiles,
            settings,
            cancelled: &AtomicBool::new(false),
        };
        let (wall, cpu) = (Instant::now(), cpu_secs());
        let stats = tracer.trace(&scene, &job, &|_| {})?;
        let (wall, cpu) = (wall.elapsed().as_secs_f64(), cpu_secs() - cpu);
        println!(
            "{}: {:.2} Msample and {:.1} Mray per core-second, {:.2} rays per sample, {wall:.2} s",
            tracer.info().name,
            stats.samples as f64 * 1e-6 / cpu,
            stats.rays as f64 * 1e-6 / cpu,
            stats.rays as f64 / stats.samples as f64,
        );
    }
    Ok(())
}

/// Processor time of this process in seconds, in steps of 10 ms; not a number where the system
/// has no such file.
fn cpu_secs() -> f64 {
    /// Linux counts a hundred ticks a second on every platform that Rust supports.
    const TICKS_PER_SEC: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    let fields: Vec<f64> = after_name
        .split_whitespace()
        .filter_map(|f| f.parse().ok())
        .collect();
    // The letter of the state is not a number: `utime` and `stime` are the 11th and 12th that are.
    fields
        .get(10..12)
        .map_or(f64::NAN, |ticks| ticks.iter().sum::<f64>() / TICKS_PER_SEC)
}
