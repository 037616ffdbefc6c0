//! Frames in, requests out, tiles in, pictures out: a pure state machine. It knows no clock, no
//! socket and no thread; `now` is an argument, events go in and [`Action`]s come out.
//!
//! ```text
//! submit ─▶ divide (balancer) ─▶ runs ─▶ nodes ─▶ tiles ─▶ film ─▶ frame, in order
//!              ▲                                    │
//!              └── tiles that nobody holds ◀── lost, refused, silent
//!                  tiles that are late ◀─────── hedge
//! ```
//!
//! Architecture invariant: a tile enters a film only from a node that was asked for it, the first
//! one wins, and a node's word about time never counts for more than the client's own clock
//! supports ([`balancer::Estimator`]).

pub mod balancer;

mod cost_map;
mod deadline;
mod divide;
mod film;
mod hedge;
mod passes;
mod pipeline;
mod progress;
mod roster;
mod run;
mod spare;
mod work;

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use carom_protocol::session::ClientEvent;
use carom_protocol::tile_codec::TilePixels;
use carom_protocol::{FrameId, NodeTimes, Refusal, RefusalReason, RunId, SceneHash};
use carom_tracer::{Scene, TileGrid, TileRun};

use self::balancer::{Balancers, Estimator, Observation, Outcome};
use self::cost_map::CostMap;
use self::passes::Passes;
use self::pipeline::{FrameInFlight, Pipeline};
use self::roster::{Connection, Node};
use self::spare::Spare;
use self::work::WorkMap;
use crate::link::{Command, LinkEvent};
use crate::{Balancing, Delivery, Distribution, Frame, FrameSpec, NodeStatus};

/// A node of a farm: its place in [`crate::Farm::nodes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeIndex(pub usize);

/// What the coordinator wants done.
#[derive(Clone, Debug)]
pub enum Action {
    /// Tell a node something.
    Command {
        /// Whom.
        node: NodeIndex,
        /// What.
        command: Command,
    },
    /// A picture is finished, and so are all before it; or its deadline has passed.
    Deliver(Box<Frame>),
}

/// See the [module](self). Durations count from any moment that stays the same.
#[derive(Debug)]
pub struct Coordinator {
    balancing: Balancing,
    distribution: Distribution,
    balancers: Balancers,
    nodes: Vec<Node>,
    /// When to look at which node, at the earliest.
    timers: BinaryHeap<Reverse<(Duration, NodeIndex)>>,
    costs: CostMap,
    spare: Spare,
    frames: Pipeline,
    scene: Option<(SceneHash, Arc<Scene>)>,
    last_run: RunId,
    last_division: divide::LastDivision,
    /// Whether there may be tiles that nobody holds.
    unheld: bool,
    actions: VecDeque<Action>,
}

impl Coordinator {
    /// A coordinator without nodes.
    pub fn new(balancing: Balancing) -> Self {
        Self {
            balancing,
            distribution: Distribution::Tiles,
            balancers: Balancers::default(),
            nodes: Vec::new(),
            timers: BinaryHeap::new(),
            costs: CostMap::default(),
            spare: Spare::default(),
            frames: Pipeline::default(),
            scene: None,
            last_run: RunId(0),
            last_division: divide::LastDivision::default(),
            unheld: false,
            actions: VecDeque::new(),
        }
    }

    /// Adds a node that is about to be called.
    pub fn add_node(&mut self, address: String) -> NodeIndex {
        self.nodes.push(Node::new(address));
        NodeIndex(self.nodes.len() - 1)
    }

    /// Divides frames in another way from the next one on.
    pub fn set_balancing(&mut self, balancing: Balancing) {
        self.balancing = balancing;
    }

    /// Divides frames by something else from the next one on.
    pub fn set_distribution(&mut self, distribution: Distribution) {
        self.distribution = distribution;
    }

    /// Frames submitted from now on are of `scene`, whose hash is `hash`.
    pub fn set_scene(&mut self, hash: SceneHash, scene: Arc<Scene>) {
        for node in (0..self.nodes.len()).map(NodeIndex) {
            if self.nodes[node.0].is_open() {
                self.command(node, scene_command(hash, &scene));
            }
        }
        self.scene = Some((hash, scene));
    }

    /// Takes on a frame, of a tile grid with `tile_edge`. Its id must be above all before it.
    ///
    /// # Panics
    /// If no scene has been set.
    pub fn submit(&mut self, now: Duration, id: FrameId, spec: FrameSpec, tile_edge: u16) {
        let now = now.as_secs_f64();
        let scene = self
            .scene
            .clone()
            .expect("a scene is set before frames are submitted");
        let grid = TileGrid::new(spec.size, tile_edge);
        let passes = Passes::one(grid, spec.settings.samples);
        let work = WorkMap::new(passes, self.costs.of(grid));
        self.spare.add_frame(work.of(passes.all()));
        self.frames
            .push(FrameInFlight::new(now, id, spec, scene, passes, work));
        self.unheld = true;
        self.advance(now);
    }

    /// Drops all frames before `id`.
    pub fn cancel_before(&mut self, now: Duration, id: FrameId) {
        let now = now.as_secs_f64();
        self.frames.drop_before(id);
        for node in (0..self.nodes.len()).map(NodeIndex) {
            let runs = self.nodes[node.0].runs.iter();
            let dropped = runs.filter(|(_, run)| run.frame < id && !run.cancelled);
            let dropped: Vec<RunId> = dropped.map(|(run, _)| *run).collect();
            for &run in &dropped {
                self.give_up(now, node, run);
            }
            if !dropped.is_empty() {
                self.command(node, Command::CancelBefore(id));
            }
        }
        self.advance(now);
    }

    /// Takes note of what a link reports.
    pub fn handle(&mut self, now: Duration, node: NodeIndex, event: LinkEvent) {
        let now = now.as_secs_f64();
        match event {
            LinkEvent::Connecting => self.disconnect(node, Connection::Connecting),
            LinkEvent::Lost { why, retry } => {
                let retry_at = retry.map(|pause| now + pause.as_secs_f64());
                self.disconnect(node, Connection::Lost { why, retry_at });
            }
            LinkEvent::Session(event) => self.handle_session(now, node, event),
            LinkEvent::Decoded { run, took } => {
                if let Some(run) = self.nodes[node.0].runs.get_mut(&run) {
                    run.decode_secs = took.as_secs_f64();
                }
                return;
            }
        }
        self.arm(node);
        self.advance(now);
    }

    /// Does what has become due: see [`Coordinator::next_timeout`].
    pub fn handle_timeout(&mut self, now: Duration) {
        while let Some(index) = self.next_due(now) {
            let now = now.as_secs_f64();
            if let Some(number) = self.nodes[index.0].ping(now) {
                self.command(index, Command::Ping(number));
            }
            let node = &mut self.nodes[index.0];
            self.unheld |= node.wake(now);
            self.unheld |= node.falls_silent(now, self.balancing.hedged);
            self.arm(index);
        }
        let now = now.as_secs_f64();
        self.advance(now);
        self.hedge(now);
        self.show_due(now);
    }

    /// When [`Coordinator::handle_timeout`] wants to be called, unless something happens before.
    pub fn next_timeout(&self) -> Option<Duration> {
        let node = self.timers.peek().map(|Reverse((at, _))| *at);
        let frames = self.frames.iter();
        let frames = frames.flat_map(|frame| [frame.hedge_at, frame.deadline]);
        let frame = frames.flatten().reduce(f64::min).map(due);
        node.into_iter().chain(frame).min()
    }

    /// The next thing to do; to be asked until there is none after each call of another method.
    pub fn poll_action(&mut self) -> Option<Action> {
        self.actions.pop_front()
    }

    /// How the nodes are, by [`NodeIndex`].
    pub fn nodes(&self, now: Duration) -> Vec<NodeStatus> {
        let scene = self.scene.as_ref().map(|(hash, _)| *hash);
        let nodes = self.nodes.iter();
        nodes
            .map(|node| node.status(now.as_secs_f64(), scene))
            .collect()
    }

    /// Sees to it that a node is looked at when it is due.
    fn arm(&mut self, index: NodeIndex) {
        let node = &mut self.nodes[index.0];
        let Some(at) = node.next_timeout(self.balancing.hedged).map(due) else {
            return;
        };
        if node.armed.is_none_or(|armed| at < armed) {
            node.armed = Some(at);
            self.timers.push(Reverse((at, index)));
        }
    }

    /// A node that may have something due.
    fn next_due(&mut self, now: Duration) -> Option<NodeIndex> {
        while let Some(Reverse((at, index))) = self.timers.peek().copied() {
            if at > now {
                return None;
            }
            self.timers.pop();
            let node = &mut self.nodes[index.0];
            if node.armed == Some(at) {
                node.armed = None;
                return Some(index);
            }
        }
        None
    }

    fn handle_session(&mut self, now: f64, index: NodeIndex, event: ClientEvent) {
        let node = &mut self.nodes[index.0];
        match event {
            ClientEvent::Welcome(info) => {
                node.open(now, info);
                if let Some((hash, scene)) = self.scene.clone() {
                    self.command(index, scene_command(hash, &scene));
                }
                self.handle_ping(now, index);
            }
            ClientEvent::SceneComing { hash, percent } => node.scene_coming(hash, percent),
            ClientEvent::SceneReady(hash) => {
                if node.scene_ready(hash) {
                    self.unheld = true;
                    self.hasten_hedges(now);
                }
            }
            ClientEvent::SceneRefused { hash, why } => node.scene_refused(hash, why),
            ClientEvent::Tiles {
                run,
                tiles,
                pixels,
                busy_micros,
                times,
                dropped_samples,
                payload_bytes,
                ..
            } => {
                let tiles = self.units(index, run, tiles);
                self.receive(now, index, run, tiles, busy_micros);
                let dropped = u64::from(dropped_samples);
                self.fill(
                    now,
                    index,
                    run,
                    tiles,
                    &pixels,
                    dropped,
                    payload_bytes,
                    times,
                );
            }
            ClientEvent::TilesLate {
                run,
                tiles,
                busy_micros,
                ..
            } => {
                let tiles = self.units(index, run, tiles);
                self.receive(now, index, run, tiles, busy_micros);
            }
            ClientEvent::RunDone { report, .. } => self.close(now, index, report.run),
            ClientEvent::RunRefused { refusal, .. } => self.refused(now, index, refusal),
            ClientEvent::Pong(number) => node.pong(now, number),
        }
    }

    fn handle_ping(&mut self, now: f64, index: NodeIndex) {
        if let Some(number) = self.nodes[index.0].ping(now) {
            self.command(index, Command::Ping(number));
        }
    }

    /// What tiles of a run are among the units of its frame.
    fn units(&self, index: NodeIndex, id: RunId, tiles: TileRun) -> TileRun {
        let run = self.nodes[index.0].runs.get(&id);
        run.map_or(tiles, |run| run.passes.units(run.tiles.first, tiles))
    }

    /// Takes note of how long tiles took.
    fn receive(&mut self, now: f64, index: NodeIndex, id: RunId, tiles: TileRun, micros: u32) {
        let node = &mut self.nodes[index.0];
        if let Some(expected) = node.next_message(None)
            && node.is_next(id)
        {
            node.rhythm.observe(now - expected);
        }
        self.unheld |= node.hear(now, id);
        let pace = node.delivered().map_or(0.0, |line| line.secs_per_work);
        let Some(run) = node.runs.get_mut(&id) else {
            return;
        };
        let busy_secs = f64::from(micros) * 1e-6;
        let share = f64::from(tiles.count) / f64::from(run.tiles.count);
        let work = match self.frames.by_id(run.frame) {
            Some(frame) => frame.work.of(tiles),
            None => run.work * share,
        };
        if let Some(frame) = self.frames.by_id(run.frame) {
            frame.note_busy(index, busy_secs);
            run.pieces.push((tiles, work, busy_secs));
        }
        run.receive(now, tiles, work, busy_secs, pace);
        let of_frame = run.frame;
        node.prove(of_frame, work);
        if node.delivered().is_none() {
            self.learn(index, id, false);
            self.predict_newcomers(now);
        }
        self.pull(now, index);
        self.watch(now, index);
    }

    /// Puts tiles into their film and finishes the frame if they were the last.
    #[expect(clippy::too_many_arguments, reason = "the fields of one event")]
    fn fill(
        &mut self,
        now: f64,
        index: NodeIndex,
        id: RunId,
        tiles: TileRun,
        pixels: &TilePixels,
        dropped_samples: u64,
        payload_bytes: usize,
        times: NodeTimes,
    ) {
        let nodes = self.nodes.len();
        if !film::is_finite(pixels) {
            let why = "it sent pixels that are not numbers".into();
            self.nodes[index.0].rest(now, Some(why));
            self.give_up(now, index, id);
            self.command(index, Command::CancelRun(id));
            self.unheld = true;
            return;
        }
        self.nodes[index.0].trust();
        let Some(run) = self.nodes[index.0].runs.get(&id) else {
            return;
        };
        let Some(frame) = self.frames.by_id(run.frame) else {
            return;
        };
        let Some(film) = &mut frame.film else {
            return;
        };
        let filled = film.fill(tiles, pixels);
        frame.stats.payload_bytes += payload_bytes as u64;
        frame.stats.duplicate_tiles += tiles.count - filled;
        if filled == tiles.count {
            frame.stats.dropped_samples += dropped_samples;
        }
        frame.stats.tiles_by_node.resize(nodes, 0);
        frame.stats.tiles_by_node[index.0] += filled;
        let split = frame.note_split(index, run.split(now, frame.submitted, times));
        frame.stats.response_secs_by_node.resize(nodes, 0.0);
        frame.stats.response_secs_by_node[index.0] = now - frame.submitted;
        // Noted by `receive` just before.
        let (_, work, busy_secs) = run.pieces.last().copied().unwrap_or((tiles, 0.0, 0.0));
        frame.stats.deliveries.push(Delivery {
            node: index,
            tiles: run.passes.tiles(tiles),
            fresh_tiles: filled,
            work,
            expected_secs: run.expected.map(|at| at - frame.submitted),
            arrived_secs: now - frame.submitted,
            busy_secs,
            split,
            payload_bytes: u32::try_from(payload_bytes).unwrap_or(u32::MAX),
        });
        self.nodes[index.0].deliver(filled, split);
        let id = frame.id;
        if frame.finish(now) {
            self.release(now, id);
        }
    }

    /// Takes back what is still asked for a frame that is finished, but for probes.
    fn release(&mut self, now: f64, frame: FrameId) {
        for node in (0..self.nodes.len()).map(NodeIndex) {
            let runs = self.nodes[node.0].runs.iter();
            let open = runs.filter(|(_, run)| run.frame == frame && run.counts());
            let open = open.filter(|(_, run)| run.tiles_received < run.tiles.count);
            let open: Vec<RunId> = open.map(|(run, _)| *run).collect();
            for run in open {
                self.give_up(now, node, run);
                self.command(node, Command::CancelRun(run));
            }
        }
    }

    /// Marks a run as not wanted, and learns from its lateness.
    fn give_up(&mut self, now: f64, index: NodeIndex, id: RunId) {
        let node = &mut self.nodes[index.0];
        let round_trip_secs = node.round_trip_secs();
        let Some(run) = node.runs.get_mut(&id) else {
            return;
        };
        run.cancelled = true;
        let late = run.expected.is_none_or(|expected| now >= expected);
        let missed = late && run.tiles_received == 0;
        let (secs, queue_secs) = (now - run.issued, run.queue_secs(round_trip_secs));
        node.estimator
            .observe_late(run.work, secs, queue_secs, missed);
    }

    fn refused(&mut self, now: f64, index: NodeIndex, refusal: Refusal) {
        let node = &mut self.nodes[index.0];
        let wanted = node
            .runs
            .get(&refusal.run)
            .is_some_and(|run| !run.cancelled);
        match refusal.why {
            RefusalReason::Cancelled | RefusalReason::Busy if wanted => node.rest(now, None),
            RefusalReason::Cancelled | RefusalReason::Busy => {}
            RefusalReason::UnknownScene => {
                node.rest(
                    now,
                    Some("it has lost the scene, which is sent again".into()),
                );
            }
            RefusalReason::Invalid(why) => {
                node.rest(now, Some(format!("it calls a request invalid: {why}")));
            }
            RefusalReason::Device(why) => {
                node.rest(now, Some(format!("its device failed: {why}")));
            }
        }
        self.close(now, index, refusal.run);
    }

    /// Ends a run; one that was refused may leave tiles that nobody holds.
    fn close(&mut self, now: f64, index: NodeIndex, id: RunId) {
        self.learn(index, id, true);
        let node = &mut self.nodes[index.0];
        let had_room = node.has_room();
        if let Some(run) = node.runs.remove(&id) {
            self.unheld |= run.tiles_received < run.tiles.count;
            node.lose(&run);
        }
        self.unheld |= node.hear(now, id) || !had_room;
    }

    /// Tells the estimator, and the balancers if it has ended, how a run went, if anything came.
    fn learn(&mut self, index: NodeIndex, id: RunId, ended: bool) {
        let node = &mut self.nodes[index.0];
        let Some(run) = node.runs.get(&id) else {
            return;
        };
        if run.tiles_received == 0 || run.work_received <= 0.0 {
            return;
        }
        let response_secs = (run.heard - run.issued).max(0.0);
        let busy_secs = run.busy_secs.clamp(0.0, response_secs);
        let observation = Observation {
            work: run.work_received,
            response_secs,
            queue_secs: run.queue_secs(node.round_trip_secs()).min(response_secs),
            busy_secs,
            round_trip_secs: node.round_trip_secs(),
        };
        if ended {
            node.estimator.observe(&observation);
            self.learn_costs(index, id, &observation);
        } else {
            node.estimator.observe_first(&observation);
        }
        let run = &self.nodes[index.0].runs[&id];
        if ended && !run.probe {
            self.balancers.learn(&Outcome {
                node: index,
                tiles: run.tiles_received,
                work: run.work_received,
                response_secs,
                busy_secs,
            });
        }
    }

    /// Lets the cost map know how long each part of a run took. What the node says counts only
    /// within the run; how long the whole took is what its estimate has been told.
    fn learn_costs(&mut self, index: NodeIndex, id: RunId, seen: &Observation) {
        let node = &mut self.nodes[index.0];
        let run = &node.runs[&id];
        if run.tiles_received == run.tiles.count {
            node.rhythm.end(run);
        }
        let Some(line) = node.delivered() else {
            return;
        };
        let secs = Estimator::work_secs(seen);
        let in_parts = run.pieces.iter().all(|(.., busy)| *busy > 0.0);
        for (tiles, work, busy) in &run.pieces {
            let ratio = if in_parts {
                secs * busy / (run.busy_secs * line.secs_per_work * work)
            } else {
                secs / (line.secs_per_work * run.work_received)
            };
            let tiles = run.passes.tiles(*tiles);
            self.costs.learn(run.passes.grid, tiles, ratio);
        }
    }

    fn disconnect(&mut self, index: NodeIndex, connection: Connection) {
        self.nodes[index.0].reset(connection);
        self.unheld = true;
    }

    /// Hands out what nobody holds, and delivers what is finished.
    fn advance(&mut self, now: f64) {
        if std::mem::take(&mut self.unheld) {
            self.divide(now);
        }
        while let Some(frame) = self.frames.pop_finished() {
            self.actions.push_back(Action::Deliver(Box::new(frame)));
        }
    }

    fn command(&mut self, node: NodeIndex, command: Command) {
        self.actions.push_back(Action::Command { node, command });
    }
}

/// A moment that is due when the clock shows it.
fn due(secs: f64) -> Duration {
    Duration::from_secs_f64(secs.max(0.0)) + Duration::from_nanos(100)
}

fn scene_command(hash: SceneHash, scene: &Arc<Scene>) -> Command {
    Command::Scene(hash, Arc::clone(scene))
}
