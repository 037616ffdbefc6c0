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

mod divide;
mod film;
mod hedge;
mod pipeline;
mod roster;
mod run;
mod work;

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use carom_protocol::session::ClientEvent;
use carom_protocol::tile_codec::TilePixels;
use carom_protocol::{FrameId, Refusal, RefusalReason, RunId, SceneHash};
use carom_tracer::{Scene, TileRun};

use self::balancer::{Balancers, Observation, Outcome};
use self::pipeline::{FrameInFlight, Pipeline};
use self::roster::{Connection, Node};
use crate::link::{Command, LinkEvent};
use crate::{Algorithm, Frame, FrameSpec, NodeStatus};

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
    /// A picture is finished, and so are all before it.
    Deliver(Box<Frame>),
}

/// See the [module](self). Durations count from any moment that stays the same.
#[derive(Debug)]
pub struct Coordinator {
    algorithm: Algorithm,
    balancers: Balancers,
    nodes: Vec<Node>,
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
    pub fn new(algorithm: Algorithm) -> Self {
        Self {
            algorithm,
            balancers: Balancers::default(),
            nodes: Vec::new(),
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

    /// Divides frames by `algorithm` from the next one on.
    pub fn set_algorithm(&mut self, algorithm: Algorithm) {
        self.algorithm = algorithm;
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
        self.frames
            .push(FrameInFlight::new(now, id, spec, scene, tile_edge));
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
            LinkEvent::Lost { why } => self.disconnect(node, Connection::Lost(why)),
            LinkEvent::Session(event) => self.handle_session(now, node, event),
        }
        self.advance(now);
    }

    /// Does what has become due: see [`Coordinator::next_timeout`].
    pub fn handle_timeout(&mut self, now: Duration) {
        let now = now.as_secs_f64();
        for node in (0..self.nodes.len()).map(NodeIndex) {
            if let Some(number) = self.nodes[node.0].ping(now) {
                self.command(node, Command::Ping(number));
            }
            self.unheld |= self.nodes[node.0].wake(now);
            self.unheld |= self.nodes[node.0].falls_silent(now);
        }
        self.advance(now);
        self.hedge(now);
    }

    /// When [`Coordinator::handle_timeout`] wants to be called, unless something happens before.
    pub fn next_timeout(&self) -> Option<Duration> {
        let nodes = self.nodes.iter().filter_map(Node::next_timeout);
        let frames = self.frames.iter().filter_map(|frame| frame.hedge_at);
        let next = nodes.chain(frames).reduce(f64::min)?;
        // Rounded up, so that it is due when the time comes.
        Some(Duration::from_secs_f64(next.max(0.0)) + Duration::from_nanos(100))
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
                dropped_samples,
                payload_bytes,
                ..
            } => {
                self.receive(now, index, run, tiles, busy_micros);
                let dropped = u64::from(dropped_samples);
                self.fill(now, index, run, tiles, &pixels, dropped, payload_bytes);
            }
            ClientEvent::TilesLate {
                run,
                tiles,
                busy_micros,
                ..
            } => self.receive(now, index, run, tiles, busy_micros),
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

    /// Takes note of how long tiles took.
    fn receive(&mut self, now: f64, index: NodeIndex, id: RunId, tiles: TileRun, micros: u32) {
        let node = &mut self.nodes[index.0];
        node.hear(now, id);
        let Some(run) = node.runs.get_mut(&id) else {
            return;
        };
        let share = f64::from(tiles.count) / f64::from(run.tiles.count);
        let work = match self.frames.by_id(run.frame) {
            Some(frame) => frame.work.of(tiles),
            None => run.work * share,
        };
        run.work_received += work;
        run.message_work = run.message_work.max(work);
        run.tiles_received += tiles.count;
        run.busy_secs += f64::from(micros) * 1e-6;
        run.heard = now;
        if let Some(frame) = self.frames.by_id(run.frame) {
            frame.note_busy(index, f64::from(micros) * 1e-6);
        }
        if node.delivered().is_none() {
            self.learn(index, id, false);
            self.predict_newcomers(now);
        }
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
    ) {
        let nodes = self.nodes.len();
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
        self.nodes[index.0].deliver(filled);
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
        node.hear(now, id);
        node.runs.remove(&id);
        self.unheld = true;
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
        let response_secs = run.heard - run.issued;
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
        } else {
            node.estimator.observe_first(&observation);
        }
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

fn scene_command(hash: SceneHash, scene: &Arc<Scene>) -> Command {
    Command::Scene(hash, Arc::clone(scene))
}
