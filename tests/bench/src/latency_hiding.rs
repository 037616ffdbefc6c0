//! The bench of latency hiding: frames requested ahead of time over a real network from real processes,
//! each due at its own time.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use carom_farm::net::interruption;
use carom_farm::pacing::{FrameSchedule, LeadTime, PresentationQueue};
use carom_farm::{
    Balancing, Farm, FarmConfig, Frame, FrameId, FrameSpec, LocalNode, Pixels, Submission,
};
use carom_testkit::random::SplitMix64;
use carom_tracer::SceneUpdate;
use carom_tracer::scene::Camera;
use glam::Quat;
use serde::Serialize;

use crate::cluster::process::{NodeProcess, NodeSpec, farm_folder};
use crate::proxy::LinkArgs;
use crate::scenes;
use crate::timing::quantiles;
use crate::wait::WaitArgs;
use crate::{BenchError, print_json};

/// Measure whether frames requested ahead of time are there at their moments.
///
/// Strokes are played on a display of 60 refreshes a second, whose pictures come from nodes that are processes
/// of this machine behind a network as bad as asked for: --jitter 1 for a long way's.
///
/// While the player aims, pictures of the present are asked for. At a click they are cancelled, and
/// pictures of the shot are asked for as far ahead as 95 of the last hundred took; the stroke falls so
/// that the first in which something moves is there in time in three of four cases. Each refresh shows
/// the latest picture whose moment has come. A picture that is not whole at its moment is shown with its
/// late tiles missing, which are counted.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// A node: its share of a thread and its round trip in milliseconds; may be repeated.
    #[arg(long, value_name = "SHARE@MS", value_delimiter = ',',
        default_values = ["0.5@46", "0.3@46"])]
    node: Vec<NodeSpec>,
    /// How many.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    strokes: u32,
    /// Seconds that balls roll after a stroke.
    #[arg(long, default_value_t = 1.5)]
    shot_secs: f64,
    /// Pixels across; the picture is 16:9, of one sample a pixel.
    #[arg(long, default_value_t = 128, value_parser = clap::value_parser!(u32).range(16..=3840))]
    width: u32,
    /// Divides frames.
    #[arg(long, default_value_t)]
    balancer: Balancing,
    /// What is wrong with all paths; --delay is the nodes' own.
    #[command(flatten)]
    path: LinkArgs,
    /// Draws clicks, losses and jitter.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    wait: WaitArgs,
}

#[derive(Debug, Serialize)]
struct LatencyHidingReport {
    strokes: u32,
    /// Refreshes while balls rolled.
    refreshes: usize,
    /// Share of these whose picture was of a time within one refresh of the clock.
    within_a_refresh: f64,
    moment_error_ms_p50: f64,
    moment_error_ms_p99: f64,
    /// New pictures shown per second in which balls rolled.
    pictures_per_second: f64,
    click_to_change_ms_p50: f64,
    click_to_change_ms_p99: f64,
    click_to_change_ms_max: f64,
    /// Number of late tiles over that of the tiles of all whole frames.
    late_tiles: f64,
    lead_ms: f64,
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let path = args.path.config()?;
    if !(0.1..=60.0).contains(&args.shot_secs) {
        let secs = args.shot_secs;
        let why = format!("--shot-secs is {secs}: it must be from 0.1 to 60");
        return Err(BenchError::Input(why));
    }
    let folder = farm_folder()?;
    let nodes = args.node.iter().enumerate();
    let nodes =
        nodes.map(|(index, spec)| NodeProcess::start(folder.path(), index, spec, path, args.seed));
    let nodes: Vec<NodeProcess> = nodes.collect::<anyhow::Result<_>>()?;
    let scene = scenes::scene(None)?.scene;
    let mut farm = Farm::new(FarmConfig {
        local: LocalNode::None,
        nodes: nodes.iter().map(NodeProcess::address).collect(),
        credentials: folder.path().to_owned(),
        balancer: args.balancer,
        tile_edge: 16,
        ..FarmConfig::default()
    })?;
    farm.set_scene(&scene)?;
    let interrupted = interruption().context("Ctrl-C")?;
    let mut table = RefreshLoop::new(args, farm, scene.camera);
    table.wait_ready(nodes.len(), &interrupted)?;
    for stroke in 0..args.strokes {
        table.aim(&interrupted)?;
        table.shoot(stroke, &interrupted)?;
    }
    let report = table.report();
    if args.json {
        print_json(&report)?;
    } else {
        print(&report);
    }
    Ok(())
}

/// The player's refresh loop.
struct RefreshLoop<'a> {
    args: &'a Args,
    farm: Farm,
    camera: Camera,
    lead: LeadTime,
    /// Times of pictures in flight, in seconds of the shot; none for those of the present.
    asked: BTreeMap<FrameId, Option<f64>>,
    last: FrameId,
    /// Time of the next refresh of the display.
    refresh: Instant,
    random: SplitMix64,
    seen: RefreshLog,
}

/// Record of what the player has seen.
#[derive(Default)]
struct RefreshLog {
    /// For each refresh of a shot, the difference in seconds between its picture's time and the clock.
    errors: Vec<f64>,
    pictures: usize,
    /// Seconds.
    clicks: Vec<f64>,
    late_tiles: usize,
    tiles: usize,
}

impl<'a> RefreshLoop<'a> {
    fn new(args: &'a Args, farm: Farm, camera: Camera) -> Self {
        Self {
            args,
            farm,
            camera,
            lead: LeadTime::default(),
            asked: BTreeMap::new(),
            last: FrameId(0),
            refresh: Instant::now(),
            random: SplitMix64::new(args.seed),
            seen: RefreshLog::default(),
        }
    }

    fn wait_ready(&mut self, count: usize, interrupted: &AtomicBool) -> Result<(), BenchError> {
        let mut wait = self.args.wait.begin();
        loop {
            let nodes = self.farm.nodes();
            let ready = nodes.iter().filter(|node| node.state.is_ready());
            if ready.count() == count {
                return Ok(());
            }
            wait.check_farm("the nodes", &self.farm)?;
            self.wait_refresh(interrupted)?;
        }
    }

    /// Sleeps until the next refresh.
    fn wait_refresh(&mut self, interrupted: &AtomicBool) -> Result<Instant, BenchError> {
        if interrupted.load(Ordering::Relaxed) {
            return Err(BenchError::Interrupted);
        }
        let now = Instant::now();
        self.refresh += PERIOD;
        if self.refresh < now {
            // Refreshes were missed: continue with the next one.
            let missed = (now - self.refresh).div_duration_f64(PERIOD).ceil();
            self.refresh += PERIOD.mul_f64(missed);
        }
        std::thread::sleep(self.refresh.saturating_duration_since(now));
        Ok(self.refresh)
    }
    /// Moves the view for about a second, so that the time of pictures is known.
    fn aim(&mut self, interrupted: &AtomicBool) -> Result<(), BenchError> {
        let end = Instant::now() + Duration::from_secs_f64(0.6 + 0.6 * self.random.uniform());
        while self.wait_refresh(interrupted)? < end {
            while let Some(frame) = self.farm.poll_frame() {
                self.note(&frame);
            }
            let period_secs = PERIOD.as_secs_f64();
            let most = FarmConfig::default().frames_in_flight;
            if self.farm.in_flight() < self.lead.pictures_in_flight(period_secs, most) {
                self.ask(None, None)?;
            }
        }
        Ok(())
    }

    /// A click at a random time, and its shot.
    fn shoot(&mut self, stroke: u32, interrupted: &AtomicBool) -> Result<(), BenchError> {
        let still = self.still_picture()?;
        let wait = PERIOD.mul_f64(self.random.uniform());
        self.wait_refresh(interrupted)?;
        std::thread::sleep(wait);
        let clicked = Instant::now();
        let taken = self.wait_refresh(interrupted)?;
        self.farm.cancel_before(FrameId(self.last.0 + 1));
        self.asked.clear();
        let delay_secs = self.lead.stroke_delay_secs(PERIOD.as_secs_f64());
        let begins = taken + Duration::from_secs_f64(delay_secs);
        let (mut schedule, mut queue) = (FrameSchedule::default(), PresentationQueue::default());
        let (mut shown, mut changed) = (0.0, false);
        let mut now = taken;
        loop {
            let clock = now.saturating_duration_since(begins).as_secs_f64()
                - begins.saturating_duration_since(now).as_secs_f64();
            self.collect(&mut queue);
            if let Some((moment, pixels)) = queue.due(clock) {
                shown = moment;
                self.seen.pictures += 1;
                if !changed && pixels != still {
                    changed = true;
                    self.seen.clicks.push((now - clicked).as_secs_f64());
                }
            }
            if clock > self.args.shot_secs {
                break;
            }
            if clock >= 0.0 {
                self.seen.errors.push((clock - shown).abs());
            }
            self.ask_moments(&mut schedule, clock)?;
            now = self.wait_refresh(interrupted)?;
        }
        if !changed {
            return Err(anyhow!("nothing was seen to change after stroke {stroke}").into());
        }
        Ok(())
    }

    /// The table before the stroke.
    fn still_picture(&mut self) -> Result<Pixels, BenchError> {
        self.farm.cancel_before(FrameId(self.last.0 + 1));
        let id = self.ask(Some(0.0), None)?;
        loop {
            let frame = self.args.wait.frame(&mut self.farm)?;
            if frame.id == id {
                self.asked.remove(&id);
                return Ok(frame.pixels);
            }
        }
    }

    fn ask_moments(&mut self, schedule: &mut FrameSchedule, clock: f64) -> Result<(), BenchError> {
        let most = FarmConfig::default().frames_in_flight;
        let (lead, period) = (self.lead.secs(), PERIOD.as_secs_f64());
        while self.farm.in_flight() < most
            && let Some(moment) = schedule.next(clock, lead, period, self.args.shot_secs)
        {
            let deadline = Duration::from_secs_f64((moment - clock).max(0.0));
            self.ask(Some(moment), Some(deadline))?;
        }
        Ok(())
    }

    fn ask(&mut self, moment: Option<f64>, by: Option<Duration>) -> Result<FrameId, BenchError> {
        let mut camera = self.camera;
        let turn = Quat::from_rotation_z(0.2 * moment.unwrap_or(0.0) as f32);
        camera.eye = camera.target + turn * (camera.eye - camera.target);
        let spec = FrameSpec {
            update: SceneUpdate {
                camera: Some(camera),
                ..SceneUpdate::default()
            },
            ..scenes::frame(scenes::wide(self.args.width), 1, 0)
        };
        let submission = Submission {
            deadline: by,
            ..Submission::default()
        };
        self.last = self.farm.submit_with(spec, submission)?;
        self.asked.insert(self.last, moment);
        Ok(self.last)
    }

    fn collect(&mut self, queue: &mut PresentationQueue<Pixels>) {
        while let Some(frame) = self.farm.poll_frame() {
            self.note(&frame);
            let moment = self.asked.get(&frame.id).copied().flatten();
            if frame.missing.is_empty() {
                self.asked.remove(&frame.id);
            }
            if let Some(moment) = moment {
                queue.push(moment, frame.pixels);
            }
        }
    }

    fn note(&mut self, frame: &Frame) {
        let tiles: u32 = frame.stats.tiles_by_node.iter().sum();
        if frame.missing.is_empty() {
            self.lead.observe(frame.stats.makespan_secs);
            self.seen.tiles += tiles as usize;
        } else {
            self.seen.late_tiles += frame.missing.len();
        }
    }

    fn report(&self) -> LatencyHidingReport {
        let RefreshLog {
            errors,
            pictures,
            clicks,
            late_tiles,
            tiles,
        } = &self.seen;
        let period = PERIOD.as_secs_f64();
        let good = errors.iter().filter(|error| **error <= period).count();
        let rolled_secs = errors.len() as f64 * period;
        let ms = |secs: &f64| 1e3 * secs;
        let [error_ms_p50, error_ms_p99] = quantiles(errors.iter().map(ms), [0.5, 0.99]);
        let [click_ms_p50, click_ms_p99, click_ms_max] =
            quantiles(clicks.iter().map(ms), [0.5, 0.99, 1.0]);
        LatencyHidingReport {
            strokes: self.args.strokes,
            refreshes: errors.len(),
            within_a_refresh: good as f64 / errors.len().max(1) as f64,
            moment_error_ms_p50: error_ms_p50,
            moment_error_ms_p99: error_ms_p99,
            pictures_per_second: *pictures as f64 / rolled_secs,
            click_to_change_ms_p50: click_ms_p50,
            click_to_change_ms_p99: click_ms_p99,
            click_to_change_ms_max: click_ms_max,
            late_tiles: *late_tiles as f64 / (*tiles).max(1) as f64,
            lead_ms: 1e3 * self.lead.secs(),
        }
    }
}

fn print(report: &LatencyHidingReport) {
    println!(
        "{} strokes, {} refreshes: {:.2} % within a refresh of the clock (bar 99), p50 {:.1} ms, \
         p99 {:.1} ms; {:.1} pictures a second",
        report.strokes,
        report.refreshes,
        100.0 * report.within_a_refresh,
        report.moment_error_ms_p50,
        report.moment_error_ms_p99,
        report.pictures_per_second
    );
    println!(
        "from a click to the first changed pixel: p50 {:.1} ms, p99 {:.1} ms (bar 100), max {:.1} ms",
        report.click_to_change_ms_p50, report.click_to_change_ms_p99, report.click_to_change_ms_max
    );
    println!(
        "asked {:.1} ms ahead; {:.3} % of the tiles late",
        report.lead_ms,
        100.0 * report.late_tiles
    );
}

/// Refresh period of the display.
const PERIOD: Duration = Duration::from_nanos(16_666_667);
