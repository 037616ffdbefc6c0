//! Rendering without a window: a shot is traced by the farm and written to files.
//!
//! ```text
//! rack, stroke ─┐
//! recording ────┴▶ ShotSequence ─▶ Farm::film ─▶ FilmFrames: frame_0000.png …
//!                                            ├─▶ a film, or break.png
//!                                            └─▶ stats.json
//! ```

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use carom_billiards::physics::{Engine, ParticlePrecision, Recording, Shot, Stroke, Table, World};
use carom_farm::{
    Farm, FarmConfig, Film, FilmFrames, FilmJob, FilmProgress, FrameRange, FrameStats, NodeState,
    NodeStatus, WholeFile, net,
};
use carom_tracer::{ImageSize, RenderSettings};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use crate::args::Args;
use crate::capture::video::{self, ShotSequence, VideoTarget};
use crate::capture::{RecordingKind, RecordingStore};
use crate::play::CUE_SPEED_M_S_MAX;
use crate::scene::scene_builder::EXPOSURE;
use crate::scene::table_scene::TableScene;
use crate::scene::table_style::TableStyle;

/// Contents of `stats.json`.
#[derive(Debug, Serialize)]
struct HeadlessReport {
    settings: ReportSettings,
    nodes: Vec<ReportNode>,
    /// The frames that this run traced.
    frames: Vec<FrameReport>,
    totals: ReportTotals,
}

/// Settings of the frames.
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

/// A node's status at the end.
#[derive(Debug, Serialize)]
struct ReportNode {
    address: String,
    device: Option<String>,
    tiles: u64,
    fixed_secs: f64,
    msamples_per_sec: f64,
    lost: Option<String>,
}

/// Statistics of one frame.
#[derive(Debug, Serialize)]
struct FrameReport {
    index: u32,
    /// Index of its shot in the sequence.
    shot: usize,
    /// Moment of the shot, seconds since the stroke.
    moment_secs: f64,
    #[serde(flatten)]
    stats: FrameStats,
}

/// Totals over all frames.
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
/// If the folder cannot be written or holds an unfinished film of another kind, if the farm cannot be built
/// or does not answer, or on an interruption; the message then says how to continue.
pub fn run(args: &Args, config: FarmConfig) -> anyhow::Result<()> {
    let footage = footage(args)?.sized(size(args));
    let settings = settings(args, &footage);
    let target = match &args.video {
        Some(target) => target.clone(),
        None => VideoTarget::Folder(args.out.clone()),
    };
    let interrupted = net::interruption().context("Ctrl-C")?;
    let range = args.frame_range;
    let film = match &args.video {
        Some(target) => target.clone(),
        None => VideoTarget::File(args.out.join("break.png")),
    };
    let report_file = claim(&target, &film, range.is_some())?;
    let (mut frames, report) = make(config, &footage, settings, range, &target, &interrupted)?;
    if let Some(range) = range {
        let (folder, count) = (frames.folder().display(), frames.frames());
        println!("{folder} holds frames {} of {count}", range.of_film(count)?);
        return Ok(());
    }
    let proceed = &mut || !interrupted.load(Ordering::Relaxed);
    let count = frames.frames();
    let sound = || footage.soundtrack();
    video::save(&frames, sound, settings.frames_per_sec, &film, proceed)
        .with_context(|| going_on(count, count, frames.folder()))?;
    frames.finish()?;
    match report_file {
        Some(file) => write_report(&report, file)?,
        None => frames.remove()?,
    }
    println!("{}", done(settings, &target, target != film));
    Ok(())
}

/// Message about the finished output and its path.
fn done(settings: ReportSettings, target: &VideoTarget, has_animation: bool) -> String {
    let ReportSettings {
        width,
        height,
        frames,
        ..
    } = settings;
    let path = target.path().display();
    let s = if frames == 1 { "" } else { "s" };
    let mut size = ImageSize::new(width, height);
    if let VideoTarget::Encoded(_, container) = target {
        size = container.size(size);
    }
    let frames = format!("{frames} frame{s} of {}x{}", size.width, size.height);
    match target {
        VideoTarget::Folder(_) if has_animation => {
            format!("{path} holds {frames}, break.png and stats.json")
        }
        VideoTarget::Folder(_) => format!("{path} holds {frames} and stats.json"),
        _ => format!("{path} holds {frames}"),
    }
}

fn going_on(kept: u32, frames: u32, folder: &Path) -> String {
    format!(
        "{kept} of {frames} frames are saved in {}; run the same command again to continue",
        folder.display()
    )
}

fn footage(args: &Args) -> anyhow::Result<ShotSequence> {
    let (table, recording) = args.table_and_recording()?;
    let recording = match (recording, args.trick) {
        (Some(recording), _) => recording,
        (None, Some(trick)) => {
            let (world, stroke) = trick.world(&table, ParticlePrecision::default())?;
            Recording::of(&table, "A trick table", world.strike(stroke)?)
        }
        (None, None) => Recording::of(
            &table,
            "A break",
            break_shot(&table, args.seed, args.physics.unwrap_or_default())?,
        ),
    };
    if let Some(folder) = &args.record {
        RecordingStore::at(folder.clone()).save(RecordingKind::Shot, &recording)?;
    }
    let mut shots: Vec<Shot> = recording.clips.into_iter().map(|take| take.shot).collect();
    let stage = TableScene::around(&table, args.style(TableStyle::default()));
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

fn size(args: &Args) -> ImageSize {
    let default = match args.video {
        Some(_) => ImageSize::new(1280, 720),
        None => ImageSize::new(640, 360),
    };
    args.size.unwrap_or(default)
}

fn settings(args: &Args, footage: &ShotSequence) -> ReportSettings {
    let (size, samples) = (size(args), if args.video.is_some() { 64 } else { 16 });
    ReportSettings {
        width: size.width,
        height: size.height,
        samples: args.spp.unwrap_or(samples),
        max_depth: args.style(TableStyle::default()).balls.max_depth(),
        seed: args.seed,
        denoise: args.denoise,
        frames: footage.frames(),
        frames_per_sec: footage.frames_per_sec(),
    }
}

impl ReportSettings {
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

/// Traces the missing frames.
fn make(
    config: FarmConfig,
    footage: &ShotSequence,
    settings: ReportSettings,
    range: Option<FrameRange>,
    target: &VideoTarget,
    interrupted: &AtomicBool,
) -> anyhow::Result<(FilmFrames, HeadlessReport)> {
    let mut farm = Farm::new(config)?;
    let updates = (0..footage.frames()).map(|frame| footage.update(frame));
    let (sender, finished) = mpsc::channel();
    let film = Film::new(settings.width, settings.height, updates)
        .settings(settings.render())
        .exposure(EXPOSURE)
        .range(range.unwrap_or(FrameRange::ALL))
        .on_progress(move |FilmProgress { frame, .. }| {
            if let Some(frame) = frame.clone() {
                // The receiver is gone once the film has been given up.
                let _ = sender.send(frame);
            }
        });
    let begun = Instant::now();
    let folder = target.frames_folder();
    let job = farm.film(footage.scene(), film, &folder)?;
    let resumed = job.resumed_frames();
    if resumed > 0 {
        let sentence = going_on(resumed, job.progress().frames, &folder);
        eprintln!("Resuming: {sentence}");
    }
    let before = job.progress();
    let (kept, reached) = wait(job, interrupted);
    let is_worth_going_on = reached > before.frames_done || interrupted.load(Ordering::Relaxed);
    let kept = kept.map_err(|error| match is_worth_going_on {
        true => anyhow::Error::from(error).context(going_on(reached, before.frames, &folder)),
        // Without progress, the same command would fail in the same way: no hint to continue.
        false => error.into(),
    })?;
    let frames = frame_reports(footage, &finished);
    let report = HeadlessReport {
        totals: totals(&frames, settings, begun.elapsed()),
        nodes: farm.nodes().into_iter().map(node).collect(),
        settings,
        frames,
    };
    Ok((kept, report))
}

/// Waits for the film with a progress bar, and returns it with the number of frames on disk.
fn wait(job: FilmJob, interrupted: &AtomicBool) -> (carom_farm::Result<FilmFrames>, u32) {
    let bar = progress_bar(job.progress().frames);
    bar.set_position(job.resumed_frames().into());
    bar.reset_eta();
    while !job.is_finished() {
        bar.set_position(job.progress().frames_done.into());
        if interrupted.load(Ordering::Relaxed) {
            job.cancel();
        }
        std::thread::sleep(REFRESH_INTERVAL);
    }
    let reached = job.progress().frames_done;
    let kept = job.wait();
    bar.finish_and_clear();
    (kept, reached)
}

fn frame_reports(
    footage: &ShotSequence,
    finished: &Receiver<(u32, FrameStats)>,
) -> Vec<FrameReport> {
    let report = |(index, stats)| {
        let (shot, moment_secs) = footage.moment(index);
        FrameReport {
            index,
            shot,
            moment_secs,
            stats,
        }
    };
    finished.try_iter().map(report).collect()
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

/// Checks before tracing whether the output file can be written, and claims the report of a folder, in
/// which files of other origin are not replaced. Jobs that trace a part of a film write neither.
fn claim(
    target: &VideoTarget,
    film: &VideoTarget,
    is_part: bool,
) -> anyhow::Result<Option<WholeFile>> {
    if is_part {
        return Ok(None);
    }
    let claim = |path: &Path| {
        let claimed = WholeFile::claim(path);
        claimed.with_context(|| format!("cannot write {}", path.display()))
    };
    let VideoTarget::Folder(folder) = target else {
        // The claim is released at once, as jobs that trace other parts also assemble the film.
        return claim(target.path()).map(|_| None);
    };
    fs::create_dir_all(folder).with_context(|| format!("cannot write {}", folder.display()))?;
    let report = folder.join("stats.json");
    for path in [film.path(), &report] {
        if path.is_file() && !FilmFrames::are_in(folder) {
            return Err(carom_farm::Error::ForeignFrame(path.to_owned()).into());
        }
    }
    claim(&report).map(Some)
}

fn write_report(report: &HeadlessReport, file: WholeFile) -> anyhow::Result<()> {
    let path = file.path().display().to_string();
    let write = || -> anyhow::Result<()> {
        let mut file = file;
        let mut text = serde_json::to_vec_pretty(report)?;
        text.push(b'\n');
        file.write_all(&text)?;
        Ok(file.commit()?)
    };
    write().with_context(|| format!("cannot write {path}"))
}

fn progress_bar(frames: u32) -> ProgressBar {
    let template = "{bar:40} {pos}/{len} frames, {per_sec}, {eta} left";
    let style =
        ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(u64::from(frames)).with_style(style)
}

/// Default number of frames of a break.
const FRAMES: u32 = 48;
/// Interval at which the progress bar is updated and Ctrl-C checked.
const REFRESH_INTERVAL: Duration = Duration::from_millis(50);
