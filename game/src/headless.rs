//! Carom without a window: a break shot through the farm into files.
//!
//! ```text
//! rack, stroke ─▶ sim::Shot ─▶ Stage ─▶ Farm (several frames in flight) ─▶ frame_0000.png …
//!                                                                      ├─▶ break.png (animated)
//!                                                                      └─▶ stats.json
//! ```

use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use carom_farm::{
    Farm, FarmConfig, Frame, FrameSpec, FrameStats, NodeState, NodeStatus, PixelFormat, Pixels,
    PrecisionRange,
};
use carom_tracer::{ImageSize, RenderSettings};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use crate::animation::{Animation, write_png};
use crate::args::Args;
use crate::director::EXPOSURE;
use crate::play::CUE_SPEED_M_S_MAX;
use crate::sim::{Engine, EventKind, Recording, Shot, Stroke, Table, World};
use crate::stage::Stage;

/// What `stats.json` holds.
#[derive(Debug, Serialize)]
struct Report {
    settings: Settings,
    nodes: Vec<Node>,
    frames: Vec<FrameReport>,
    totals: Totals,
}

/// How the frames were asked for.
#[derive(Clone, Copy, Debug, Serialize)]
struct Settings {
    width: u32,
    height: u32,
    samples: u32,
    scatterings_max: u32,
    seed: u32,
    frames: u32,
    frames_per_sec: u32,
}

/// A node as the farm saw it at the end.
#[derive(Debug, Serialize)]
struct Node {
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
    /// The moment of the shot, seconds since the stroke.
    moment_secs: f64,
    #[serde(flatten)]
    stats: FrameStats,
}

/// All frames together.
#[derive(Debug, Default, Serialize)]
struct Totals {
    wall_secs: f64,
    msamples_per_sec: f64,
    payload_bytes: u64,
    reissued_tiles: u64,
    duplicate_tiles: u64,
    dropped_samples: u64,
    tiles_by_node: Vec<u64>,
}

/// Renders the break shot that `args` describe.
///
/// # Errors
/// A sentence: a folder that cannot be written, a farm that cannot be built or does not answer.
pub fn run(args: &Args, config: FarmConfig) -> anyhow::Result<()> {
    let out = args.out.as_path();
    fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let settings = settings(args);
    let (table, recording) = args.table_and_recording()?;
    let shot = match recording {
        Some(recording) => recording.shot,
        None => break_shot(&table, settings.seed, args.physics)?,
    };
    if let Some(folder) = &args.record {
        keep(&table, &shot, folder)?;
    }
    let stage = Stage::around(&table, args.ball_set);
    // Files are kept: a link that is too slow for exact pixels makes them later, not worse.
    let mut farm = Farm::new(FarmConfig {
        precision: PrecisionRange::EXACT,
        ..config
    })?;
    farm.set_scene(stage.scene())?;
    let begun = Instant::now();
    let frames = render(&mut farm, &stage, &shot, settings, out)?;
    let report = Report {
        totals: totals(&frames, settings, begun.elapsed()),
        nodes: farm.nodes().into_iter().map(node).collect(),
        settings,
        frames,
    };
    write_report(&report, &out.join("stats.json"))?;
    println!(
        "{} frames of {}x{}, break.png and stats.json are in {}",
        settings.frames,
        settings.width,
        settings.height,
        out.display()
    );
    Ok(())
}

fn settings(args: &Args) -> Settings {
    let size = args.size.unwrap_or(ImageSize::new(640, 360));
    Settings {
        width: size.width,
        height: size.height,
        samples: args.spp,
        scatterings_max: args.ball_set.scatterings_max(),
        seed: args.seed,
        frames: args.frames,
        frames_per_sec: FRAMES_PER_SEC,
    }
}

/// A hard, straight break.
fn break_shot(table: &Table, seed: u32, engine: Engine) -> anyhow::Result<Shot> {
    let mut world = World::new(table.clone(), table.rack_eight(seed))?;
    world.set_engine(engine);
    Ok(world.strike(Stroke::straight(0.0, CUE_SPEED_M_S_MAX))?)
}

fn keep(table: &Table, shot: &Shot, folder: &Path) -> anyhow::Result<()> {
    fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let recording = Recording {
        table: table.name().to_owned(),
        shot: shot.clone(),
    };
    Ok(recording.save(&folder.join("shot_0001.carom"))?)
}

/// Renders all frames, writing each as it is finished.
fn render(
    farm: &mut Farm,
    stage: &Stage,
    shot: &Shot,
    settings: Settings,
    out: &Path,
) -> anyhow::Result<Vec<FrameReport>> {
    let size = ImageSize::new(settings.width, settings.height);
    let first_secs = (first_contact_secs(shot) - LEAD_IN_SECS).max(0.0);
    let moment = |index: u32| first_secs + f64::from(index) / f64::from(settings.frames_per_sec);
    let mut animation = Animation::create(
        &out.join("break.png"),
        size,
        settings.frames,
        FRAMES_PER_SEC as u16,
    )?;
    let bar = progress_bar(settings.frames);
    let mut submitted = 0;
    let mut frames: Vec<FrameReport> = Vec::new();
    while frames.len() < settings.frames as usize {
        while submitted < settings.frames {
            match farm.submit(spec(stage, shot, moment(submitted), settings)) {
                Ok(_) => submitted += 1,
                Err(carom_farm::Error::FramesInFlight { .. }) => break,
                Err(error) => return Err(error.into()),
            }
        }
        let frame = next_frame(farm)?;
        let index = frames.len() as u32;
        let rgb = bytes(&frame)?;
        write_png(&out.join(format!("frame_{index:04}.png")), size, rgb)?;
        animation.push(rgb)?;
        bar.inc(1);
        frames.push(FrameReport {
            index,
            moment_secs: moment(index),
            stats: frame.stats,
        });
    }
    animation.finish()?;
    bar.finish_and_clear();
    Ok(frames)
}

fn spec(stage: &Stage, shot: &Shot, moment_secs: f64, settings: Settings) -> FrameSpec {
    FrameSpec {
        update: stage.update(stage.scene().camera, &shot.poses_at(moment_secs)),
        size: ImageSize::new(settings.width, settings.height),
        settings: RenderSettings {
            samples: settings.samples,
            first_sample: 0,
            scatterings_max: settings.scatterings_max,
            seed: settings.seed,
            denoise: false,
        },
        format: PixelFormat::Srgb8 { exposure: EXPOSURE },
    }
}

/// Waits for the next frame; gives up with the nodes' own words when none comes.
fn next_frame(farm: &mut Farm) -> anyhow::Result<Frame> {
    let begun = Instant::now();
    loop {
        if let Some(frame) = farm.wait_frame(Duration::from_millis(200)) {
            return Ok(frame);
        }
        let nodes = farm.nodes();
        let ready = nodes.iter().any(|node| node.state == NodeState::Ready);
        if !ready && begun.elapsed() > PATIENCE {
            bail!("no node is ready to trace: {}", states(&nodes));
        }
    }
}

fn states(nodes: &[NodeStatus]) -> String {
    let words = |node: &NodeStatus| match &node.state {
        NodeState::Connecting => format!("{} does not answer", node.address),
        NodeState::Paired => format!("{} waits for a scene", node.address),
        NodeState::Syncing => format!("{} has not taken the scene", node.address),
        NodeState::Ready => format!("{} is ready", node.address),
        NodeState::Lost { why } => format!("{} is lost ({why})", node.address),
    };
    if nodes.is_empty() {
        return "the farm has no nodes".to_owned();
    }
    nodes.iter().map(words).collect::<Vec<_>>().join(", ")
}

fn bytes(frame: &Frame) -> anyhow::Result<&[u8]> {
    match &frame.pixels {
        Pixels::Srgb8(rgb) => Ok(bytemuck::cast_slice(rgb)),
        Pixels::Linear(_) => bail!("the farm sent radiance where colours were asked for"),
    }
}

fn first_contact_secs(shot: &Shot) -> f64 {
    let is_contact = |event: &&crate::sim::Event| matches!(event.kind, EventKind::BallBall { .. });
    shot.events()
        .iter()
        .find(is_contact)
        .map_or(0.0, |event| event.time_secs)
}

fn totals(frames: &[FrameReport], settings: Settings, wall: Duration) -> Totals {
    let mut totals = Totals::default();
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

fn node(status: NodeStatus) -> Node {
    Node {
        address: status.address,
        device: status.info.map(|info| info.device.name),
        tiles: status.tiles,
        fixed_secs: status.fixed_secs,
        msamples_per_sec: status.msamples_per_sec,
        lost: match status.state {
            NodeState::Lost { why } => Some(why),
            _ => None,
        },
    }
}

fn write_report(report: &Report, path: &Path) -> anyhow::Result<()> {
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

const FRAMES_PER_SEC: u32 = 30;
/// The cue ball is seen rolling for this long before it meets the rack.
const LEAD_IN_SECS: f64 = 0.1;
/// How long to wait for a first node.
const PATIENCE: Duration = Duration::from_secs(60);
