//! A farm on virtual time: the real coordinator with simulated nodes, links and clock.
//!
//! ```text
//! Plan ─▶ [events by time] ─▶ Coordinator ─▶ commands ─▶ simulated nodes ─▶ events ─▶ … ─▶ Report
//! ```
//!
//! Everything follows from the plan and its seed, so that a run that fails can be repeated, and
//! hundreds of frames take less than a second. Each link is in order, with half of the node's
//! round trip each way and exponential jitter; a device works on one run after the other.

mod faults;
mod node;
mod optimum;
pub(crate) mod random;
mod scenario;
mod score;
mod world;

use std::cmp::Ordering;
use std::collections::{BTreeSet, BinaryHeap};
use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;

use carom_protocol::session::ClientEvent;
use carom_protocol::tile_codec::TilePixels;
use carom_protocol::{FrameId, NodeInfo, PixelFormat, SceneHash, TraceRequest};
use carom_tracer::{
    Camera, DeviceInfo, DeviceKind, Environment, ImageSize, RenderSettings, Scene, SceneUpdate,
    TileGrid, TileRun,
};
use glam::Vec3;

pub use self::faults::{FaultRun, fault_plan, run_faults};
use self::node::{Answer, SimNode};
pub use self::optimum::optimum_secs;
use self::random::Random;
pub use self::scenario::{Mode, Network, PERIOD_SECS, Scenario};
pub use self::score::Score;
pub use self::world::Weather;
use self::world::World;
use crate::coordinator::{Action, Coordinator, NodeIndex};
use crate::link::{Command, LinkEvent};
use crate::pacing::{Lead, Schedule};
use crate::{Balancing, Distribution, Frame, FrameSpec, NodeStatus, Pixels};

/// What to simulate.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Decides all that is random.
    pub seed: u64,
    /// Divides the frames.
    pub balancing: Balancing,
    /// The farm.
    pub nodes: Vec<NodePlan>,
    /// How many frames are submitted.
    pub frames: u64,
    /// How many may be in flight.
    pub frames_in_flight: usize,
    /// Seconds between submissions; absent: as soon as there is room.
    pub period_secs: Option<f64>,
    /// Whether frames must be shown at the moments that [`Schedule`] has for 60 frames a second.
    pub looks_ahead: bool,
    /// The picture: its pixels times their samples are the work of a frame.
    pub size: ImageSize,
    /// Samples of each pixel.
    pub samples: u32,
    /// What is divided.
    pub distribution: Distribution,
    /// Pixels along a tile's edge.
    pub tile_edge: u16,
    /// How much it varies.
    pub weather: Weather,
    /// What happens to nodes when a frame is submitted.
    pub changes: Vec<(FrameId, NodeIndex, Change)>,
}

/// A simulated node.
#[derive(Clone, Debug)]
pub struct NodePlan {
    /// Round trip without jitter, in seconds.
    pub round_trip_secs: f64,
    /// Mean of the jitter of each message, in seconds.
    pub jitter_secs: f64,
    /// Pixel samples per second, in millions.
    pub msamples_per_sec: f64,
    /// Whether tiles come as they are finished, as from a processor, or all at the end of a run.
    pub streams: bool,
    /// What share of its true busy time it reports; 1 is honest.
    pub honesty: f64,
    /// What happens to it, by the second.
    pub changes: Vec<(f64, Change)>,
}

/// What happens to a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// It takes that many times as long as before from now on.
    Slow(f64),
    /// It says nothing any more, and nobody notices but by that.
    Silent,
    /// Its connection breaks, which the client learns of at once.
    Die,
    /// It connects. A node with this among its changes is not there from the start.
    Join,
    /// Its device fails at each run from now on.
    Fail,
    /// It reports that share of its true busy time from now on.
    Lie(f64),
    /// It sends pixels that are not numbers from now on.
    Poison,
    /// The client sleeps for so many seconds.
    Suspend(f64),
}

/// What came out.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// The whole frames in the order of delivery; the pixels have been checked and dropped.
    pub frames: Vec<Frame>,
    /// Those that were shown with tiles missing, of which some came whole later.
    pub partial: Vec<Frame>,
    /// The most that a frame was handed over after it had to be shown, in seconds.
    pub shown_late_secs: f64,
    /// Frames in which any pixel was wrong or missing.
    pub wrong_frames: u64,
    /// Tiles in a frame.
    pub tiles_per_frame: u32,
    /// Tiles that devices have worked on, wanted or not.
    pub tiles_traced: u64,
    /// Submissions that came while as many frames as may be were in flight.
    pub skipped: u64,
    /// The nodes at the end.
    pub nodes: Vec<NodeStatus>,
    /// Virtual seconds that it took.
    pub secs: f64,
}

impl Plan {
    /// The picture's tiles.
    pub fn grid(&self) -> TileGrid {
        TileGrid::new(self.size, self.tile_edge)
    }

    /// Whether a node is not there from the start.
    fn joins_later(&self, node: NodeIndex) -> bool {
        let by_time = self.nodes[node.0].changes.iter();
        let by_time = by_time.map(|(_, change)| *change);
        let by_frame = self.changes.iter().filter(|(_, of, _)| *of == node);
        let mut changes = by_time.chain(by_frame.map(|(.., change)| *change));
        changes.any(|change| change == Change::Join)
    }
}

impl NodePlan {
    /// An honest node on a local network that streams its tiles.
    pub fn new(round_trip_secs: f64, msamples_per_sec: f64) -> Self {
        Self {
            round_trip_secs,
            jitter_secs: 0.0,
            msamples_per_sec,
            streams: true,
            honesty: 1.0,
            changes: Vec::new(),
        }
    }

    /// The same with a change.
    pub fn with(mut self, at_secs: f64, change: Change) -> Self {
        self.changes.push((at_secs, change));
        self
    }
}

impl Report {
    /// Mean time of the frames with an index in `range`, in seconds.
    pub fn mean_secs(&self, range: std::ops::Range<usize>) -> f64 {
        let frames = &self.frames[range];
        let sum: f64 = frames.iter().map(|frame| frame.stats.makespan_secs).sum();
        sum / frames.len() as f64
    }

    /// The longest time of a frame with an index in `range`, in seconds.
    pub fn worst_secs(&self, range: std::ops::Range<usize>) -> f64 {
        let times = self.frames[range]
            .iter()
            .map(|frame| frame.stats.makespan_secs);
        times.fold(0.0, f64::max)
    }

    /// Tiles that came twice, as a share of all.
    pub fn duplicate_share(&self) -> f64 {
        let duplicates: u32 = self
            .frames
            .iter()
            .map(|frame| frame.stats.duplicate_tiles)
            .sum();
        f64::from(duplicates) / (f64::from(self.tiles_per_frame) * self.frames.len() as f64)
    }
}

/// Runs a plan to its end, or until `secs_max` of virtual time are over.
///
/// # Panics
/// If the coordinator breaks a rule towards a node: asks for tiles outside the picture or for more
/// runs than a session lets in, or gives a run a number that is not above the last.
pub fn run(plan: &Plan, secs_max: f64) -> Report {
    let mut simulation = Simulation::new(plan);
    simulation.run(secs_max);
    simulation.into_report()
}

/// Seconds as they are ordered: nanoseconds, and the order of scheduling where these are equal.
type At = (u64, u64);

/// Something on the agenda.
struct Entry {
    at: At,
    happening: Happening,
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        self.at == other.at
    }
}

impl Eq for Entry {}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// The next one is the greatest, as [`BinaryHeap`] has it.
impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        other.at.cmp(&self.at)
    }
}

enum Happening {
    Submit,
    Command(NodeIndex, u32, Command),
    Step(NodeIndex, u64),
    Event(NodeIndex, u32, LinkEvent),
    Change(NodeIndex, Change),
}

struct Simulation<'a> {
    plan: &'a Plan,
    coordinator: Coordinator,
    nodes: Vec<SimNode>,
    agenda: BinaryHeap<Entry>,
    /// Entries there have been.
    scheduled: u64,
    now: Duration,
    random: Random,
    world: World,
    submitted: u64,
    /// Frames below this have been handed over, or will not be.
    handed: u64,
    lead: Lead,
    schedule: Schedule,
    /// When frames must be shown, by their numbers.
    deadlines: Vec<f64>,
    report: Report,
}

impl<'a> Simulation<'a> {
    fn new(plan: &'a Plan) -> Self {
        let mut coordinator = Coordinator::new(plan.balancing);
        coordinator.set_distribution(plan.distribution);
        coordinator.set_scene(SceneHash([7; 32]), Arc::new(empty_scene()));
        let mut simulation = Self {
            plan,
            coordinator,
            nodes: Vec::new(),
            agenda: BinaryHeap::new(),
            scheduled: 0,
            now: Duration::ZERO,
            random: Random::new(plan.seed),
            world: World::new(plan.seed, plan.weather, plan.grid()),
            submitted: 0,
            handed: 0,
            lead: Lead::default(),
            schedule: Schedule::default(),
            deadlines: Vec::new(),
            report: Report::default(),
        };
        for (index, node) in plan.nodes.iter().enumerate() {
            let index_of = simulation.coordinator.add_node(format!("node {index}"));
            simulation.nodes.push(SimNode::new(index_of, node));
            for (at_secs, change) in &node.changes {
                let at = Duration::from_secs_f64(*at_secs);
                simulation.schedule(at, Happening::Change(index_of, *change));
            }
            if !plan.joins_later(index_of) {
                simulation.schedule(Duration::ZERO, Happening::Change(index_of, Change::Join));
            }
        }
        simulation.schedule(START, Happening::Submit);
        simulation
    }

    fn run(&mut self, secs_max: f64) {
        let end = Duration::from_secs_f64(secs_max);
        while self.handed < self.plan.frames && self.now < end {
            let timeout = self.coordinator.next_timeout();
            let next = self.agenda.peek();
            let next = next.map(|entry| Duration::from_nanos(entry.at.0));
            match (timeout, next) {
                (None, None) => self.now = end,
                (Some(timeout), next) if next.is_none_or(|next| timeout < next) => {
                    self.now = self.now.max(timeout);
                    self.coordinator.handle_timeout(self.now);
                }
                _ => self.happen(),
            }
            self.act();
        }
    }

    fn into_report(mut self) -> Report {
        self.report.secs = self.now.as_secs_f64();
        self.report.tiles_traced = self.nodes.iter().map(|node| node.tiles_traced).sum();
        self.report.nodes = self.coordinator.nodes(self.now);
        self.report
    }

    fn schedule(&mut self, at: Duration, happening: Happening) {
        let at = (at.max(self.now).as_nanos() as u64, self.scheduled);
        self.scheduled += 1;
        self.agenda.push(Entry { at, happening });
    }

    fn happen(&mut self) {
        let Some(Entry { at, happening }) = self.agenda.pop() else {
            return;
        };
        self.now = self.now.max(Duration::from_nanos(at.0));
        match happening {
            Happening::Submit => self.submit(),
            Happening::Change(node, change) => self.change(node, change),
            Happening::Event(node, connection, event) if self.lasts(node, connection) => {
                self.coordinator.handle(self.now, node, event);
            }
            Happening::Command(node, connection, command) if self.lasts(node, connection) => {
                let answers = self.nodes[node.0].command(self.now, &self.world, command);
                self.answer(node, answers);
            }
            Happening::Step(node, step) => {
                let answers = self.nodes[node.0].step(step, self.now, &self.world);
                self.answer(node, answers);
            }
            // Something of a connection that has ended.
            Happening::Event(..) | Happening::Command(..) => {}
        }
    }

    fn submit(&mut self) {
        let in_flight = self.submitted - self.handed;
        let has_room = in_flight < self.plan.frames_in_flight as u64;
        if self.submitted < self.plan.frames && has_room && self.is_time() {
            let id = FrameId(self.submitted);
            self.submitted += 1;
            for (_, node, change) in self.plan.changes.iter().filter(|(at, ..)| *at == id) {
                self.change(*node, *change);
            }
            let spec = frame_spec(self.plan);
            self.coordinator
                .submit(self.now, id, spec, self.plan.tile_edge);
            if let Some(at) = self.deadlines.last() {
                self.coordinator
                    .set_deadline(id, Duration::from_secs_f64(*at));
            }
            if self.plan.period_secs.is_none() {
                self.schedule(self.now, Happening::Submit);
            }
        } else if self.submitted < self.plan.frames && !has_room && self.plan.period_secs.is_some()
        {
            self.report.skipped += 1;
        }
        if let Some(period) = self.plan.period_secs {
            self.schedule(
                self.now + Duration::from_secs_f64(period),
                Happening::Submit,
            );
        }
    }

    /// Whether the next frame is to be asked for; notes when it must be shown, if it must.
    fn is_time(&mut self) -> bool {
        if !self.plan.looks_ahead {
            return true;
        }
        let (now, lead) = (self.now.as_secs_f64(), self.lead.secs());
        let moment = self.schedule.next(now, lead, PERIOD_SECS, f64::INFINITY);
        self.deadlines.extend(moment);
        moment.is_some()
    }

    fn change(&mut self, index: NodeIndex, change: Change) {
        let node = &mut self.nodes[index.0];
        match change {
            Change::Slow(factor) => node.pace *= factor,
            Change::Silent => node.silent = true,
            Change::Fail => node.failing = true,
            Change::Lie(honesty) => node.honesty = honesty,
            Change::Poison => node.poisoned = true,
            Change::Suspend(secs) => self.now += Duration::from_secs_f64(secs),
            Change::Die => {
                node.die();
                let why = "its connection broke".into();
                self.coordinator
                    .handle(self.now, index, LinkEvent::Lost { why, retry: None });
            }
            Change::Join => {
                node.connection += 1;
                node.silent = false;
                self.coordinator
                    .handle(self.now, index, LinkEvent::Connecting);
                let welcome = ClientEvent::Welcome(info(index));
                self.answer(index, vec![Answer::Event(welcome)]);
            }
        }
    }

    /// Carries out what the coordinator wants.
    fn act(&mut self) {
        while let Some(action) = self.coordinator.poll_action() {
            match action {
                Action::Command { node, command } => {
                    self.nodes[node.0].check(&command);
                    let arrival = self.arrival(node, true, 0.0);
                    let connection = self.nodes[node.0].connection;
                    self.schedule(arrival, Happening::Command(node, connection, command));
                }
                Action::Deliver(frame) => self.deliver(*frame),
            }
        }
    }

    fn deliver(&mut self, mut frame: Frame) {
        let grid = self.plan.grid();
        self.report.wrong_frames += u64::from(!is_right(&frame, grid, self.plan.samples));
        self.report.tiles_per_frame = grid.len();
        frame.pixels = Pixels::Linear(Vec::new());
        if frame.id.0 >= self.handed
            && let Some(deadline) = self.deadlines.get(frame.id.0 as usize)
        {
            let late_secs = &mut self.report.shown_late_secs;
            *late_secs = late_secs.max(self.now.as_secs_f64() - deadline);
        }
        self.handed = self.handed.max(frame.id.0 + 1);
        if frame.missing.is_empty() {
            self.lead.observe(frame.stats.makespan_secs);
            self.report.frames.push(frame);
        } else {
            self.report.partial.push(frame);
        }
        if self.plan.period_secs.is_none() {
            self.schedule(self.now, Happening::Submit);
        }
    }

    fn answer(&mut self, node: NodeIndex, answers: Vec<Answer>) {
        let connection = self.nodes[node.0].connection;
        for answer in answers {
            match answer {
                Answer::Event(event) => {
                    let delay =
                        frame_of(&event).map_or(0.0, |frame| self.world.delay_secs(node, frame));
                    let arrival = self.arrival(node, false, delay);
                    let event = LinkEvent::Session(event);
                    self.schedule(arrival, Happening::Event(node, connection, event));
                }
                Answer::StepAt(at, step) => self.schedule(at, Happening::Step(node, step)),
            }
        }
    }

    /// Whether a connection is still the node's.
    fn lasts(&self, node: NodeIndex, connection: u32) -> bool {
        self.nodes[node.0].connection == connection
    }

    /// When a message that leaves now arrives; messages do not overtake each other.
    fn arrival(&mut self, index: NodeIndex, outward: bool, delay_secs: f64) -> Duration {
        let plan = &self.plan.nodes[index.0];
        let jitter = plan.jitter_secs * self.random.exponential();
        let way = Duration::from_secs_f64(0.5 * plan.round_trip_secs + jitter + delay_secs);
        let last = &mut self.nodes[index.0].last_arrival[usize::from(outward)];
        *last = (*last).max(self.now + way);
        *last
    }
}

/// The frame that an event is about.
fn frame_of(event: &ClientEvent) -> Option<FrameId> {
    match event {
        ClientEvent::Tiles { frame, .. }
        | ClientEvent::TilesLate { frame, .. }
        | ClientEvent::RunDone { frame, .. }
        | ClientEvent::RunRefused { frame, .. } => Some(*frame),
        _ => None,
    }
}

/// The first frame is submitted when those nodes that are there from the start have connected.
const START: Duration = Duration::from_millis(500);

fn frame_spec(plan: &Plan) -> FrameSpec {
    FrameSpec {
        update: SceneUpdate::default(),
        size: plan.size,
        settings: RenderSettings {
            samples: plan.samples,
            ..RenderSettings::default()
        },
        format: PixelFormat::LinearF32,
    }
}

/// What a simulated node sends for tiles: each pixel names its frame, its tile and its samples.
fn tile_pixels(request: &TraceRequest, tiles: TileRun) -> TilePixels {
    let mut pixels = Vec::with_capacity(request.grid.pixels(tiles));
    for index in tiles.indices() {
        let count = request.grid.tile(index).pixels();
        let first = request.settings.first_sample;
        let pixel = pixel(
            request.frame,
            index,
            first..first + request.settings.samples,
        );
        pixels.extend(std::iter::repeat_n(pixel, count));
    }
    TilePixels::Linear(pixels)
}

/// What a node sends that has gone wrong.
fn poison(request: &TraceRequest, tiles: TileRun) -> TilePixels {
    TilePixels::Linear(vec![[f32::NAN; 3]; request.grid.pixels(tiles)])
}

/// Whether each pixel is what it should be: where tiles are missing black or, of several passes, the mean
/// of some of its samples.
fn is_right(frame: &Frame, grid: TileGrid, samples: u32) -> bool {
    let Pixels::Linear(pixels) = &frame.pixels else {
        return false;
    };
    let (width, edge) = (grid.size.width, u32::from(grid.edge));
    let mut missing = vec![false; grid.len() as usize];
    for tile in &frame.missing {
        missing[(tile.y / edge * grid.columns() + tile.x / edge) as usize] = true;
    }
    let [.., samples_are] = pixel(frame.id, 0, 0..samples);
    let is_right = |(position, found): (usize, &[f32; 3])| {
        let (x, y) = (position as u32 % width, position as u32 / width);
        let tile = y / edge * grid.columns() + x / edge;
        let [frame_is, tile_is] = [frame.id.0 as f32 + 1.0, tile as f32];
        if !missing[tile as usize] {
            let error = (found[2] / samples_are - 1.0).abs();
            return found[..2] == [frame_is, tile_is] && error < 1e-6;
        }
        *found == [0.0; 3] || frame.stats.passes > 1 && found[..2] == [frame_is, tile_is]
    };
    pixels.len() == grid.size.pixels() && pixels.iter().enumerate().all(is_right)
}

/// Squares, so that no range of samples has the mean of another.
fn pixel(frame: FrameId, tile: u32, samples: Range<u32>) -> [f32; 3] {
    let count = samples.len() as f64;
    let sum: f64 = samples.map(|sample| f64::from(sample + 1).powi(2)).sum();
    [frame.0 as f32 + 1.0, tile as f32, (sum / count) as f32]
}

fn info(index: NodeIndex) -> NodeInfo {
    NodeInfo {
        name: format!("node {}", index.0),
        device: DeviceInfo {
            kind: DeviceKind::Gpu,
            name: "simulated".into(),
            width: 1,
            threads: 1,
        },
    }
}

fn empty_scene() -> Scene {
    Scene {
        camera: Camera {
            eye: Vec3::NEG_Y,
            target: Vec3::ZERO,
            up: Vec3::Z,
            fov_x_deg: 40.0,
        },
        environment: Environment {
            radiance: Vec3::ONE,
        },
        materials: std::collections::BTreeMap::new(),
        objects: Vec::new(),
        lamps: Vec::new(),
    }
}

/// Runs that a node's session would have open.
type OpenRuns = BTreeSet<carom_protocol::RunId>;
