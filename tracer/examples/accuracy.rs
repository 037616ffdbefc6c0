//! Traces the pool scene, or the one of glass, gold and wax, and says how far the picture is from the independent reference.
//!
//! ```text
//! cargo run --release -p carom-tracer --example accuracy -- [reference|cpu|gpu [SAMPLES [pool|materials [picture.png]]]]
//! ```
//!
//! The f64 reference: relMSE 1.16e-2 at 16 samples, 1.45e-3 at 128, which is 0.186 over the samples;
//! its mean is within 0.02 % of the independent renderer's in each channel, and no region is biased.
//! The CPU tracer and the GPU tracer (on software Vulkan, 16 samples) give the same figures.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use carom_tracer::film::trace_estimate;
use carom_tracer::gpu::AdapterChoice;
use carom_tracer::metrics::{Comparison, Estimate, compare};
use carom_tracer::{
    CompiledScene, CpuTracer, GpuTracer, RadianceImage, Reference, RenderSettings, Scene, Tile,
    TileGrid, Tracer,
};

/// Independent pictures from whose scatter the standard error comes.
const BATCHES: u32 = 8;
/// Pixels along the edge of the regions whose means are compared.
const REGION_EDGE: u16 = 30;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let tracer = tracer(arguments.next().as_deref().unwrap_or("reference"))?;
    let samples: u32 = arguments.next().as_deref().unwrap_or("16").parse()?;

    let name = arguments.next().unwrap_or_else(|| "pool".to_owned());
    let scatterings_max = match name.as_str() {
        "pool" => 5,
        "materials" => 63,
        _ => {
            return Err(
                format!("there is no picture of `{name}`: choose pool or materials").into(),
            );
        }
    };

    let picture = |suffix: &str| {
        RadianceImage::read_exr(repository(&format!(
            "tests/references/{name}_480x270{suffix}.exr"
        )))
    };
    let reference = Estimate {
        mean: picture("")?,
        stderr: picture("_stderr")?,
    };
    let scene = Scene::load(repository(&format!("assets/scenes/{name}.json")))?;
    let scene = CompiledScene::new(&scene)?;
    let grid = TileGrid::new(reference.mean.size, 32);
    let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
    let settings = RenderSettings {
        samples: samples.div_ceil(BATCHES),
        scatterings_max,
        ..RenderSettings::default()
    };

    let started = Instant::now();
    let size = grid.size;
    let traced = trace_estimate(tracer.as_ref(), &scene, size, settings, &tiles, BATCHES)?;
    let (secs, samples) = (started.elapsed().as_secs_f64(), settings.samples * BATCHES);
    println!(
        "{}: {samples} samples a pixel, {secs:.1} s",
        tracer.info().name
    );
    print(&compare(&traced, &reference, REGION_EDGE)?);
    if let Some(path) = arguments.next() {
        traced.mean.write_png(path, 1.0)?;
    }
    Ok(())
}

fn tracer(name: &str) -> Result<Box<dyn Tracer>, Box<dyn Error>> {
    match name {
        "reference" => Ok(Box::new(Reference)),
        "cpu" => Ok(Box::new(CpuTracer::new()?)),
        "gpu" => Ok(Box::new(GpuTracer::new(&AdapterChoice::Any)?)),
        _ => Err(format!("there is no tracer `{name}`: choose reference, cpu or gpu").into()),
    }
}

fn print(comparison: &Comparison) {
    let Comparison {
        rel_mse,
        psnr_db,
        mean_ratio: [r, g, b],
        regions,
    } = comparison;
    println!("  relMSE {rel_mse:.3e}, PSNR {psnr_db:.2} dB");
    println!("  mean over the reference's: red {r:.5}, green {g:.5}, blue {b:.5}");
    let z2 = regions
        .iter()
        .flat_map(|region| region.z)
        .map(|z| z * z)
        .sum::<f64>();
    let z_rms = (z2 / (3 * regions.len()) as f64).sqrt();
    if let Some((z, region)) = comparison.worst_region() {
        let Tile { x, y, .. } = region.tile;
        println!(
            "  z of {} regions: rms {z_rms:.2} (1 without bias)",
            regions.len()
        );
        println!("  largest |z| {z:.2} at ({x}, {y})");
    }
}

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}
