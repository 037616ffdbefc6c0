//! `carom-farm render`: a picture, or the frames of an animation, traced by the whole farm.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context;
use carom_farm::net;
use carom_farm::{
    Balancing, Distribution, Farm, FarmConfig, FileFormat, LocalNode, NodeState, NodeStatus,
    Picture, Still, StillJob,
};
use carom_tracer::{ImageSize, Preset, Scene, SceneUpdate};
use indicatif::{ProgressBar, ProgressStyle};

use crate::commands::Failure;
use crate::commands::animation_frames::{AnimationArgs, Frames};
use crate::commands::inputs::{self, PictureFile};
use crate::commands::output_file::OutputFile;
use crate::commands::render_summary::{FrameTotals, RenderSummary};

/// Trace a picture or the frames of an animation on this machine, on nodes, or on both
#[derive(Clone, clap::Args)]
pub(crate) struct RenderArgs {
    /// Trace this scene file: JSON, glTF, or a mesh as .obj or .ply [default: the built-in pool table]
    #[arg(long)]
    scene: Option<PathBuf>,
    #[command(flatten)]
    animation: AnimationArgs,
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
    /// Read the farm's configuration from this file [default: farm.toml in this folder, if it exists]
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
    /// Write the picture to a .png or .jpg (8-bit sRGB) or .exr (32-bit linear, with albedo, normal
    /// and depth layers) file, in place of one of this name; repeat for several
    ///
    /// While the render runs, `<OUT>.checkpoint` lies beside the first file; after a crash the same
    /// command resumes from it.
    #[arg(long, required = true)]
    out: Vec<PictureFile>,
    /// Print what it has cost as JSON on standard output: time, bytes, tiles of each node
    #[arg(long)]
    json: bool,
    /// Write a checkpoint at most every this many seconds; fewer lose less to a crash and write 32
    /// bytes a pixel more often
    #[arg(long, default_value_t = 30)]
    checkpoint_secs: u32,
}

pub(crate) fn run(args: &RenderArgs) -> Result<(), Failure> {
    let args = &args.with_preset();
    let mut frames = Frames::open(&args.animation, args.scene.as_deref())?;
    let config = config(args)?;
    let mut numbers = frames.numbers();
    let mut number = numbers.next().flatten();
    // Claimed first, so that faults of the first files are reported before the farm starts.
    let mut outputs = claim(args, number)?;
    let mut farm = Farm::new(config)?;
    let interrupted = net::interruption().context("Ctrl-C")?;
    loop {
        let (scene, update) = frames.scene(number)?;
        let shown = FrameScene {
            scene: &scene,
            update,
        };
        render(args, &mut farm, shown, outputs, &interrupted)?;
        match numbers.next() {
            Some(next) => number = next,
            None => return Ok(()),
        }
        outputs = claim(args, number)?;
    }
}

/// A scene and its update for one frame.
struct FrameScene<'a> {
    scene: &'a Scene,
    update: SceneUpdate,
}

/// Claims the output files of a frame.
fn claim(args: &RenderArgs, number: Option<u32>) -> Result<Vec<OutputFile>, Failure> {
    let files = args.animation.outputs(&args.out, number)?;
    files.iter().map(OutputFile::claim).collect()
}

/// Traces a frame and writes its files.
fn render(
    args: &RenderArgs,
    farm: &mut Farm,
    shown: FrameScene<'_>,
    outputs: Vec<OutputFile>,
    interrupted: &AtomicBool,
) -> Result<(), Failure> {
    let checkpoint = checkpoint_path(outputs[0].path());
    let layered = outputs.iter().any(|out| out.format() == FileFormat::Exr);
    let still = args.still(&checkpoint, layered).update(shown.update);
    let (picture, summary) = trace(args, farm, shown.scene, still, &checkpoint, interrupted)?;
    if picture.dropped_samples() > 0 {
        eprintln!(
            "carom-farm: {} samples were not finite and were counted as black",
            picture.dropped_samples()
        );
    }
    // On failure, dropping the outputs frees their disk space for the rescued checkpoint.
    let mut outputs = outputs.into_iter();
    if let Err(why) = outputs.try_for_each(|out| out.write(&picture)) {
        drop(outputs);
        if let Some(path) = picture.rescue()? {
            eprintln!(
                "carom-farm: what was traced is kept in {}; as {} the same command resumes from it",
                path.display(),
                checkpoint.display()
            );
        }
        return Err(why);
    }
    picture.remove_checkpoint()?;
    match args.json {
        true => println!(
            "{}",
            serde_json::to_string(&summary).context("the summary")?
        ),
        false => eprintln!("carom-farm: {}", summary.lines()),
    }
    Ok(())
}

/// Traces a picture and summarises its cost.
fn trace(
    args: &RenderArgs,
    farm: &mut Farm,
    scene: &Scene,
    still: Still,
    checkpoint: &Path,
    interrupted: &AtomicBool,
) -> Result<(Picture, RenderSummary), Failure> {
    let totals = FrameTotals::default();
    let counted = totals.clone();
    let still = still.on_progress(move |progress| counted.count(progress));
    let begun = Instant::now();
    let job = farm.still(scene, still)?;
    if job.resumed_samples() > 0 {
        eprintln!(
            "carom-farm: resuming from {} with {} of {} samples",
            checkpoint.display(),
            job.resumed_samples(),
            args.spp
        );
    }
    let traced = wait(farm, job, args.spp, &totals, interrupted);
    let summary = totals.summary(begun.elapsed(), &farm.nodes());
    if traced.is_err() && checkpoint.exists() {
        let path = checkpoint.display();
        eprintln!("carom-farm: run the same command again to resume from {path}");
    }
    match traced {
        Ok(picture) => Ok((picture, summary)),
        Err(carom_farm::Error::Cancelled { .. }) => Err(Failure::Interrupted),
        Err(error) => Err(error.into()),
    }
}

/// Waits for the picture, showing a progress bar.
fn wait(
    farm: &Farm,
    job: StillJob,
    samples: u32,
    totals: &FrameTotals,
    interrupted: &AtomicBool,
) -> Result<Picture, carom_farm::Error> {
    let bar = progress_bar(samples);
    bar.set_position(job.resumed_samples().into());
    bar.reset_eta();
    while !job.is_finished() {
        bar.set_position(job.progress().samples_done.into());
        let nodes = farm.nodes();
        totals.observe(&nodes);
        bar.set_message(sending(&nodes));
        if interrupted.load(Ordering::Relaxed) {
            job.cancel();
        }
        std::thread::sleep(REFRESH_INTERVAL);
    }
    let picture = job.wait()?;
    bar.finish_and_clear();
    Ok(picture)
}

/// The progress of nodes that are being sent a long scene, to be appended to a line.
fn sending(nodes: &[NodeStatus]) -> String {
    let sentences = nodes.iter().filter_map(|node| match &node.state {
        NodeState::Syncing { of: 1.., .. } => {
            Some(format!("; {} {}", node.address, node.state.sentence()))
        }
        _ => None,
    });
    sentences.collect()
}

/// The checkpoint file of a render, beside its first output.
fn checkpoint_path(out: &Path) -> PathBuf {
    let mut path = out.as_os_str().to_owned();
    path.push(".checkpoint");
    path.into()
}

impl RenderArgs {
    /// The arguments with a preset, if there is one, replaced by its values.
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

    fn still(&self, checkpoint: &Path, layered: bool) -> Still {
        let still = Still::new(self.size.width, self.size.height)
            .samples(self.spp)
            .max_depth(self.max_depth)
            .seed(self.seed)
            .checkpoint(checkpoint, Duration::from_secs(self.checkpoint_secs.into()));
        let still = if self.denoise { still.denoise() } else { still };
        if layered { still.layers() } else { still }
    }
}

fn config(args: &RenderArgs) -> Result<FarmConfig, Failure> {
    let mut config = match &args.config {
        Some(path) => FarmConfig::load(path)?,
        None => FarmConfig::discover()?,
    };
    if !args.node.is_empty() {
        config.nodes.clone_from(&args.node);
    }
    if let Some(folder) = &args.credentials {
        config.credentials.clone_from(folder);
    }
    config.local = args.backend.unwrap_or(config.local);
    config.balancer = args.balancer.unwrap_or(config.balancer);
    config.distribution = args.distribution.unwrap_or(config.distribution);
    config.timeout_secs = args.timeout_secs.or(config.timeout_secs);
    if config.local == LocalNode::None && config.nodes.is_empty() {
        return Err(Failure::Input(
            "no renderer configured: --backend none (or `local` in the configuration) disables this \
             machine, and no node is given. Add --node HOST:PORT, or use --backend auto"
                .into(),
        ));
    }
    Ok(config)
}

/// A progress bar, drawn on standard error if that is a terminal.
fn progress_bar(spp: u32) -> ProgressBar {
    let style = ProgressStyle::with_template(
        "{elapsed_precise} [{bar:40}] {pos}/{len} samples per pixel, {eta} left{msg}",
    );
    ProgressBar::new(u64::from(spp))
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// Period of updating the progress bar and of checking for Ctrl-C.
const REFRESH_INTERVAL: Duration = Duration::from_millis(50);
