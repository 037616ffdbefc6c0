//! `carom-farm compare`: the difference between a back end's picture and a reference picture.

use std::path::{Path, PathBuf};

use anyhow::Context;
use carom_tracer::film::{trace_estimate, trace_image};
use carom_tracer::metrics::{self, Estimate};
use carom_tracer::tonemap::srgb8;
use carom_tracer::{CompiledScene, RadianceImage, RenderSettings, Tile, TileGrid, Tracer};
use cpu_time::ProcessTime;
use serde::Serialize;

use crate::commands::Failure;
use crate::commands::inputs;
use carom_farm::backend::Backend;

/// Trace a scene and compare the picture with a reference picture of it
///
/// Of all figures lower is better. relMSE is the mean squared error relative to the squared
/// reference. FLIP, from 0 to 1, is the difference that a person sees when switching between the
/// pictures at exposure 1; 0.05 is visible, 0.01 hardly. Bias is the error of the picture's mean
/// per channel, in percent. |z| is the largest error of a region's mean, in standard errors; above
/// 4 or so the picture is biased.
#[derive(clap::Args)]
pub(crate) struct CompareArgs {
    /// Compare with this EXR file of linear Rec. 709 radiance; the picture gets its size
    #[arg(long)]
    reference: PathBuf,
    /// Read the reference's standard error per pixel and channel from this EXR file, and print |z|
    ///
    /// Finds bias that noise hides. Traces --spp samples once more, in independent pictures.
    #[arg(long)]
    stderr: Option<PathBuf>,
    /// Trace this scene file [default: the built-in pool table]
    #[arg(long)]
    scene: Option<PathBuf>,
    /// Trace this many samples per pixel; powers of two are distributed best
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    spp: u32,
    /// Limit paths to this many surface scattering events
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(0..=64))]
    max_depth: u32,
    /// Seed the random numbers
    #[arg(long, default_value_t = 0)]
    seed: u32,
    /// Denoise the picture, which biases it: |z| grows
    #[arg(long)]
    denoise: bool,
    /// Trace with this back end
    #[arg(long, default_value = "cpu")]
    backend: Backend,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Edge of a region in pixels: few regions, so that one of them rarely differs by more than 3 standard errors
/// by chance.
const REGION_EDGE: u16 = 120;
/// Number of independent pictures from whose variance the standard error is estimated.
const BATCHES: u32 = 8;

#[derive(Serialize)]
struct ComparisonReport {
    scene: String,
    backend: &'static str,
    spp: u32,
    denoise: bool,
    /// [`metrics::rel_mse`].
    relmse: f64,
    /// [`metrics::flip()`] of the pictures as shown at exposure 1.
    flip: f64,
    /// Relative error of the picture's mean, per channel.
    bias: [f64; 3],
    /// The largest difference of a region's mean in standard errors; null without `--stderr`.
    z_max_region: Option<f64>,
    /// CPU time of this process for the picture.
    cpu_seconds: f64,
}

pub(crate) fn run(args: &CompareArgs) -> Result<(), Failure> {
    let named = inputs::scene(args.scene.as_deref())?;
    let scene = CompiledScene::new(&named.scene)?;
    let reference = RadianceImage::read_exr(&args.reference)?;
    let stderr = args.stderr.as_deref();
    let stderr = stderr
        .map(|path| read_stderr(path, &reference))
        .transpose()?;
    let tracer = args.backend.open(0)?;
    let settings = RenderSettings {
        samples: args.spp,
        max_depth: args.max_depth,
        seed: args.seed,
        denoise: args.denoise,
        ..RenderSettings::default()
    };

    let started = ProcessTime::now();
    let film = trace_image(tracer.as_ref(), &scene, reference.size, settings)?;
    let cpu_seconds = started.elapsed().as_secs_f64();
    let picture = film.image();
    let report = ComparisonReport {
        scene: named.name,
        backend: args.backend.name(),
        spp: args.spp,
        denoise: args.denoise,
        relmse: metrics::rel_mse(&picture, &reference)?,
        flip: metrics::flip(picture.size, &shown(&picture), &shown(&reference))?.mean,
        bias: metrics::mean_ratio(&picture, &reference)?.map(|ratio| ratio - 1.0),
        z_max_region: stderr
            .map(|stderr| z_max_region(tracer.as_ref(), &scene, settings, reference, stderr))
            .transpose()?,
        cpu_seconds,
    };
    print(&report, args.json)?;
    Ok(())
}

fn shown(picture: &RadianceImage) -> Vec<[u8; 3]> {
    picture
        .pixels
        .iter()
        .map(|pixel| srgb8(*pixel, 1.0))
        .collect()
}

fn read_stderr(path: &Path, reference: &RadianceImage) -> Result<RadianceImage, Failure> {
    let stderr = RadianceImage::read_exr(path)?;
    if stderr.size == reference.size {
        return Ok(stderr);
    }
    Err(Failure::Input(format!(
        "the standard error has {}x{} pixels, but the reference {}x{}",
        stderr.size.width, stderr.size.height, reference.size.width, reference.size.height
    )))
}

/// Traces independent pictures with as many samples in all, rounded up, and returns the largest |z| of a
/// region. Errors of neighbouring pixels partly cancel, which the standard error of a region neglects, so |z|
/// is underestimated rather than overestimated.
fn z_max_region(
    tracer: &dyn Tracer,
    scene: &CompiledScene,
    settings: RenderSettings,
    mean: RadianceImage,
    stderr: RadianceImage,
) -> Result<f64, carom_tracer::Error> {
    let grid = TileGrid::new(mean.size, 32);
    let tiles: Vec<Tile> = grid.tiles(grid.all()).collect();
    let settings = RenderSettings {
        samples: settings.samples.div_ceil(BATCHES),
        seed: settings.seed.wrapping_add(1),
        ..settings
    };
    let traced = trace_estimate(tracer, scene, grid.size, settings, &tiles, BATCHES)?;
    let reference = Estimate { mean, stderr };
    let comparison = metrics::compare(&traced, &reference, REGION_EDGE)?;
    Ok(comparison.worst_region().map_or(0.0, |(z, _)| z))
}

fn print(report: &ComparisonReport, json: bool) -> anyhow::Result<()> {
    if json {
        let json = serde_json::to_string(report).context("results as JSON")?;
        println!("{json}");
        return Ok(());
    }
    println!(
        "{} on {}, {} samples per pixel",
        report.scene, report.backend, report.spp
    );
    println!(
        "relMSE      {:.3e}   mean squared error over squared reference",
        report.relmse
    );
    println!(
        "FLIP        {:.4}      visible difference, 0 to 1",
        report.flip
    );
    let [r, g, b] = report.bias.map(|bias| 100.0 * bias);
    println!("bias        {r:+.3} % {g:+.3} % {b:+.3} % of the mean");
    if let Some(z) = report.z_max_region {
        println!("region |z|  {z:.2} standard errors at most");
    }
    println!("CPU time    {:.2} s", report.cpu_seconds);
    Ok(())
}
