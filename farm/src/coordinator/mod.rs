//! Frames in, requests out, tiles in, pictures out: a pure state machine. It knows no clock, no
//! socket and no thread; `now` is an argument, events go in and [`CoordinatorAction`]s come out.
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
//! supports ([`crate::balancer::Estimator`]).

mod arrival_model;
mod assignment;
mod cost_map;
mod frame_buffer;
mod frame_deadline;
mod frame_queue;
mod hedge_budget;
mod node_messages;
mod node_state;
mod open_request;
mod partition;
mod recovery;
mod sample_passes;

use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use carom_protocol::{FrameId, RequestId, SceneHash};
use carom_tracer::{Scene, TileGrid};

use self::cost_map::CostMap;
use self::frame_queue::{FrameInFlight, Pipeline};
use self::hedge_budget::Spare;
use self::node_state::{Connection, Node};
use self::partition::WorkMap;
use self::sample_passes::Passes;
use crate::balancer::Balancers;
use crate::link::{LinkCommand, LinkEvent};
use crate::node_status::NodeIndex;
use crate::{Balancing, Distribution, Frame, FrameSpec, NodeStatus};

/// What the coordinator wants done.
#[derive(Clone, Debug)]
pub enum CoordinatorAction {
    /// Tell a node something.
    Command {
        /// Whom.
        node: NodeIndex,
        /// What.
        command: LinkCommand,
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
    last_run: RequestId,
    last_division: assignment::LastDivision,
    /// Whether there may be tiles that nobody holds.
    unheld: bool,
    actions: VecDeque<CoordinatorAction>,
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
            last_run: RequestId(0),
            last_division: assignment::LastDivision::default(),
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
            let dropped: Vec<RequestId> = dropped.map(|(run, _)| *run).collect();
            for &run in &dropped {
                self.give_up(now, node, run);
            }
            if !dropped.is_empty() {
                self.command(node, LinkCommand::CancelBefore(id));
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
            LinkEvent::Decoded { request, took } => {
                if let Some(run) = self.nodes[node.0].runs.get_mut(&request) {
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
                self.command(index, LinkCommand::Ping(number));
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
    pub fn poll_action(&mut self) -> Option<CoordinatorAction> {
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
            self.actions
                .push_back(CoordinatorAction::Deliver(Box::new(frame)));
        }
    }

    fn command(&mut self, node: NodeIndex, command: LinkCommand) {
        self.actions
            .push_back(CoordinatorAction::Command { node, command });
    }
}

/// A moment that is due when the clock shows it.
fn due(secs: f64) -> Duration {
    Duration::from_secs_f64(secs.max(0.0)) + Duration::from_nanos(100)
}

fn scene_command(hash: SceneHash, scene: &Arc<Scene>) -> LinkCommand {
    LinkCommand::Scene(hash, Arc::clone(scene))
}
