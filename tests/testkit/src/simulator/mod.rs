//! A farm on virtual time: the real coordinator with simulated nodes, links and clock.
//!
//! ```text
//! Plan ─▶ [events by time] ─▶ Coordinator ─▶ commands ─▶ simulated nodes ─▶ events ─▶ … ─▶ Report
//! ```
//!
//! Everything follows from the plan and its seed, so that a failed run can be repeated, and hundreds of
//! frames take less than a second. Each link is in order, with half of the node's round trip each way
//! and exponential jitter; a device works on one run after the other.

mod faults;
mod node;
mod optimum;
mod plan;
mod random_environment;
mod report;
mod scenario;
mod score;
mod tile_source;

use std::cmp::Ordering;
use std::collections::{BTreeSet, BinaryHeap};
use std::sync::Arc;
use std::time::Duration;

use carom_protocol::session::ClientEvent;
use carom_protocol::{EncodedScene, FrameId, NodeInfo};
use carom_tracer::{DeviceInfo, DeviceKind, Tracer};

pub use self::faults::{FaultRun, fault_plan, run_faults};
use self::node::{NodeOutput, SimNode};
pub use self::optimum::optimum_secs;
pub use self::plan::{FarmPlan, NodeChange, NodePlan};
pub use self::random_environment::NetworkConditions;
use self::random_environment::RandomEnvironment;
pub use self::report::SimulationReport;
pub use self::scenario::{Network, PERIOD_SECS, Scenario, SubmissionMode};
pub use self::score::Score;
pub use self::tile_source::empty_scene;
use self::tile_source::{TileSource, ball_on_plane, frame_spec};
use crate::random::SplitMix64;
use carom_farm::NodeIndex;
use carom_farm::balancer::Balancer;
use carom_farm::coordinator::{Coordinator, CoordinatorAction};
use carom_farm::directory::{Directory, Roster};
use carom_farm::link::{LinkCommand, LinkEvent};
use carom_farm::pacing::{FrameSchedule, LeadTime};
use carom_farm::{Frame, Pixels};

/// Runs a plan to its end, or until `secs_max` of virtual time are over.
///
/// # Panics
/// If the coordinator breaks a rule towards a node: asks for tiles outside the picture or for more
/// runs than a session lets in, or gives a run a number that is not above the last.
pub fn run(plan: &FarmPlan, secs_max: f64) -> SimulationReport {
    run_with(plan, secs_max, Extensions::default())
}

/// As [`run`], with parts replaced by an application's own.
///
/// # Panics
/// As [`run`], and if a tracer or a directory of its own fails.
pub fn run_with(plan: &FarmPlan, secs_max: f64, extensions: Extensions) -> SimulationReport {
    let mut simulation = FarmSimulation::new(plan, extensions);
    simulation.run(secs_max);
    simulation.into_report()
}

/// An application's own parts, which replace the simulation's.
#[derive(Default)]
pub struct Extensions {
    /// Replaces [`carom_farm::Algorithm::Own`].
    pub balancer: Option<Box<dyn Balancer + Send>>,
    /// Lists the present nodes, which otherwise join at the start: it is queried at 0 s of virtual time
    /// and after each of its periods. Node `i` of the plan has the address [`node_address`]`(i)`.
    pub directory: Option<Box<dyn Directory>>,
    /// Traces the tiles of all nodes, of a ball on a plane, instead of a test pattern. Nodes still take
    /// the time that the plan gives.
    pub tracer: Option<Arc<dyn Tracer + Send + Sync>>,
}

/// The address at which directories list a node of the plan.
pub fn node_address(index: usize) -> String {
    format!("node-{index}:{NODE_PORT}")
}

/// Order of events: virtual time in nanoseconds, and the order of scheduling where these are equal.
type At = (u64, u64);

/// An event of the queue.
struct ScheduledEvent {
    at: At,
    event: SimulationEvent,
}

impl PartialEq for ScheduledEvent {
    fn eq(&self, other: &Self) -> bool {
        self.at == other.at
    }
}

impl Eq for ScheduledEvent {}

impl PartialOrd for ScheduledEvent {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Reversed, as [`BinaryHeap`] is a max-heap: the next event is the greatest.
impl Ord for ScheduledEvent {
    fn cmp(&self, other: &Self) -> Ordering {
        other.at.cmp(&self.at)
    }
}

enum SimulationEvent {
    Submit,
    Command(NodeIndex, u32, LinkCommand),
    Step(NodeIndex, u64),
    Event(NodeIndex, u32, LinkEvent),
    NodeChange(NodeIndex, NodeChange),
    AskDirectory,
}

struct FarmSimulation<'a> {
    plan: &'a FarmPlan,
    coordinator: Coordinator,
    scene: Arc<EncodedScene>,
    nodes: Vec<SimNode>,
    events: BinaryHeap<ScheduledEvent>,
    /// Number of events scheduled so far.
    scheduled: u64,
    now: Duration,
    random: SplitMix64,
    environment: RandomEnvironment,
    submitted: u64,
    /// Frames below this have been delivered, or never will be.
    handed: u64,
    lead: LeadTime,
    schedule: FrameSchedule,
    /// Times in s at which frames must be shown, by their numbers.
    deadlines: Vec<f64>,
    report: SimulationReport,
    tile_source: Arc<TileSource>,
    directory: Option<(Box<dyn Directory>, Roster)>,
}

impl<'a> FarmSimulation<'a> {
    fn new(plan: &'a FarmPlan, extensions: Extensions) -> Self {
        let mut coordinator = Coordinator::new(plan.balancing);
        if let Some(balancer) = extensions.balancer {
            coordinator.set_balancer(balancer);
            coordinator.set_balancing(plan.balancing);
        }
        coordinator.set_distribution(plan.distribution);
        coordinator.set_spot_checks(plan.spot_check_tiles, [plan.seed as u8; 32]);
        let scene = match extensions.tracer {
            Some(_) => ball_on_plane(),
            None => empty_scene(),
        };
        let tile_source = Arc::new(TileSource::new(plan, &scene, extensions.tracer));
        let scene = EncodedScene::new(&scene).expect("a right scene");
        coordinator.set_scene(Arc::clone(&scene));
        let directory = extensions.directory.map(|directory| {
            let mut roster = Roster::default();
            roster.add_directory();
            (directory, roster)
        });
        let mut simulation = Self {
            plan,
            coordinator,
            scene,
            nodes: Vec::new(),
            events: BinaryHeap::new(),
            scheduled: 0,
            now: Duration::ZERO,
            random: SplitMix64::new(plan.seed),
            environment: RandomEnvironment::new(plan.seed, plan.conditions, plan.grid()),
            submitted: 0,
            handed: 0,
            lead: LeadTime::default(),
            schedule: FrameSchedule::default(),
            deadlines: Vec::new(),
            report: SimulationReport::default(),
            tile_source,
            directory,
        };
        simulation.add_nodes();
        simulation.schedule(START, SimulationEvent::Submit);
        simulation
    }

    fn add_nodes(&mut self) {
        let plan = self.plan;
        for (index, node) in plan.nodes.iter().enumerate() {
            let name = format!("node {index}");
            let index = match node.is_local {
                true => self.coordinator.add_local_node(name),
                false => self.coordinator.add_node(name),
            };
            let tile_source = Arc::clone(&self.tile_source);
            self.nodes.push(SimNode::new(index, node, tile_source));
            for (at_secs, change) in &node.changes {
                let at = Duration::from_secs_f64(*at_secs);
                self.schedule(at, SimulationEvent::NodeChange(index, *change));
            }
            if self.directory.is_none() && !plan.joins_later(index) {
                let joins = SimulationEvent::NodeChange(index, NodeChange::Join);
                self.schedule(Duration::ZERO, joins);
            }
        }
        if self.directory.is_some() {
            self.schedule(Duration::ZERO, SimulationEvent::AskDirectory);
        }
    }

    fn run(&mut self, secs_max: f64) {
        let end = Duration::from_secs_f64(secs_max);
        while self.handed < self.plan.frames && self.now < end {
            let timeout = self.coordinator.next_timeout();
            let next = self.events.peek();
            let next = next.map(|entry| Duration::from_nanos(entry.at.0));
            match (timeout, next) {
                (None, None) => self.now = end,
                (Some(timeout), next) if next.is_none_or(|next| timeout < next) => {
                    self.now = self.now.max(timeout);
                    self.coordinator.handle_timeout(self.now);
                }
                _ => self.handle_next_event(),
            }
            self.act();
        }
    }

    fn into_report(mut self) -> SimulationReport {
        self.report.secs = self.now.as_secs_f64();
        self.report.tiles_traced = self.nodes.iter().map(|node| node.tiles_traced).sum();
        self.report.nodes = self.coordinator.nodes(self.now);
        self.report
    }

    fn schedule(&mut self, at: Duration, event: SimulationEvent) {
        let at = (at.max(self.now).as_nanos() as u64, self.scheduled);
        self.scheduled += 1;
        self.events.push(ScheduledEvent { at, event });
    }

    fn handle_next_event(&mut self) {
        let Some(ScheduledEvent { at, event }) = self.events.pop() else {
            return;
        };
        self.now = self.now.max(Duration::from_nanos(at.0));
        match event {
            SimulationEvent::Submit => self.submit(),
            SimulationEvent::NodeChange(node, change) => self.change(node, change),
            SimulationEvent::AskDirectory => self.ask_directory(),
            SimulationEvent::Event(node, connection, event)
                if self.is_current_connection(node, connection) =>
            {
                self.coordinator.handle(self.now, node, event);
            }
            SimulationEvent::Command(node, connection, command)
                if self.is_current_connection(node, connection) =>
            {
                let answers = self.nodes[node.0].command(self.now, &self.environment, command);
                self.answer(node, answers);
            }
            SimulationEvent::Step(node, step) => {
                let answers = self.nodes[node.0].step(step, self.now, &self.environment);
                self.answer(node, answers);
            }
            // A message of a connection that has ended.
            SimulationEvent::Event(..) | SimulationEvent::Command(..) => {}
        }
    }

    /// Connects to the nodes that the directory lists for the first time; those that it no longer lists
    /// stay.
    fn ask_directory(&mut self) {
        let Some((directory, roster)) = &mut self.directory else {
            return;
        };
        let listed = directory.nodes().expect("the directory answers");
        let mut called = Vec::new();
        for address in roster.update(0, listed) {
            let mut addresses = (0..self.plan.nodes.len()).map(node_address);
            if let Some(index) = addresses.position(|other| other == address.to_string()) {
                roster.call(NodeIndex(index), address);
                called.push(NodeIndex(index));
            }
        }
        let period = directory.period();
        for index in called {
            self.change(index, NodeChange::Join);
        }
        if let Some(next) = self.now.checked_add(period) {
            self.schedule(next, SimulationEvent::AskDirectory);
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
            let (scene, edge) = (self.scene.clone(), self.plan.tile_edge);
            let coordinator = &mut self.coordinator;
            coordinator.submit(self.now, id, spec, scene, edge, false);
            if let Some(at) = self.deadlines.last() {
                self.coordinator
                    .set_deadline(id, Duration::from_secs_f64(*at));
            }
            if self.plan.period_secs.is_none() {
                self.schedule(self.now, SimulationEvent::Submit);
            }
        } else if self.submitted < self.plan.frames && !has_room && self.plan.period_secs.is_some()
        {
            self.report.skipped += 1;
        }
        if let Some(period) = self.plan.period_secs {
            self.schedule(
                self.now + Duration::from_secs_f64(period),
                SimulationEvent::Submit,
            );
        }
    }

    /// Whether the next frame is to be submitted; records the time at which it must be shown, if there
    /// is one.
    fn is_time(&mut self) -> bool {
        if !self.plan.looks_ahead {
            return true;
        }
        let (now, lead) = (self.now.as_secs_f64(), self.lead.secs());
        let moment = self.schedule.next(now, lead, PERIOD_SECS, f64::INFINITY);
        self.deadlines.extend(moment);
        moment.is_some()
    }

    fn change(&mut self, index: NodeIndex, change: NodeChange) {
        let node = &mut self.nodes[index.0];
        match change {
            NodeChange::Slow(factor) => node.pace *= factor,
            NodeChange::Silent => node.silent = true,
            NodeChange::Fail => node.failing = true,
            NodeChange::Lie(honesty) => node.honesty = honesty,
            NodeChange::Poison => node.poisoned = true,
            NodeChange::Forge(one_in) => node.forges = Some(one_in),
            NodeChange::Suspend(secs) => self.now += Duration::from_secs_f64(secs),
            NodeChange::Die => {
                node.die();
                let why = "its connection broke".into();
                self.coordinator
                    .handle(self.now, index, LinkEvent::Lost { why, retry: None });
            }
            NodeChange::Drain => {
                self.answer(index, vec![NodeOutput::Event(ClientEvent::Leaving)]);
            }
            NodeChange::Join => {
                node.connection += 1;
                node.silent = false;
                self.coordinator
                    .handle(self.now, index, LinkEvent::Connecting);
                let welcome = ClientEvent::Welcome(info(index));
                self.answer(index, vec![NodeOutput::Event(welcome)]);
            }
        }
    }

    /// Carries out the coordinator's actions.
    fn act(&mut self) {
        while let Some(action) = self.coordinator.poll_action() {
            match action {
                CoordinatorAction::Command { node, command } => {
                    self.nodes[node.0].check(&command);
                    let arrival = self.arrival(node, true, 0.0);
                    let connection = self.nodes[node.0].connection;
                    self.schedule(arrival, SimulationEvent::Command(node, connection, command));
                }
                CoordinatorAction::Deliver(frame) => self.deliver(*frame),
                CoordinatorAction::HangUp(node) => self.nodes[node.0].die(),
                CoordinatorAction::Warn(sentence) => self.report.warnings.push(sentence),
                CoordinatorAction::Refuse(refusal) => {
                    self.handed = self.handed.max(refusal.frame.0 + 1);
                    self.report.refused.push(refusal);
                }
            }
        }
    }

    fn deliver(&mut self, mut frame: Frame) {
        let grid = self.plan.grid();
        self.report.wrong_frames +=
            u64::from(!self.tile_source.is_right(&frame, grid, self.plan.samples));
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
            self.schedule(self.now, SimulationEvent::Submit);
        }
    }

    fn answer(&mut self, node: NodeIndex, answers: Vec<NodeOutput>) {
        let connection = self.nodes[node.0].connection;
        for answer in answers {
            match answer {
                NodeOutput::Event(event) => {
                    let delay = frame_of(&event)
                        .map_or(0.0, |frame| self.environment.delay_secs(node, frame));
                    let arrival = self.arrival(node, false, delay);
                    let event = LinkEvent::Session(event);
                    self.schedule(arrival, SimulationEvent::Event(node, connection, event));
                }
                NodeOutput::End => {
                    let arrival = self.arrival(node, false, 0.0);
                    self.schedule(arrival, SimulationEvent::NodeChange(node, NodeChange::Die));
                }
                NodeOutput::StepAt(at, step) => {
                    self.schedule(at, SimulationEvent::Step(node, step))
                }
            }
        }
    }

    /// Whether a connection is the node's current one.
    fn is_current_connection(&self, node: NodeIndex, connection: u32) -> bool {
        self.nodes[node.0].connection == connection
    }

    /// Time of arrival of a message that is sent now; messages do not overtake each other.
    fn arrival(&mut self, index: NodeIndex, outward: bool, delay_secs: f64) -> Duration {
        let plan = &self.plan.nodes[index.0];
        let jitter = plan.jitter_secs * self.random.exponential();
        let way = Duration::from_secs_f64(0.5 * plan.round_trip_secs + jitter + delay_secs);
        let last = &mut self.nodes[index.0].last_arrival[usize::from(outward)];
        *last = (*last).max(self.now + way);
        *last
    }
}

/// The frame that an event belongs to.
fn frame_of(event: &ClientEvent) -> Option<FrameId> {
    match event {
        ClientEvent::Tiles { frame, .. }
        | ClientEvent::TilesStale { frame, .. }
        | ClientEvent::RequestDone { frame, .. }
        | ClientEvent::RequestRefused { frame, .. } => Some(*frame),
        _ => None,
    }
}

/// Time at which the first frame is submitted: the nodes that are present from the start have
/// connected.
const START: Duration = Duration::from_millis(500);

fn info(index: NodeIndex) -> NodeInfo {
    NodeInfo {
        name: format!("node {}", index.0),
        instance: 0,
        device: DeviceInfo {
            kind: DeviceKind::Gpu,
            name: "simulated".into(),
            width: 1,
            threads: 1,
        },
    }
}

/// The port in [`node_address`].
const NODE_PORT: u16 = 4433;

/// The open requests of a node's session.
type OpenRuns = BTreeSet<carom_protocol::RequestId>;
