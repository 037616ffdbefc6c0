//! Carom without a window: a shot through the farm into files.
//!
//! ```text
//! rack, stroke ─┐
//! recording ────┴▶ ShotSequence ─▶ Farm (several frames in flight) ─▶ FrameCache: frame_0000.png …
//!                                                                 ├─▶ a film, or break.png
//!                                                                 └─▶ stats.json
//! ```

use std::collections::VecDeque;
use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use carom_billiards::physics::{Engine, Recording, Shot, Stroke, Table, World};
use carom_farm::{
    Farm, FarmConfig, Frame, FrameSpec, FrameStats, NodeState, NodeStatus, PixelFormat, Pixels,
    PrecisionRange, net,
};
use carom_tracer::{ImageSize, RenderSettings};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use crate::args::Args;
use crate::capture::video::{
    FrameCache, FrameRange, RenderJob, ShotSequence, VideoTarget, assemble,
};
use crate::play::CUE_SPEED_M_S_MAX;
use crate::scene::scene_builder::EXPOSURE;
use crate::scene::table_scene::TableScene;

/// What `stats.json` holds.
#[derive(Debug, Serialize)]
struct HeadlessReport {
    settings: ReportSettings,
    nodes: Vec<ReportNode>,
    /// Those that this run traced.
    frames: Vec<FrameReport>,
    totals: ReportTotals,
}

/// How the frames were asked for.
#[derive(Clone, Copy, Debug, Serialize)]
struct ReportSettings {
    width: u32,
    height: u32,
    samples: u32,
    max_depth: u32,
    seed: u32,
    denoise: bool,
    frames: u32,
    frames_per_sec: u16,
}

/// A node as the farm saw it at the end.
#[derive(Debug, Serialize)]
struct ReportNode {
    address: String,
    device: Option<String>,
    tiles: u64,
    fixed_secs: f64,
    msamples_per_sec: f64,
    lost: Option<String>,
}

/// One frame.
#[derive(Debug, Serialize)]
struct FrameReport {
    index: u32,
    /// Of the shots on show.
    shot: usize,
    /// The moment of the shot, seconds since the stroke.
    moment_secs: f64,
    #[serde(flatten)]
    stats: FrameStats,
}

/// All frames together.
#[derive(Debug, Default, Serialize)]
struct ReportTotals {
    wall_secs: f64,
    msamples_per_sec: f64,
    payload_bytes: u64,
    reissued_tiles: u64,
    duplicate_tiles: u64,
    dropped_samples: u64,
    tiles_by_node: Vec<u64>,
}

/// Renders the shot that `args` describe: a recorded one, or a break.
///
/// # Errors
/// A sentence: a folder that cannot be written or holds an unfinished film of another kind, a farm
/// that cannot be built or does not answer, an interruption and how to go on.
pub fn run(args: &Args, config: FarmConfig) -> anyhow::Result<()> {
    let footage = footage(args)?;
    let settings = settings(args, &footage);
    let target = match &args.video {
        Some(target) => target.clone(),
        None => VideoTarget::Folder(args.out.clone()),
    };
    let job = RenderJob::of(&footage, settings.size(), settings.render())?;
    let range = args
        .frame_range
        .map(|range| range.of_film(footage.frames()));
    let range = range.transpose()?;
    let mut reel = FrameCache::open_range(
        &target.reel(),
        job,
        settings.size(),
        range.unwrap_or(FrameRange::ALL),
    )?;
    let interrupted = net::interruption().context("Ctrl-C")?;
    let before = reel.kept();
    let report = match make(config, &footage, settings, &mut reel, &interrupted) {
        Ok(report) => report,
        // The same command ends the same way where it had not begun to render.
        Err(error) if reel.kept() > before || interrupted.load(Ordering::Relaxed) => {
            return Err(error.context(going_on(&reel)));
        }
        Err(error) => {
            if before == 0 && range.is_none() {
                // Nothing has begun; what cannot be removed does no harm.
                let _ = reel.remove();
            }
            return Err(error);
        }
    };
    if let Some(range) = range {
        let folder = reel.folder().display();
        println!("{folder} holds frames {range} of {}", reel.frames());
        return Ok(());
    }
    let proceed = &mut || proceed(&interrupted);
    let film = match &args.video {
        Some(target) => target.clone(),
        None => VideoTarget::Apng(args.out.join("break.png")),
    };
    assemble(&reel, &film, settings.frames_per_sec, proceed).with_context(|| going_on(&reel))?;
    reel.finish()?;
    if let VideoTarget::Folder(folder) = &target {
        write_report(&report, &folder.join("stats.json"))?;
    } else {
        reel.remove()?;
    }
    println!("{}", done(settings, &target, &film));
    Ok(())
}

/// What was made, and where it is.
fn done(settings: ReportSettings, target: &VideoTarget, film: &VideoTarget) -> String {
    let ReportSettings {
        width,
        height,
        frames,
        ..
    } = settings;
    let path = target.path().display();
    let s = if frames == 1 { "" } else { "s" };
    let frames = format!("{frames} frame{s} of {width}x{height}");
    match target {
        VideoTarget::Folder(_) if target != film => {
            format!("{path} holds {frames}, break.png and stats.json")
        }
        VideoTarget::Folder(_) => format!("{path} holds {frames} and stats.json"),
        _ => format!("{path} holds {frames}"),
    }
}

fn going_on(reel: &FrameCache) -> String {
    format!(
        "{} of {} frames are saved in {}; run the same command again to continue",
        reel.kept(),
        reel.frames(),
        reel.folder().display()
    )
}

fn proceed(interrupted: &AtomicBool) -> anyhow::Result<()> {
    if interrupted.load(Ordering::Relaxed) {
        bail!("interrupted");
    }
    Ok(())
}

fn footage(args: &Args) -> anyhow::Result<ShotSequence> {
    let (table, recording) = args.table_and_recording()?;
    let recording = match recording {
        Some(recording) => recording,
        None => Recording::of(
            &table,
            "A break",
            break_shot(&table, args.seed, args.physics.unwrap_or_default())?,
        ),
    };
    if let Some(folder) = &args.record {
        keep(&recording, folder)?;
    }
    let mut shots: Vec<Shot> = recording.clips.into_iter().map(|take| take.shot).collect();
    let stage = TableScene::around(&table, args.style());
    let (view, rate) = (args.view, args.fps);
    if args.video.is_none() {
        let frames = args.frames.unwrap_or(FRAMES);
        return Ok(ShotSequence::impact(
            stage,
            shots.swap_remove(0),
            view,
            rate,
            frames,
        ));
    }
    let film = ShotSequence::whole(stage, shots, view, rate);
    Ok(film.cut(args.frames.unwrap_or(u32::MAX)))
}

fn settings(args: &Args, footage: &ShotSequence) -> ReportSettings {
    let (size, samples) = if args.video.is_some() {
        (ImageSize::new(1280, 720), 64)
    } else {
        (ImageSize::new(640, 360), 16)
    };
    let size = args.size.unwrap_or(size);
    ReportSettings {
        width: size.width,
        height: size.height,
        samples: args.spp.unwrap_or(samples),
        max_depth: args.style().balls.max_depth(),
        seed: args.seed,
        denoise: args.denoise,
        frames: footage.frames(),
        frames_per_sec: footage.frames_per_sec(),
    }
}

impl ReportSettings {
    fn size(&self) -> ImageSize {
        ImageSize::new(self.width, self.height)
    }

    fn render(&self) -> RenderSettings {
        RenderSettings {
            samples: self.samples,
            first_sample: 0,
            max_depth: self.max_depth,
            seed: self.seed,
            denoise: self.denoise,
        }
    }
}

/// A hard, straight break.
fn break_shot(table: &Table, seed: u32, engine: Engine) -> anyhow::Result<Shot> {
    let mut world = World::new(table.clone(), table.rack_eight(seed))?;
    world.set_engine(engine);
    Ok(world.strike(Stroke::straight(0.0, CUE_SPEED_M_S_MAX))?)
}

fn keep(recording: &Recording, folder: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    Ok(recording.save(&folder.join("shot_0001.carom"))?)
}

/// Traces the frames that the cache lacks.
fn make(
    config: FarmConfig,
    footage: &ShotSequence,
    settings: ReportSettings,
    reel: &mut FrameCache,
    interrupted: &AtomicBool,
) -> anyhow::Result<HeadlessReport> {
    // Files are kept: a link that is too slow for exact pixels makes them later, not worse.
    let mut farm = Farm::new(FarmConfig {
        precision: PrecisionRange::EXACT,
        ..config
    })?;
    farm.set_scene(footage.stage().scene())?;
    let begun = Instant::now();
    let frames = render(&mut farm, footage, settings, reel, interrupted)?;
    Ok(HeadlessReport {
        totals: totals(&frames, settings, begun.elapsed()),
        nodes: farm.nodes().into_iter().map(node).collect(),
        settings,
        frames,
    })
}

/// Has the missing frames traced, as many at a time as the farm takes, keeping each as it is finished.
fn render(
    farm: &mut Farm,
    footage: &ShotSequence,
    settings: ReportSettings,
    reel: &mut FrameCache,
    interrupted: &AtomicBool,
) -> anyhow::Result<Vec<FrameReport>> {
    let mut waiting: VecDeque<u32> = reel.missing().collect();
    let bar = progress_bar(reel.kept() + waiting.len() as u32);
    if reel.kept() > 0 {
        eprintln!("Resuming: {}", going_on(reel));
        bar.set_position(reel.kept().into());
        bar.reset_eta();
    }
    let mut in_flight = VecDeque::new();
    let mut frames: Vec<FrameReport> = Vec::new();
    while !(waiting.is_empty() && in_flight.is_empty()) {
        while let Some(&index) = waiting.front() {
            match farm.submit(spec(footage, index, settings)) {
                Ok(_) => in_flight.extend(waiting.pop_front()),
                Err(carom_farm::Error::FramesInFlight { .. }) => break,
                Err(error) => return Err(error.into()),
            }
        }
        let frame = loop {
            proceed(interrupted)?;
            match farm.wait_frame(POLL_INTERVAL) {
                Some(frame) => break frame,
                None => farm.check_nodes()?,
            }
        };
        let Some(index) = in_flight.pop_front() else {
            bail!("the farm delivered a frame that was not requested");
        };
        reel.keep(index, bytes(&frame)?)?;
        bar.inc(1);
        let (shot, moment_secs) = footage.moment(index);
        frames.push(FrameReport {
            index,
            shot,
            moment_secs,
            stats: frame.stats,
        });
    }
    bar.finish_and_clear();
    Ok(frames)
}

fn spec(footage: &ShotSequence, index: u32, settings: ReportSettings) -> FrameSpec {
    FrameSpec {
        update: footage.update(index),
        size: settings.size(),
        settings: settings.render(),
        format: PixelFormat::Srgb8 { exposure: EXPOSURE },
    }
}

fn bytes(frame: &Frame) -> anyhow::Result<&[u8]> {
    match &frame.pixels {
        Pixels::Srgb8(rgb) => Ok(bytemuck::cast_slice(rgb)),
        Pixels::Linear(_) => bail!("the farm sent radiance where colours were asked for"),
    }
}

fn totals(frames: &[FrameReport], settings: ReportSettings, wall: Duration) -> ReportTotals {
    let mut totals = ReportTotals::default();
    for FrameReport { stats, .. } in frames {
        totals.payload_bytes += stats.payload_bytes;
        totals.reissued_tiles += u64::from(stats.reissued_tiles);
        totals.duplicate_tiles += u64::from(stats.duplicate_tiles);
        totals.dropped_samples += stats.dropped_samples;
        let nodes = totals.tiles_by_node.len().max(stats.tiles_by_node.len());
        totals.tiles_by_node.resize(nodes, 0);
        for (sum, tiles) in totals.tiles_by_node.iter_mut().zip(&stats.tiles_by_node) {
            *sum += u64::from(*tiles);
        }
    }
    let pixels = ImageSize::new(settings.width, settings.height).pixels() as f64;
    let samples = pixels * f64::from(settings.samples) * frames.len() as f64;
    totals.wall_secs = wall.as_secs_f64();
    totals.msamples_per_sec = samples / totals.wall_secs / 1e6;
    totals
}

fn node(status: NodeStatus) -> ReportNode {
    ReportNode {
        address: status.address,
        device: status.info.map(|info| info.device.name),
        tiles: status.tiles,
        fixed_secs: status.fixed_secs,
        msamples_per_sec: status.msamples_per_sec,
        lost: match status.state {
            NodeState::Lost { why, .. } => Some(why),
            _ => None,
        },
    }
}

fn write_report(report: &HeadlessReport, path: &Path) -> anyhow::Result<()> {
    let write = || -> anyhow::Result<()> {
        let mut file = BufWriter::new(File::create(path)?);
        serde_json::to_writer_pretty(&mut file, report)?;
        writeln!(file)?;
        file.flush()?;
        Ok(())
    };
    write().with_context(|| format!("cannot write {}", path.display()))
}

fn progress_bar(frames: u32) -> ProgressBar {
    let template = "{bar:40} {pos}/{len} frames, {per_sec}, {eta} left";
    let style =
        ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(u64::from(frames)).with_style(style)
}

/// Of a break, where no number is given.
const FRAMES: u32 = 48;
/// How long to wait for a frame before looking at nodes and interruptions.
const POLL_INTERVAL: Duration = Duration::from_millis(200);
