//! Coordinator of a farm: a pure state machine that turns submitted frames into requests to nodes, and the
//! returned tiles into frames. It has no clock, socket or thread: `now` is an argument, events go in and
//! [`CoordinatorAction`]s come out.
//!
//! ```text
//! submit ─▶ FrameQueue ─▶ Assigner ─▶ Dispatcher ─▶ nodes ─▶ tiles ─▶ FrameBuffer ─▶ frame, in order
//!                            ▲            ▲                    │
//!                            │            └────── late tiles ◀───────────┐
//!                            └─ unassigned tiles ◀─── lost, refused, silent: Recovery
//! ```
//!
//! Architecture invariant: a tile enters a frame only from a node that it was requested from, the first
//! copy wins, and a time that a node reports never counts for more than the client's own clock supports
//! ([`crate::balancer::Estimator`]).

mod arrival_model;
mod assignment;
mod checked_tile;
mod cost_map;
mod dispatcher;
mod frame_buffer;
mod frame_forecast;
mod frame_in_flight;
mod frame_queue;
mod frame_refusals;
mod hedge_budget;
mod node_entry;
mod node_table;
mod open_request;
mod partition;
mod recovery;
mod sample_passes;
mod spot_checks;
mod tile_comparison;
mod workload;

use std::sync::Arc;
use std::time::Duration;

use carom_protocol::session::ClientEvent;
use carom_protocol::{EncodedScene, FrameId, RefusalReason, RequestId};
use carom_tracer::{TileGrid, TileRange};

use self::assignment::Assigner;
use self::dispatcher::Dispatcher;
use self::frame_in_flight::{FrameInFlight, TileArrival};
use self::frame_queue::FrameQueue;
pub use self::frame_refusals::FrameRefusal;
use self::node_entry::ConnectionState;
use self::node_table::NodeTable;
use self::recovery::{Recovery, cancel_redundant};
pub use self::spot_checks::SPOT_CHECK_TILES;
use self::spot_checks::{SpotChecks, Verdict};
pub use self::tile_comparison::{differing_share, tiles_agree};
use crate::balancer::Balancer;
use crate::balancing::{Algorithm, Balancing, Distribution};
use crate::frame::{Frame, FrameSpec};
use crate::link::{LinkCommand, LinkEvent};
use crate::node_status::{NodeIndex, NodeStatus};

/// An effect that the caller has to carry out for the coordinator.
#[derive(Clone, Debug)]
pub enum CoordinatorAction {
    /// Passes a command to a node's link.
    Command {
        /// The node.
        node: NodeIndex,
        /// The command.
        command: LinkCommand,
    },
    /// Delivers a frame to the caller: either it and all frames before it are complete, or its deadline has
    /// passed.
    Deliver(Box<Frame>),
    /// Tells the caller that a frame will not be delivered, because every node refuses it.
    Refuse(FrameRefusal),
    /// Closes the link to a node permanently, because it has sent wrong pixels.
    HangUp(NodeIndex),
    /// Logs a warning for the user.
    Warn(String),
}

/// The state machine of the [module](self). All `now` arguments count from one arbitrary, fixed moment.
#[derive(Debug)]
pub struct Coordinator {
    frames: FrameQueue,
    assigner: Assigner,
    recovery: Recovery,
    dispatcher: Dispatcher,
    spot_checks: SpotChecks,
    scene: Option<Arc<EncodedScene>>,
    /// Whether there may be tiles that are requested from no node.
    has_unassigned: bool,
}

impl Coordinator {
    /// A coordinator without nodes.
    pub fn new(balancing: Balancing) -> Self {
        Self {
            frames: FrameQueue::default(),
            assigner: Assigner::new(balancing),
            recovery: Recovery::default(),
            dispatcher: Dispatcher::new(NodeTable::new(balancing.hedged)),
            spot_checks: SpotChecks::default(),
            scene: None,
            has_unassigned: false,
        }
    }

    /// Adds a node whose link is about to connect.
    pub fn add_node(&mut self, address: String) -> NodeIndex {
        self.dispatcher.nodes.add(address)
    }

    /// Adds a node of this process: its pixels are taken as correct where those of others differ.
    pub fn add_local_node(&mut self, address: String) -> NodeIndex {
        let node = self.dispatcher.nodes.add(address);
        self.dispatcher.nodes[node].is_local = true;
        node
    }

    /// Has one in `tiles` tiles ([`SPOT_CHECK_TILES`] by default; 0 for none) traced a second time by
    /// another node. `key` determines which ones and must not be known to any node.
    pub fn set_spot_checks(&mut self, tiles: u32, key: [u8; 32]) {
        self.spot_checks = SpotChecks::new(tiles, key);
    }

    /// Removes a node whose link has ended for good; the next node added reuses its index.
    pub fn remove_node(&mut self, now: Duration, node: NodeIndex) {
        let why = "it has left the directory".into();
        let retry_at = None;
        self.disconnect(node, ConnectionState::Lost { why, retry_at });
        self.dispatcher.nodes.release(node);
        let frames = self.frames.unfinished_mut();
        frames.for_each(|frame| frame.refusals.forget(node));
        self.advance(now.as_secs_f64());
    }

    /// Sets the balancing algorithm of the frames assigned from here on.
    pub fn set_balancing(&mut self, balancing: Balancing) {
        self.assigner.balancing = balancing;
        self.dispatcher.nodes.hedged = balancing.hedged;
    }

    /// Sets an application's own balancing algorithm, with hedging, for the frames assigned from here on.
    pub fn set_balancer(&mut self, balancer: Box<dyn Balancer + Send>) {
        self.assigner.set_own_balancer(balancer);
        self.set_balancing(Algorithm::Own.hedged());
    }

    /// Sets whether the frames assigned from here on are divided by tiles or by samples.
    pub fn set_distribution(&mut self, distribution: Distribution) {
        self.assigner.distribution = distribution;
    }

    /// Announces the scene of the frames to come, so that nodes receive it ahead of the first one.
    pub fn set_scene(&mut self, scene: Arc<EncodedScene>) {
        self.dispatcher.announce(&scene, |_| true);
        self.scene = Some(scene);
    }

    /// Accepts a frame of `scene` on a tile grid with edge `tile_edge`; `exact` as in
    /// [`crate::Submission::exact`]. Its id must exceed those of all earlier frames of its kind (background
    /// or interactive).
    pub fn submit(
        &mut self,
        now: Duration,
        id: FrameId,
        spec: FrameSpec,
        scene: Arc<EncodedScene>,
        tile_edge: u16,
        exact: bool,
    ) {
        let now = now.as_secs_f64();
        let grid = TileGrid::new(spec.size, tile_edge);
        let (passes, work) = self.assigner.predict(id, grid, spec.settings.samples);
        // Background frames are not hedged, so they fill no budget.
        if !id.is_background() {
            self.recovery.budget.add_frame(work.of(passes.all()));
        }
        // A frame's scene need not have come through `set_scene`.
        let hash = scene.hash();
        self.dispatcher
            .announce(&scene, |node| !node.knows_scene(hash));
        let mut frame = FrameInFlight::new(now, id, spec, scene, passes, work);
        frame.is_exact = exact;
        self.frames.push(frame);
        self.has_unassigned = true;
        self.advance(now);
    }

    /// Delivers the frame at `at` as it is, unless it is complete before. Deadlines must not decrease from
    /// frame to frame.
    pub fn set_deadline(&mut self, id: FrameId, at: Duration) {
        self.frames.set_deadline(id, at.as_secs_f64());
    }

    /// Drops a frame and cancels its requests.
    pub fn cancel(&mut self, now: Duration, id: FrameId) {
        let now = now.as_secs_f64();
        self.frames.remove(id);
        self.dispatcher.cancel_frame(now, id);
        self.advance(now);
    }

    /// Handles an event of a node's link.
    pub fn handle(&mut self, now: Duration, node: NodeIndex, event: LinkEvent) {
        let now = now.as_secs_f64();
        match event {
            LinkEvent::Connecting => {
                let connection = self.dispatcher.nodes[node].connecting();
                self.disconnect(node, connection);
            }
            LinkEvent::Lost { why, retry } => {
                let retry_at = retry.map(|pause| now + pause.as_secs_f64());
                if self.dispatcher.nodes[node].is_open() {
                    // A frame may have crashed the node: the loss counts against each frame in flight.
                    let frames = self.frames.unfinished_mut();
                    frames.for_each(|frame| frame.refusals.count(node, false, &why));
                }
                self.disconnect(node, ConnectionState::Lost { why, retry_at });
            }
            LinkEvent::Decoded { request, took } => {
                let requests = &mut self.dispatcher.nodes[node].workload.requests;
                if let Some(request) = requests.get_mut(&request) {
                    request.decode_secs = took.as_secs_f64();
                }
                return;
            }
            LinkEvent::Session(event) => {
                self.handle_session(now, node, event);
                if self.dispatcher.nodes[node].says_farewell() {
                    self.dispatcher.send(node, LinkCommand::Leave);
                }
            }
        }
        self.dispatcher.nodes.arm(node);
        self.advance(now);
    }

    fn handle_session(&mut self, now: f64, index: NodeIndex, event: ClientEvent) {
        let node = &mut self.dispatcher.nodes[index];
        match event {
            ClientEvent::Welcome(info) => {
                node.open(now, info);
                // Frames in flight may be of other scenes than the current one.
                let unfinished = self.frames.unfinished().map(|frame| &frame.scene);
                for scene in unfinished.chain(&self.scene) {
                    self.dispatcher.send_scene(index, scene);
                }
                self.ping(now, index);
            }
            ClientEvent::SceneComing { hash, bytes, of } => node.scene_coming(hash, bytes, of),
            ClientEvent::SceneReady(hash) => {
                if node.scene_ready(hash) {
                    self.has_unassigned = true;
                    Recovery::advance_long(now, &mut self.frames);
                }
            }
            ClientEvent::SceneRefused { hash, why } => node.scene_refused(hash, why),
            ClientEvent::Tiles {
                request,
                tiles,
                pixels,
                busy_micros,
                times,
                dropped_samples,
                payload_bytes,
                precision,
                ..
            } => {
                let tiles = self.units(index, request, tiles);
                let arrival = TileArrival {
                    tiles,
                    pixels: &pixels,
                    dropped_samples,
                    payload_bytes,
                    times,
                    is_lossy: precision.is_lossy(),
                };
                self.receive(now, index, request, tiles, busy_micros);
                self.fill(now, index, request, &arrival);
            }
            ClientEvent::TilesStale {
                request,
                tiles,
                busy_micros,
                ..
            } => {
                let tiles = self.units(index, request, tiles);
                self.receive(now, index, request, tiles, busy_micros);
            }
            ClientEvent::RequestDone { report, .. } => self.close(now, index, report.request),
            ClientEvent::RequestRefused { frame, refusal } => {
                let why = Recovery::refuse(now, node, &refusal);
                if let (Some(why), Some(frame)) = (why, self.frames.get_mut(frame)) {
                    let is_final = matches!(refusal.why, RefusalReason::Invalid(_));
                    frame.refusals.count(index, is_final, &why);
                }
                self.close(now, index, refusal.request);
            }
            ClientEvent::Pong { number, load } => node.pong(now, number, load),
            ClientEvent::Leaving => node.leaving = true,
        }
    }

    /// Does what has become due; to be called at [`Coordinator::next_timeout`].
    pub fn handle_timeout(&mut self, now: Duration) {
        let secs = now.as_secs_f64();
        while let Some(index) = self.dispatcher.nodes.next_due(now) {
            self.ping(secs, index);
            let others_take_over = self.dispatcher.nodes.others_take_over();
            let node = &mut self.dispatcher.nodes[index];
            // Tiles may have been waiting for a node whose back-off has ended.
            self.has_unassigned |= node.resume(secs);
            self.has_unassigned |= node.time_out(secs, others_take_over);
            self.dispatcher.nodes.arm(index);
        }
        self.advance(secs);
        self.recovery
            .evaluate_due(secs, &mut self.frames, &mut self.dispatcher);
        self.deliver_due(secs);
    }

    /// When [`Coordinator::handle_timeout`] must be called next, unless an event comes before.
    pub fn next_timeout(&self) -> Option<Duration> {
        let nodes = self.dispatcher.nodes.next_timeout().into_iter();
        nodes.chain(self.frames.next_timeout()).min()
    }

    /// The next action; to be polled until `None` after each call of another method.
    pub fn poll_action(&mut self) -> Option<CoordinatorAction> {
        self.dispatcher.poll()
    }

    /// Status of the nodes, indexed by [`NodeIndex`].
    pub fn nodes(&self, now: Duration) -> Vec<NodeStatus> {
        let scene = self.scene.as_ref().map(|scene| scene.hash());
        self.dispatcher.nodes.statuses(now.as_secs_f64(), scene)
    }

    /// Unfinished frames with the tiles that have arrived and all tiles. A tile counts once for each pass.
    pub fn progress(&self) -> impl Iterator<Item = (FrameId, u32, u32)> {
        self.frames.unfinished().filter_map(|frame| {
            let all = frame.passes.all().count;
            let missing = frame.buffer.as_ref()?.missing_count();
            Some((frame.id, all - missing, all))
        })
    }

    fn disconnect(&mut self, index: NodeIndex, connection: ConnectionState) {
        self.spot_checks.forget(index);
        self.dispatcher.nodes[index].reset(connection);
        self.has_unassigned = true;
    }

    fn ping(&mut self, now: f64, index: NodeIndex) {
        if let Some(number) = self.dispatcher.nodes[index].ping(now) {
            self.dispatcher.send(index, LinkCommand::Ping(number));
        }
    }

    /// Converts the tiles of a node's message into units of the request's frame.
    fn units(&self, index: NodeIndex, id: RequestId, tiles: TileRange) -> TileRange {
        let request = self.dispatcher.nodes[index].workload.requests.get(&id);
        request.map_or(tiles, |request| {
            request.passes.units(request.tiles.first, tiles)
        })
    }

    /// Updates the node's timing models with tiles that have arrived.
    fn receive(
        &mut self,
        now: f64,
        index: NodeIndex,
        id: RequestId,
        tiles: TileRange,
        busy_micros: u32,
    ) {
        let Some(request) = self.dispatcher.nodes[index].workload.requests.get(&id) else {
            return;
        };
        let busy_secs = f64::from(busy_micros) * 1e-6;
        let frame_work = self.frames.get_mut(request.frame).map(|frame| {
            frame.count_busy(index, busy_secs);
            frame.work.of(tiles)
        });
        let node = &mut self.dispatcher.nodes[index];
        let workload = &mut node.workload;
        self.has_unassigned |= workload.receive(now, id, tiles, busy_secs, frame_work);
        // The node's very first tiles give a provisional cost, without which no arrival can be predicted.
        if node.workload.delivered().is_none() {
            node.observe_first(id);
            self.recovery
                .schedule_waiting(now, &self.dispatcher.nodes, &mut self.frames);
            // Until its first message it was assumed as fast as the others on average, and may be far
            // faster.
            Recovery::advance_guessed(now, &mut self.frames);
        }
        self.assigner.pull(
            now,
            index,
            &mut self.frames,
            &self.recovery,
            &mut self.dispatcher,
        );
        self.recovery
            .advance_late(now, &self.dispatcher.nodes, index, &mut self.frames);
    }

    /// Puts tiles into their frame and finishes the frame if they were the last.
    fn fill(&mut self, now: f64, index: NodeIndex, id: RequestId, arrival: &TileArrival<'_>) {
        let nodes = self.dispatcher.nodes.len();
        if !frame_buffer::is_finite(arrival.pixels) {
            let why = "it sent pixels that are not numbers".to_owned();
            if let Some(frame) = self.dispatcher.nodes[index].workload.requests.get(&id)
                && let Some(frame) = self.frames.get_mut(frame.frame)
            {
                frame.refusals.count(index, false, &why);
            }
            self.dispatcher.nodes[index].back_off(now, Some(why));
            self.dispatcher.cancel(now, index, id);
            self.has_unassigned = true;
            return;
        }
        if self.spot_checks.has(index, id) {
            self.compare(now, index, id, arrival);
            return;
        }
        let node = &mut self.dispatcher.nodes[index];
        node.forgive();
        let Some(request) = node.workload.requests.get(&id) else {
            return;
        };
        let Some(frame) = self.frames.get_mut(request.frame) else {
            return;
        };
        let Some((fresh, split)) = frame.add_tiles(now, index, nodes, request, arrival) else {
            return;
        };
        node.count_tiles(fresh, split);
        if fresh == arrival.tiles.count {
            self.spot_checks
                .offer(now, &mut self.dispatcher, frame, index, arrival);
        }
        if frame.finish(now) {
            self.dispatcher.cancel_frame(now, frame.id);
        } else {
            let tiles = arrival.tiles;
            cancel_redundant(now, frame, tiles, &mut self.dispatcher);
        }
    }

    /// Compares a tile that has been traced a second time, and drops the node that the others outvote.
    fn compare(&mut self, now: f64, index: NodeIndex, id: RequestId, arrival: &TileArrival<'_>) {
        let answer = self
            .spot_checks
            .answer(now, &mut self.dispatcher, (index, id), arrival);
        let nodes = &mut self.dispatcher.nodes;
        let names = |nodes: &NodeTable, of: &[NodeIndex]| {
            let names = of.iter().map(|node| nodes[*node].full_name());
            names.collect::<Vec<_>>().join(" and ")
        };
        match answer {
            None => {}
            Some(Verdict::Agreement(all)) => all.iter().for_each(|node| nodes[*node].agree()),
            Some(Verdict::Wrong(node, right)) => {
                let who = names(nodes, &[node]);
                let right = names(nodes, &right);
                self.dispatcher.warn(format!(
                    "{who} is dropped: it sends wrong pixels, unlike {right} for the same tile. If it \
                     should not, take its certificate back with `carom-farm revoke`"
                ));
                self.drop_node(node, format!("it sent other pixels than {right}"));
            }
            Some(Verdict::Disagreement(all)) => {
                let mut is_new = false;
                for node in &all {
                    let mut others = all.clone();
                    others.retain(|other| other != node);
                    let others = names(nodes, &others);
                    is_new |= nodes[*node].disagree(&others);
                }
                if is_new {
                    let all = names(nodes, &all);
                    self.dispatcher.warn(format!(
                        "{all} send different pixels of the same tile, and no further node tells which \
                         are right: add one"
                    ));
                }
            }
        }
    }

    /// Drops a node permanently and retracts its tiles from unfinished frames.
    fn drop_node(&mut self, index: NodeIndex, why: String) {
        let retry_at = None;
        self.disconnect(index, ConnectionState::Lost { why, retry_at });
        let frames = self.frames.unfinished_mut();
        frames.for_each(|frame| frame.retract(index));
        self.dispatcher.hang_up(index);
    }

    /// Closes a request; one that was refused may leave tiles that are requested from no node.
    fn close(&mut self, now: f64, index: NodeIndex, id: RequestId) {
        // Before the request is removed below.
        self.assigner.learn(&mut self.dispatcher.nodes, index, id);
        self.spot_checks.close(index, id);
        self.has_unassigned |= self.dispatcher.nodes[index].close(now, id);
        // A cancelled or refused request frees its node without a tile arriving, and `pull` runs only on
        // tiles: background pools would not be drawn from.
        self.has_unassigned |= self.frames.has_background();
    }

    /// Assigns unassigned tiles, gives up frames that no node will trace, and delivers finished frames.
    fn advance(&mut self, now: f64) {
        if std::mem::take(&mut self.has_unassigned) {
            self.assigner
                .assign(now, &mut self.frames, &self.recovery, &mut self.dispatcher);
        }
        while let Some(refusal) = self.frames.hopeless(now, &self.dispatcher.nodes) {
            self.frames.remove(refusal.frame);
            self.dispatcher.cancel_frame(now, refusal.frame);
            self.dispatcher.refuse(refusal);
        }
        while let Some(frame) = self.frames.pop_finished() {
            self.dispatcher.deliver(frame);
        }
    }

    /// Delivers the newest frame whose deadline has passed. Older frames with a deadline are dropped, and
    /// their requests cancelled, as they would be shown out of order.
    fn deliver_due(&mut self, now: f64) {
        let Some(newest) = self.frames.newest_due(now) else {
            return;
        };
        for stale in self.frames.remove_stale(newest) {
            self.dispatcher.cancel_frame(now, stale);
        }
        if let Some(frame) = self.frames.take_due(now, newest) {
            self.dispatcher.deliver(frame);
            self.advance(now);
        }
    }
}
