//! `carom-farm render`: one picture by the whole farm, without the game.

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::Context;
use carom_farm::net::{self, NodeAddress};
use carom_farm::{Balancing, Distribution, Farm, FarmConfig, LocalNode, Still};
use carom_tracer::film::Film;
use carom_tracer::{Aovs, ImageSize, Preset, RenderSettings, Scene, SceneUpdate};
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
    /// Maximum path depth: surface scattering events per path.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(0..=64))]
    max_depth: u32,
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
    /// What is divided: tiles, or samples, of which each node then traces others of the whole picture
    /// [default: tiles, or --config's]. Samples cost the bytes of the picture once for each node.
    #[arg(long, value_name = "WHAT")]
    distribution: Option<Distribution>,
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

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    let args = &args.with_preset();
    let named = inputs::scene(args.scene.as_deref())?;
    let mut farm = Farm::new(config(args)?)?;
    farm.set_scene(&named.scene)?;
    let interrupted = net::interruption().context("Ctrl-C")?;
    let mut progress = Progress::begin(&named.scene, args)?;
    let still = args.still();
    let traced = progress.trace(&mut farm, &still, &mut || {
        interrupted.load(Ordering::Relaxed)
    });
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
    let layered = args.out.iter().any(|out| out.format == Format::Exr);
    let hits = if layered {
        still.aovs(&named.scene)?
    } else {
        Vec::new()
    };
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
        let settings = args.still().settings;
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

    /// Traces what the film lacks, with a bar.
    fn trace(
        &mut self,
        farm: &mut Farm,
        still: &Still,
        interrupted: &mut dyn FnMut() -> bool,
    ) -> Result<(), Failure> {
        let bar = progress_bar(still.settings.samples);
        bar.set_position(self.samples_done.into());
        bar.reset_eta();
        let from = self.samples_done;
        let (checkpoint, samples_done) = (&mut self.checkpoint, &mut self.samples_done);
        let mut watch = |film: &Film, done: u32| {
            if done > *samples_done {
                *samples_done = done;
                bar.set_position(done.into());
                checkpoint.offer(film, done)?;
            }
            if interrupted() {
                return Err(Failure::Interrupted);
            }
            Ok(())
        };
        still.trace(farm, &mut self.film, from, &mut watch)?;
        bar.finish_and_clear();
        Ok(())
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

    fn still(&self) -> Still {
        Still {
            update: SceneUpdate::default(),
            size: self.size,
            settings: RenderSettings {
                samples: self.spp,
                first_sample: 0,
                max_depth: self.max_depth,
                seed: self.seed,
                denoise: self.denoise,
            },
        }
    }
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
    if let Some(distribution) = args.distribution {
        config.distribution = distribution;
    }
    if config.local == LocalNode::None && config.nodes.is_empty() {
        return Err(Failure::Input(
            "there is no node to trace with: give --node HOST:PORT or another --backend".into(),
        ));
    }
    Ok(config)
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
fn write(film: &Film, hits: &[Aovs], out: &Output) -> Result<(), Failure> {
    let partial = out.path.with_extension("partial");
    let image = film.image();
    match out.format {
        Format::Exr => image.write_exr_with_aovs(&partial, hits)?,
        Format::Png => image.write_png(&partial, 1.0)?,
    }
    std::fs::rename(&partial, &out.path)
        .with_context(|| out.path.display().to_string())
        .map_err(Failure::Run)
}
