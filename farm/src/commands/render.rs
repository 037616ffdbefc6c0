//! `carom-farm render`: one picture, traced by the whole farm without the game.

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::Context;
use carom_farm::net;
use carom_farm::{
    AccumulatedRender, Balancing, Distribution, Farm, FarmConfig, FrameSpec, LocalNode,
    PixelFormat, Priority, trace_aovs,
};
use carom_tracer::film::Film;
use carom_tracer::{ImageSize, Preset, RenderSettings, Scene, SceneUpdate};
use indicatif::{ProgressBar, ProgressStyle};

use crate::commands::Failure;
use crate::commands::checkpoint::Checkpoint;
use crate::commands::inputs::{self, PictureFile, PictureFormat};
use crate::commands::output_file::OutputFile;

/// Trace a picture on this machine, on nodes, or on both
#[derive(Clone, clap::Args)]
pub(crate) struct RenderArgs {
    /// Trace this scene file [default: the built-in pool table]
    #[arg(long)]
    scene: Option<PathBuf>,
    /// Set the picture's size in pixels
    #[arg(long, default_value = "1280x720", value_name = "WIDTHxHEIGHT")]
    size: ImageSize,
    /// Choose a quality preset in place of --spp and --denoise: draft, low, medium, high, final or
    /// reference
    ///
    /// The first three render a quarter, half and three quarters of --size along each edge; `bench
    /// tradeoff` measures the time and error of each.
    #[arg(long, conflicts_with_all = ["spp", "denoise"])]
    preset: Option<Preset>,
    /// Trace this many samples per pixel; error falls with their square root or faster
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    spp: u32,
    /// Limit paths to this many surface scattering events
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(0..=64))]
    max_depth: u32,
    /// Seed the random numbers
    #[arg(long, default_value_t = 0)]
    seed: u32,
    /// Use this node, in place of those in --config; repeat for several
    ///
    /// dns:HOST:PORT uses a node at each address of the host, file:PATH one in each line of a file.
    #[arg(long, value_name = "HOST:PORT", value_parser = inputs::node)]
    node: Vec<String>,
    /// Read the farm's credentials from this folder, which `init` created [default: .carom, or as
    /// in --config]
    #[arg(long)]
    credentials: Option<PathBuf>,
    /// Read the farm's configuration from this file, usually named farm.toml
    #[arg(long)]
    config: Option<PathBuf>,
    /// Choose this machine's devices: auto (all GPUs that pass the self-test, plus the CPU), cpu,
    /// gpu or none [default: auto, or as in --config]
    #[arg(long)]
    backend: Option<LocalNode>,
    /// Divide the picture among nodes with this balancer, named as in the configuration [default:
    /// water_filling_hedged, or as in --config]
    #[arg(long, value_name = "NAME")]
    balancer: Option<Balancing>,
    /// Divide the picture by tiles, or by samples of the whole picture, which costs the bytes of
    /// one picture per node [default: tiles, or as in --config]
    #[arg(long, value_name = "tiles|samples")]
    distribution: Option<Distribution>,
    /// Give up when no node has answered for this many seconds; 0 waits for ever [default: 10 if
    /// none is connected and 60 if one may still be starting, or as in --config]
    #[arg(long)]
    timeout_secs: Option<u32>,
    /// Denoise, guided by albedo, normal and depth: 4 samples then look like 16 or more
    #[arg(long)]
    denoise: bool,
    /// Write the picture to a .png (8-bit sRGB) or .exr (32-bit linear, with albedo, normal and
    /// depth layers) file; repeat for several
    ///
    /// While the render runs, `<OUT>.checkpoint` lies beside the first file; after a crash the same
    /// command resumes from it.
    #[arg(long, required = true)]
    out: Vec<PictureFile>,
    /// Write a checkpoint at most every this many seconds; fewer lose less to a crash and write 32
    /// bytes a pixel more often
    #[arg(long, default_value_t = 30)]
    checkpoint_secs: u32,
}

pub(crate) fn run(args: &RenderArgs) -> Result<(), Failure> {
    let args = &args.with_preset();
    let named = inputs::scene(args.scene.as_deref())?;
    let config = config(args)?;
    let outputs: Vec<OutputFile> = args
        .out
        .iter()
        .map(OutputFile::claim)
        .collect::<Result<_, _>>()?;
    let mut farm = Farm::new(config)?;
    farm.set_scene(&named.scene)?;
    let interrupted = net::interruption().context("Ctrl-C")?;
    let mut progress = RenderProgress::resume(&named.scene, args)?;
    let spec = args.frame_spec();
    let traced = progress.trace(&mut farm, &spec, &mut || {
        interrupted.load(Ordering::Relaxed)
    });
    drop(farm);
    if matches!(traced, Err(Failure::Interrupted)) && progress.samples_done > 0 {
        progress.checkpoint.write(&progress.film)?;
        let path = progress.checkpoint.path().display();
        eprintln!("carom-farm: run the same command again to resume from {path}");
    }
    traced?;
    let film = &progress.film;
    if film.dropped_samples() > 0 {
        eprintln!(
            "carom-farm: {} samples were not finite and were counted as black",
            film.dropped_samples()
        );
    }
    let layered = outputs.iter().any(|out| out.format() == PictureFormat::Exr);
    let hits = if layered {
        trace_aovs(&named.scene, &spec)?
    } else {
        Vec::new()
    };
    if let Err(why) = outputs.iter().try_for_each(|out| out.write(film, &hits)) {
        drop(outputs); // the room that they take is needed
        let path = progress.checkpoint.rescue(&progress.film)?;
        eprintln!(
            "carom-farm: what was traced is kept in {}; as {} the same command resumes from it",
            path.display(),
            progress.checkpoint.path().display()
        );
        return Err(why);
    }
    progress.checkpoint.remove()
}

/// A picture that is being traced.
struct RenderProgress {
    film: Film,
    /// Samples of each pixel that are in the film.
    samples_done: u32,
    checkpoint: Checkpoint,
}

impl RenderProgress {
    /// Starts from the checkpoint of the same picture if there is one.
    fn resume(scene: &Scene, args: &RenderArgs) -> Result<Self, Failure> {
        let period = Duration::from_secs(args.checkpoint_secs.into());
        let settings = args.frame_spec().settings;
        let out = &args.out[0].path;
        let mut checkpoint = Checkpoint::new(out, scene, args.size, settings, period);
        let resumed = checkpoint.resume()?;
        if let Some((_, samples)) = resumed {
            let path = checkpoint.path().display();
            eprintln!(
                "carom-farm: resuming from {path} with {samples} of {} samples",
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

    /// Traces the samples that the film lacks, with a progress bar.
    fn trace(
        &mut self,
        farm: &mut Farm,
        spec: &FrameSpec,
        interrupted: &mut dyn FnMut() -> bool,
    ) -> Result<(), Failure> {
        let bar = progress_bar(spec.settings.samples);
        bar.set_position(self.samples_done.into());
        bar.reset_eta();
        let render = AccumulatedRender::new(spec.clone(), Priority::Interactive);
        let mut render = render.resume(self.samples_done);
        let (checkpoint, samples_done) = (&mut self.checkpoint, &mut self.samples_done);
        let mut watch = |film: &Film, done: u32| {
            if done > *samples_done {
                *samples_done = done;
                bar.set_position(done.into());
                checkpoint.offer(film, done);
            }
            if interrupted() {
                return Err(Failure::Interrupted);
            }
            Ok(())
        };
        render.finish(farm, &mut self.film, &mut watch)?;
        bar.finish_and_clear();
        Ok(())
    }
}

impl RenderArgs {
    /// The arguments with the preset's values.
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

    fn frame_spec(&self) -> FrameSpec {
        FrameSpec {
            update: SceneUpdate::default(),
            size: self.size,
            settings: RenderSettings {
                samples: self.spp,
                first_sample: 0,
                max_depth: self.max_depth,
                seed: self.seed,
                denoise: self.denoise,
            },
            format: PixelFormat::LinearF32,
        }
    }
}

fn config(args: &RenderArgs) -> Result<FarmConfig, Failure> {
    let mut config = match &args.config {
        Some(path) => FarmConfig::load(path)?,
        None => FarmConfig::default(),
    };
    if !args.node.is_empty() {
        config.nodes.clone_from(&args.node);
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
    config.timeout_secs = args.timeout_secs.or(config.timeout_secs);
    if config.local == LocalNode::None && config.nodes.is_empty() {
        return Err(Failure::Input(
            "no renderer configured: --backend none disables this machine and no --node is given"
                .into(),
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
