//! `carom-farm bench accuracy`: how far a back end's picture is from an independent renderer's.

use std::path::{Path, PathBuf};

use anyhow::Context;
use carom_tracer::film::trace_estimate;
use carom_tracer::metrics::{Comparison, Estimate, compare};
use carom_tracer::{CompiledScene, RadianceImage, RenderSettings, Tile, TileGrid};
use serde::Serialize;

use crate::commands::Failure;
use crate::commands::backend::Backend;
use crate::commands::inputs;

/// Compare a back end's picture with a reference picture of the same scene.
///
/// Exit code 1 if it is out of bounds: relMSE ≤ 1.2e-4 × 4096/spp, each channel's mean within
/// 0.3 %, and, with --stderr, each region of 120 pixels within 3 standard errors.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The reference: linear Rec. 709 radiance. Its size is the picture's.
    #[arg(long)]
    reference: PathBuf,
    /// Standard error of the reference, per pixel and channel.
    #[arg(long)]
    stderr: Option<PathBuf>,
    /// Scene file [default: the built-in pool table].
    #[arg(long)]
    scene: Option<PathBuf>,
    /// Samples per pixel, rounded up to batches of the same size.
    #[arg(long, default_value_t = 4096, value_parser = clap::value_parser!(u32).range(2..=65_536))]
    spp: u32,
    /// The back end.
    #[arg(long, default_value = "cpu")]
    backend: Backend,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// relMSE at [`SAMPLES_OF_BOUND`] samples: the noise that is left and the reference's own.
const REL_MSE_MAX: f64 = 1.2e-4;
const SAMPLES_OF_BOUND: f64 = 4096.0;
/// Distance of a channel's mean ratio from 1.
const MEAN_ERROR_MAX: f64 = 3e-3;
/// Standard errors of a region's mean.
const Z_MAX: f64 = 3.0;
/// Pixels along a region's edge: few regions, so that chance alone rarely makes one of them differ
/// by more than [`Z_MAX`].
const REGION_EDGE: u16 = 120;
/// Independent pictures from whose scatter the standard error comes.
const BATCHES: u32 = 8;

#[derive(Serialize)]
struct Report {
    scene: String,
    backend: &'static str,
    samples_per_pixel: u32,
    rel_mse: f64,
    rel_mse_max: f64,
    psnr_db: f64,
    mean_ratio: [f64; 3],
    /// Absent without the reference's standard error.
    largest_region_z: Option<f64>,
    pass: bool,
}

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    let named = inputs::scene(args.scene.as_deref())?;
    let scene = CompiledScene::new(&named.scene)?;
    let reference = reference(&args.reference, args.stderr.as_deref())?;
    let tracer = args.backend.open(0)?;
    let grid = TileGrid::new(reference.mean.size, 32);
    let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
    let batches = BATCHES.min(args.spp);
    let settings = RenderSettings {
        samples: args.spp.div_ceil(batches),
        ..RenderSettings::default()
    };
    let traced = trace_estimate(
        tracer.as_ref(),
        &scene,
        grid.size,
        settings,
        &tiles,
        batches,
    )?;
    let comparison = compare(&traced, &reference, REGION_EDGE)?;
    let samples = settings.samples * batches;
    let report = judge(named.name, args, samples, &comparison);
    print(&report, args.json)?;
    if report.pass {
        return Ok(());
    }
    Err(Failure::Run(anyhow::anyhow!(
        "the picture is out of bounds"
    )))
}

fn reference(mean: &Path, stderr: Option<&Path>) -> Result<Estimate, Failure> {
    let mean = RadianceImage::read_exr(mean)?;
    let stderr = match stderr {
        Some(path) => RadianceImage::read_exr(path)?,
        None => RadianceImage::black(mean.size),
    };
    if stderr.size != mean.size {
        return Err(Failure::Input(format!(
            "the standard error has {}x{} pixels, the reference {}x{}",
            stderr.size.width, stderr.size.height, mean.size.width, mean.size.height
        )));
    }
    Ok(Estimate { mean, stderr })
}

fn judge(scene: String, args: &Args, samples: u32, comparison: &Comparison) -> Report {
    let rel_mse_max = REL_MSE_MAX * (SAMPLES_OF_BOUND / f64::from(samples)).max(1.0);
    let largest_region_z = args
        .stderr
        .is_some()
        .then(|| comparison.worst_region().map_or(0.0, |(z, _)| z));
    let means_agree = comparison
        .mean_ratio
        .iter()
        .all(|ratio| (ratio - 1.0).abs() <= MEAN_ERROR_MAX);
    Report {
        scene,
        backend: args.backend.name(),
        samples_per_pixel: samples,
        rel_mse: comparison.rel_mse,
        rel_mse_max,
        psnr_db: comparison.psnr_db,
        mean_ratio: comparison.mean_ratio,
        largest_region_z,
        pass: comparison.rel_mse <= rel_mse_max
            && means_agree
            && largest_region_z.is_none_or(|z| z <= Z_MAX),
    }
}

fn print(report: &Report, json: bool) -> anyhow::Result<()> {
    if json {
        println!(
            "{}",
            serde_json::to_string(report).context("results as JSON")?
        );
        return Ok(());
    }
    println!(
        "{} on {}, {} samples per pixel",
        report.scene, report.backend, report.samples_per_pixel
    );
    println!(
        "relMSE     {:.3e} (at most {:.1e})",
        report.rel_mse, report.rel_mse_max
    );
    println!("PSNR       {:.2} dB", report.psnr_db);
    let [r, g, b] = report.mean_ratio;
    println!("mean ratio {r:.5} {g:.5} {b:.5} (within {MEAN_ERROR_MAX} of 1)");
    if let Some(z) = report.largest_region_z {
        println!("region |z| {z:.2} (at most {Z_MAX})");
    }
    println!("{}", if report.pass { "pass" } else { "FAIL" });
    Ok(())
}
