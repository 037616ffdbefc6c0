//! `carom-farm render`: one picture by the whole farm, without the game.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context;
use carom_farm::net::{self, NodeAddress};
use carom_farm::{Error, Farm, FarmConfig, Frame, FrameSpec, LocalNode, NodeState, Pixels};
use carom_protocol::PixelFormat;
use carom_tracer::film::Film;
use carom_tracer::{ImageSize, RenderSettings, SceneUpdate, Tile};
use indicatif::{ProgressBar, ProgressStyle};

use crate::commands::Failure;
use crate::commands::inputs::{self, Format, Output};

/// Trace a picture on this machine, on nodes, or on both.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Scene file [default: the built-in pool table].
    #[arg(long)]
    scene: Option<PathBuf>,
    /// Pixels.
    #[arg(long, default_value = "1280x720")]
    size: ImageSize,
    /// Samples per pixel.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    spp: u32,
    /// Surface scatterings of a path.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(0..=64))]
    scatterings: u32,
    /// Chooses the random numbers.
    #[arg(long, default_value_t = 0)]
    seed: u32,
    /// A node, as host:port; may be repeated. In place of those of --config.
    #[arg(long)]
    node: Vec<NodeAddress>,
    /// Folder of the farm's credentials, as `init` made it [default: .carom, or --config's].
    #[arg(long)]
    credentials: Option<PathBuf>,
    /// A farm.toml.
    #[arg(long)]
    config: Option<PathBuf>,
    /// What this machine traces with: auto (the GPU if there is one that traces rightly, else the
    /// CPU), cpu, gpu or none [default: auto, or --config's].
    #[arg(long)]
    backend: Option<LocalNode>,
    /// The picture: .png (8-bit sRGB) or .exr (32-bit linear).
    #[arg(long)]
    out: Output,
}

/// A picture comes as so many frames of other samples, so that the bar moves;
const FRAMES: u32 = 16;
/// but a frame of fewer samples is more transport than tracing,
const FRAME_SAMPLES_MIN: usize = 1 << 21;
/// and one of more is long to repeat when a node is lost. The bounds depend on the picture alone,
/// so that it is the same bit for bit whoever traces it.
const FRAME_SAMPLES_MAX: usize = 1 << 26;
/// How long to wait for a frame before looking at what else there is.
const PATIENCE: Duration = Duration::from_millis(200);
/// How long to wait for nodes when none is left.
const NODES_PATIENCE: Duration = Duration::from_secs(10);

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    let named = inputs::scene(args.scene.as_deref())?;
    let mut farm = Farm::new(config(args)?)?;
    farm.set_scene(&named.scene)?;
    let interrupted = net::interruption().context("Ctrl-C")?;
    let film = trace(&mut farm, args, &interrupted)?;
    drop(farm);
    if film.dropped_samples() > 0 {
        eprintln!(
            "carom-farm: {} samples were not finite and count as black",
            film.dropped_samples()
        );
    }
    write(&film, &args.out)
}

fn config(args: &Args) -> Result<FarmConfig, Failure> {
    let mut config = match &args.config {
        Some(path) => FarmConfig::load(path)?,
        None => FarmConfig::default(),
    };
    if !args.node.is_empty() {
        config.nodes = args.node.iter().map(NodeAddress::to_string).collect();
    }
    if let Some(folder) = &args.credentials {
        config.credentials.clone_from(folder);
    }
    if let Some(backend) = args.backend {
        config.local = backend;
    }
    if config.local == LocalNode::None && config.nodes.is_empty() {
        return Err(Failure::Input(
            "there is no node to trace with: give --node HOST:PORT or another --backend".into(),
        ));
    }
    Ok(config)
}

/// Submits the picture's frames, as many at a time as the farm takes, and merges them.
fn trace(farm: &mut Farm, args: &Args, interrupted: &AtomicBool) -> Result<Film, Failure> {
    let mut film = Film::new(args.size);
    let mut waiting = batches(args.size, args.spp);
    let mut in_flight = VecDeque::new();
    let bar = progress_bar(args.spp);
    let mut quiet_since = Instant::now();
    while !(waiting.is_empty() && in_flight.is_empty()) {
        while let Some(batch) = waiting.front() {
            match farm.submit(batch.spec(args)) {
                Ok(_) => in_flight.extend(waiting.pop_front()),
                Err(Error::FramesInFlight { .. }) => break,
                Err(why) => return Err(why.into()),
            }
        }
        if let Some(frame) = farm.wait_frame(PATIENCE) {
            let samples = in_flight.pop_front().map_or(0, |batch| batch.samples);
            add(&mut film, &frame, samples)?;
            bar.inc(u64::from(samples));
            quiet_since = Instant::now();
        } else if interrupted.load(Ordering::Relaxed) {
            return Err(Failure::Interrupted);
        } else if quiet_since.elapsed() > NODES_PATIENCE {
            give_up_without_nodes(farm)?;
        }
    }
    bar.finish_and_clear();
    Ok(film)
}

/// A frame: a range of the picture's samples.
#[derive(Clone, Copy)]
struct Batch {
    first_sample: u32,
    samples: u32,
}

impl Batch {
    fn spec(&self, args: &Args) -> FrameSpec {
        FrameSpec {
            update: SceneUpdate::default(),
            size: args.size,
            settings: RenderSettings {
                samples: self.samples,
                first_sample: self.first_sample,
                scatterings_max: args.scatterings,
                seed: args.seed,
            },
            format: PixelFormat::LinearF32,
        }
    }
}

fn batches(size: ImageSize, spp: u32) -> VecDeque<Batch> {
    let fewest = FRAME_SAMPLES_MIN.div_ceil(size.pixels());
    let most = (FRAME_SAMPLES_MAX / size.pixels()).max(1);
    let samples = (spp.div_ceil(FRAMES) as usize).max(fewest).min(most) as u32;
    let firsts = (0..spp).step_by(samples as usize);
    firsts
        .map(|first_sample| Batch {
            first_sample,
            samples: samples.min(spp - first_sample),
        })
        .collect()
}

fn add(film: &mut Film, frame: &Frame, samples: u32) -> Result<(), Failure> {
    let Pixels::Linear(pixels) = &frame.pixels else {
        let why = "the farm gave other pixels than were asked for";
        return Err(anyhow::anyhow!(why).into());
    };
    let ImageSize { width, height } = frame.size;
    let (x, y) = (0, 0);
    let whole = Tile {
        x,
        y,
        width,
        height,
    };
    film.add(whole, pixels, samples)?;
    film.count_dropped(u32::try_from(frame.stats.dropped_samples).unwrap_or(u32::MAX));
    Ok(())
}

/// Nodes that are being called may still come; when all are lost, nobody will.
fn give_up_without_nodes(farm: &Farm) -> Result<(), Failure> {
    let mut reasons = Vec::new();
    for node in farm.nodes() {
        match node.state {
            NodeState::Lost { why } => reasons.push(format!("{}: {why}", node.address)),
            _ => return Ok(()),
        }
    }
    Err(Failure::Run(anyhow::anyhow!(
        "no node is left: {}",
        reasons.join("; ")
    )))
}

/// On standard error, and only if that is a terminal.
fn progress_bar(spp: u32) -> ProgressBar {
    let style = ProgressStyle::with_template(
        "{elapsed_precise} [{bar:40}] {pos}/{len} samples per pixel, {eta} left",
    );
    ProgressBar::new(u64::from(spp))
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// Writes beside the file and then renames, so that no half a picture is ever seen.
fn write(film: &Film, out: &Output) -> Result<(), Failure> {
    let partial = out.path.with_extension("partial");
    let image = film.image();
    match out.format {
        Format::Exr => image.write_exr(&partial)?,
        Format::Png => image.write_png(&partial, 1.0)?,
    }
    std::fs::rename(&partial, &out.path)
        .with_context(|| out.path.display().to_string())
        .map_err(Failure::Run)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_cover_each_sample_once() {
        for (width, height) in [(1, 1), (32, 18), (1280, 720), (16_384, 16_384)] {
            for spp in [1, 2, 15, 16, 17, 64, 4096, 65_536] {
                let mut next = 0;
                for batch in batches(ImageSize::new(width, height), spp) {
                    assert_eq!(batch.first_sample, next);
                    assert!(batch.samples > 0);
                    next += batch.samples;
                }
                assert_eq!(next, spp);
            }
        }
    }
}
