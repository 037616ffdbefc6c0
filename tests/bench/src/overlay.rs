//! The bench of the statistics overlay: CPU time of a redraw with 64 nodes and 8,160 tiles.

use anyhow::Context as _;
use carom_farm::quality::{QUALITY_LEVELS, QualityPreference};
use carom_farm::{Balancing, Distribution, Frame};
use carom_testkit::simulator::{FarmPlan, NodePlan, SimulationReport, run};
use carom_tracer::ImageSize;
use carom_window::stats::frame_record::FrameSample;
use carom_window::stats::maps::{MapKind, Maps};
use carom_window::stats::{Stats, StatsInput, StatsLevel, gantt};
use carom_window::theme;
use clap::Args;
use cpu_time::ThreadTime;
use egui::{Context, LayerId, Pos2, RawInput, Rect, Vec2};
use serde::Serialize;

use crate::timing::{median, ms_since};

/// Measure the CPU time of the statistics overlay.
///
/// Frames of a simulated farm, one for each redraw, at a window of 1280x720 points. CPU time of this
/// thread for a redraw: layout and tessellation, without what the display does. "mean" is over all
/// redraws, with those in which the numbers change; "least" is what is left when nothing else
/// disturbs. "bars and maps" is the Gantt chart and the tile map by themselves, new for each picture.
#[derive(Clone, Debug, Args)]
pub(crate) struct OverlayArgs {
    /// Print JSON in place of a table
    #[arg(long)]
    pub(crate) json: bool,
    /// Redraws of each kind
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(30..=100_000))]
    pub(crate) redraws: u32,
}

/// CPU milliseconds of a redraw.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct RedrawCost {
    /// Name of what is drawn.
    pub(crate) shown: &'static str,
    /// Mean of all redraws.
    pub(crate) mean_ms: f64,
    /// Median of all redraws.
    pub(crate) median_ms: f64,
    /// Minimum of all redraws.
    pub(crate) least_ms: f64,
}

impl OverlayArgs {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let costs = measure(self.redraws)?;
        if self.json {
            println!("{}", serde_json::to_string_pretty(&costs)?);
            return Ok(());
        }
        println!(
            "The overlay, {NODES} nodes and {TILES} tiles: CPU ms of a redraw (bar for bars and maps: 1)"
        );
        println!(
            "{:<16} {:>8} {:>8} {:>8}",
            "shown", "mean", "median", "least"
        );
        for RedrawCost {
            shown,
            mean_ms,
            median_ms,
            least_ms,
        } in costs
        {
            println!("{shown:<16} {mean_ms:8.4} {median_ms:8.4} {least_ms:8.4}");
        }
        Ok(())
    }
}

/// Costs of each level of the overlay, and of the meshes alone.
///
/// # Errors
/// A sentence if the simulated farm delivers nothing.
pub(crate) fn measure(redraws: u32) -> anyhow::Result<Vec<RedrawCost>> {
    let report = run(&plan(), SECS_MAX);
    let frames = report.frames.get(WARM_UP..).unwrap_or_default();
    anyhow::ensure!(
        !frames.is_empty(),
        "the simulated farm has delivered no frame"
    );
    let mut costs = vec![cost("nothing at all", redraws, |_, _| {})];
    for (shown, level) in [
        ("hidden", StatsLevel::Off),
        ("line", StatsLevel::Line),
        ("card", StatsLevel::Card),
        ("full", StatsLevel::Full),
    ] {
        let mut stats = Stats::new(std::env::temp_dir());
        stats.set_level(level);
        // Fills the history to its maximum.
        for (frame, number) in frames
            .iter()
            .cycle()
            .zip(0..carom_window::stats::history::History::FRAMES_MAX as u64)
        {
            stats.take(seen(frame, number, &report));
        }
        let first = stats.history().records().len() as u64;
        let mut newer = frames.iter().cycle();
        costs.push(cost(shown, redraws, |ctx, i| {
            if let (true, Some(frame)) = (stats.is_shown(), newer.next()) {
                stats.take(seen(frame, first + i, &report));
            }
            let now_secs = i as f64 / 60.0;
            stats.note_redraw(now_secs, true);
            stats.draw(ctx, now_secs, &input(&report));
        }));
    }
    let mut stats = Stats::new(std::env::temp_dir());
    stats.set_level(StatsLevel::Line);
    frames
        .iter()
        .zip(0..)
        .for_each(|(frame, i)| stats.take(seen(frame, i, &report)));
    let newest = stats
        .history()
        .newest()
        .context("no picture was taken in")?;
    let mut record = (**newest).clone();
    let mut maps = Maps::default();
    costs.push(cost("bars and maps", redraws, |ctx, i| {
        record.frame = i;
        maps.kind = if i % 2 == 0 {
            MapKind::Owner
        } else {
            MapKind::Cost
        };
        let painter = ctx.layer_painter(LayerId::background());
        maps.draw(ctx, &painter, screen(), &record);
        egui::Area::new(egui::Id::unique("bars"))
            .fixed_pos(Pos2::new(840.0, 40.0))
            .show(ctx, |ui| {
                ui.set_width(430.0);
                gantt::show(ui, &record);
            });
    }));
    Ok(costs)
}

fn cost(shown: &'static str, redraws: u32, mut draw: impl FnMut(&Context, u64)) -> RedrawCost {
    let ctx = Context::default();
    theme::apply(&ctx, 1.0, true);
    let mut all = Vec::new();
    for i in 0..u64::from(redraws) + SETTLING {
        let input = RawInput {
            screen_rect: Some(screen()),
            time: Some(i as f64 / 60.0),
            ..RawInput::default()
        };
        let begun = ThreadTime::now();
        let mut output = ctx.run_ui(input, |ui| draw(ui.ctx(), i));
        let primitives = ctx.tessellate(std::mem::take(&mut output.shapes), 1.0);
        let ms = ms_since(begun);
        drop(primitives);
        // Cleared as a display would after an upload.
        output.textures_delta.clear();
        if i >= SETTLING {
            all.push(ms);
        }
    }
    RedrawCost {
        shown,
        mean_ms: all.iter().sum::<f64>() / all.len() as f64,
        median_ms: median(all.iter().copied()),
        least_ms: all.iter().copied().fold(f64::INFINITY, f64::min),
    }
}

fn seen<'a>(frame: &Frame, number: u64, report: &'a SimulationReport) -> FrameSample<'a> {
    FrameSample {
        frame: number,
        at_secs: number as f64 / 60.0,
        size: SIZE,
        samples: 1,
        stats: frame.stats.clone(),
        nodes: &report.nodes,
    }
}

fn input(report: &SimulationReport) -> StatsInput<'_> {
    StatsInput {
        nodes: &report.nodes,
        balancing: Balancing::default(),
        distribution: Distribution::default(),
        preference: QualityPreference::default(),
        window: SIZE,
        period_secs: 1.0 / 60.0,
        stop: QUALITY_LEVELS[10],
        level_secs: QUALITY_LEVELS.map(|stop| Some(4e-3 * stop.cost())),
        lead_secs: 0.03,
        skipped: 2,
        disocclusion_fraction: Some(0.01),
        draw_secs: 0.002,
        present: "a simulation",
    }
}

/// A farm with speeds over a range of 100 and round trips over a range of 30, which together need 8 ms
/// for a frame.
fn plan() -> FarmPlan {
    let node = |i: usize| {
        let spread = |n: usize| (i * n % NODES) as f64 / (NODES - 1) as f64;
        let speed = 100f64.powf(spread(37)) * 0.19;
        NodePlan {
            jitter_secs: 1e-3,
            ..NodePlan::new(1e-3 * 30f64.powf(spread(23)), speed)
        }
    };
    FarmPlan {
        nodes: (0..NODES).map(node).collect(),
        frames: (WARM_UP + 30) as u64,
        spot_check_tiles: 0,
        size: SIZE,
        tile_edge: TILE_EDGE,
        ..FarmPlan::default()
    }
}

fn screen() -> Rect {
    Rect::from_min_size(Pos2::ZERO, Vec2::new(1280.0, 720.0))
}

const NODES: usize = 64;
const SIZE: ImageSize = ImageSize::new(1920, 1088);
const TILE_EDGE: u16 = 16;
const TILES: usize = 120 * 68;
const SECS_MAX: f64 = 600.0;
/// Number of frames until every node has its share.
const WARM_UP: usize = 30;
/// Number of redraws until layout and texts are in egui's caches.
const SETTLING: u64 = 20;
