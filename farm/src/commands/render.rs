//! `carom-farm render`: one picture by the whole farm, without the game.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::Context;
use carom_farm::net::{self, NodeAddress};
use carom_farm::{
    Balancing, Error, Farm, FarmConfig, Frame, FrameSpec, LocalNode, NodeState, Pixels,
};
use carom_protocol::PixelFormat;
use carom_tracer::film::Film;
use carom_tracer::{
    CompiledScene, CpuTracer, ImageSize, Layers, Preset, RenderSettings, Scene, SceneUpdate, Tile,
    TraceJob, Tracer,
};
use indicatif::{ProgressBar, ProgressStyle};

use crate::commands::Failure;
use crate::commands::checkpoint::Checkpoint;
use crate::commands::inputs::{self, Format, Output};

/// Trace a picture on this machine, on nodes, or on both.
#[derive(Clone, clap::Args)]
pub(crate) struct Args {
    /// Scene file [default: the built-in pool table].
    #[arg(long)]
    scene: Option<PathBuf>,
    /// Pixels.
    #[arg(long, default_value = "1280x720")]
    size: ImageSize,
    /// How good it is to be, in place of --spp and --denoise: draft, low, medium, high, final or
    /// reference. The first three have a quarter, half and three quarters of --size along each
    /// edge; `bench tradeoff` measures what each takes and loses.
    #[arg(long, conflicts_with_all = ["spp", "denoise"])]
    preset: Option<Preset>,
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
    /// What this machine traces with: auto (every GPU that traces rightly, and the CPU), cpu,
    /// gpu or none [default: auto, or --config's].
    #[arg(long)]
    backend: Option<LocalNode>,
    /// How the picture is divided among nodes: the name of a balancer, as in the configuration's
    /// `balancer` [default: water_filling_hedged, or --config's].
    #[arg(long, value_name = "NAME")]
    balancer: Option<Balancing>,
    /// Filter the noise that is left, guided by what camera rays meet first: 4 samples then look
    /// like 16 and more. Samples come in fewer frames, each of which is filtered by itself.
    #[arg(long)]
    denoise: bool,
    /// The picture: .png (8-bit sRGB), or .exr (32-bit linear, with layers of albedo, normal and
    /// depth); may be repeated. Until it is done, a file `<OUT>.checkpoint` is beside the first
    /// one: the same command goes on from there after a crash.
    #[arg(long, required = true)]
    out: Vec<Output>,
    /// Seconds between checkpoints: lower loses less to a crash, and writes 32 bytes a pixel more
    /// often.
    #[arg(long, default_value_t = 30)]
    checkpoint_secs: u32,
}

/// A picture comes as so many frames of other samples, so that the bar moves;
const FRAMES: u32 = 16;
/// but a frame of fewer samples is more transport than tracing,
const FRAME_SAMPLES_MIN: usize = 1 << 21;
/// and one of more is long to repeat when a node is lost. The bounds depend on the picture alone,
/// so that it is the same bit for bit whoever traces it.
const FRAME_SAMPLES_MAX: usize = 1 << 26;
/// Camera rays of a pixel of a layer: their outlines are smooth then.
const LAYER_SAMPLES_MAX: u32 = 16;
/// How long to wait for a frame before looking at what else there is.
const PATIENCE: Duration = Duration::from_millis(200);
/// How long to wait for nodes when none is left.
const NODES_PATIENCE: Duration = Duration::from_secs(10);

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    let args = &args.with_preset();
    let named = inputs::scene(args.scene.as_deref())?;
    let mut farm = Farm::new(config(args)?)?;
    farm.set_scene(&named.scene)?;
    let interrupted = net::interruption().context("Ctrl-C")?;
    let mut progress = Progress::begin(&named.scene, args)?;
    let traced = trace(&mut farm, args, &mut progress, &interrupted);
    drop(farm);
    if matches!(traced, Err(Failure::Interrupted)) && progress.samples_done > 0 {
        progress.checkpoint.write(&progress.film)?;
        let path = progress.checkpoint.path().display();
        eprintln!("carom-farm: the same command goes on from {path}");
    }
    traced?;
    let film = &progress.film;
    if film.dropped_samples() > 0 {
        eprintln!(
            "carom-farm: {} samples were not finite and count as black",
            film.dropped_samples()
        );
    }
    let hits = layers(&named.scene, args)?;
    for out in &args.out {
        write(film, &hits, out)?;
    }
    progress.checkpoint.remove()
}

/// A picture on its way.
struct Progress {
    film: Film,
    /// Samples of each pixel that are in the film.
    samples_done: u32,
    checkpoint: Checkpoint,
}

impl Progress {
    /// From the start, or from where a render of the same picture was stopped.
    fn begin(scene: &Scene, args: &Args) -> Result<Self, Failure> {
        let period = Duration::from_secs(args.checkpoint_secs.into());
        let settings = args.settings(0, args.spp);
        let out = &args.out[0].path;
        let mut checkpoint = Checkpoint::new(out, scene, args.size, settings, period);
        let resumed = checkpoint.resume()?;
        if let Some((_, samples)) = resumed {
            let path = checkpoint.path().display();
            eprintln!(
                "carom-farm: going on from {path}: {samples} of {} samples",
                args.spp
            );
        }
        let (film, samples_done) = resumed.unwrap_or_else(|| (Film::new(args.size), 0));
        Ok(Self {
            film,
            samples_done,
            checkpoint,
        })
    }

    fn add(&mut self, frame: &Frame, samples: u32) -> Result<(), Failure> {
        add(&mut self.film, frame, samples)?;
        self.samples_done += samples;
        self.checkpoint.offer(&self.film, self.samples_done)
    }
}

impl Args {
    /// With what the preset stands for.
    fn with_preset(&self) -> Self {
        let args = self.clone();
        let Some(preset) = self.preset else {
            return args;
        };
        let settings = preset.settings();
        Self {
            size: self.size.scaled(preset.scale()),
            spp: settings.samples,
            denoise: settings.denoise,
            ..args
        }
    }

    fn settings(&self, first_sample: u32, samples: u32) -> RenderSettings {
        RenderSettings {
            samples,
            first_sample,
            scatterings_max: self.scatterings,
            seed: self.seed,
            denoise: self.denoise,
        }
    }
}

/// What camera rays meet first, if a picture has layers: a matter of moments, which this machine's
/// processor can spare.
fn layers(scene: &Scene, args: &Args) -> Result<Vec<Layers>, Failure> {
    if args.out.iter().all(|out| out.format == Format::Png) {
        return Ok(Vec::new());
    }
    let ImageSize { width, height } = args.size;
    // Row by row, so that they come together without being moved.
    let rows: Vec<Tile> = (0..height)
        .map(|y| Tile {
            x: 0,
            y,
            width,
            height: 1,
        })
        .collect();
    let job = TraceJob {
        size: args.size,
        tiles: &rows,
        settings: args.settings(0, args.spp.min(LAYER_SAMPLES_MAX)),
        cancelled: &AtomicBool::new(false),
    };
    let hits = Mutex::new(vec![Vec::new(); rows.len()]);
    let scene = CompiledScene::new(scene)?;
    CpuTracer::new()?.layers(&scene, &job, &|row| {
        let mut hits = hits.lock().unwrap_or_else(PoisonError::into_inner);
        hits[row.index] = row.pixels;
    })?;
    let hits = hits.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(hits.concat())
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
    if let Some(balancer) = args.balancer {
        config.balancer = balancer;
    }
    if config.local == LocalNode::None && config.nodes.is_empty() {
        return Err(Failure::Input(
            "there is no node to trace with: give --node HOST:PORT or another --backend".into(),
        ));
    }
    Ok(config)
}

/// Submits the picture's frames, as many at a time as the farm takes, and merges them.
fn trace(
    farm: &mut Farm,
    args: &Args,
    progress: &mut Progress,
    interrupted: &AtomicBool,
) -> Result<(), Failure> {
    let mut waiting = batches(args.size, args.spp, args.denoise);
    waiting.retain(|batch| batch.first_sample >= progress.samples_done);
    let mut in_flight = VecDeque::new();
    let bar = progress_bar(args.spp);
    bar.set_position(progress.samples_done.into());
    bar.reset_eta();
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
            progress.add(&frame, samples)?;
            bar.inc(u64::from(samples));
            quiet_since = Instant::now();
        } else if interrupted.load(Ordering::Relaxed) {
            return Err(Failure::Interrupted);
        } else if quiet_since.elapsed() > NODES_PATIENCE {
            give_up_without_nodes(farm)?;
        }
    }
    bar.finish_and_clear();
    Ok(())
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
            settings: args.settings(self.first_sample, self.samples),
            format: PixelFormat::LinearF32,
        }
    }
}

/// Of frames that are denoised there are as few as can be: the filter does more with more samples.
fn batches(size: ImageSize, spp: u32, denoise: bool) -> VecDeque<Batch> {
    let fewest = FRAME_SAMPLES_MIN.div_ceil(size.pixels());
    let most = (FRAME_SAMPLES_MAX / size.pixels()).max(1);
    let frames = if denoise { 1 } else { FRAMES };
    let samples = (spp.div_ceil(frames) as usize).max(fewest).min(most) as u32;
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
            NodeState::Lost { why, .. } => reasons.push(format!("{}: {why}", node.address)),
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
fn write(film: &Film, hits: &[Layers], out: &Output) -> Result<(), Failure> {
    let partial = out.path.with_extension("partial");
    let image = film.image();
    match out.format {
        Format::Exr => image.write_exr_layers(&partial, hits)?,
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
                let mut next;
                for denoise in [false, true] {
                    next = 0;
                    for batch in batches(ImageSize::new(width, height), spp, denoise) {
                        assert_eq!(batch.first_sample, next);
                        assert!(batch.samples > 0);
                        next += batch.samples;
                    }
                    assert_eq!(next, spp);
                }
            }
        }
    }
}
