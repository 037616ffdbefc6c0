//! Dispatcher: the node table and the queue of actions, that is commands to nodes and frames to the caller,
//! in the order in which they must be carried out.

use std::collections::VecDeque;
use std::sync::Arc;

use carom_protocol::limits::{REQUEST_SAMPLES_MAX, REQUEST_TILES_MAX};
use carom_protocol::{
    CodedParticles, EncodedScene, FrameId, PrecisionRange, RequestId, SceneHash, TraceRequest,
};
use carom_tracer::{RenderSettings, TileRange};

use super::CoordinatorAction;
use super::checked_tile::CheckedTile;
use super::frame_in_flight::FrameInFlight;
use super::frame_refusals::FrameRefusal;
use super::node_entry::NodeEntry;
use super::node_table::NodeTable;
use super::open_request::OpenRequest;
use super::sample_passes::SamplePasses;
use crate::balancer::Estimate;
use crate::frame::{Frame, FrameSpec};
use crate::link::LinkCommand;
use crate::node_status::NodeIndex;

/// Node table and action queue. A request counts as open in the table as soon as it is queued.
#[derive(Debug)]
pub(super) struct Dispatcher {
    pub(super) nodes: NodeTable,
    actions: VecDeque<CoordinatorAction>,
    last_request: RequestId,
}

/// The part of a request that does not depend on its tiles.
#[derive(Clone, Copy)]
struct RequestedFrame<'a> {
    frame: FrameId,
    scene: SceneHash,
    spec: &'a FrameSpec,
    passes: SamplePasses,
    is_exact: bool,
}

impl Dispatcher {
    pub(super) fn new(nodes: NodeTable) -> Self {
        Self {
            nodes,
            actions: VecDeque::new(),
            last_request: RequestId::default(),
        }
    }

    pub(super) fn send(&mut self, node: NodeIndex, command: LinkCommand) {
        let action = CoordinatorAction::Command { node, command };
        self.actions.push_back(action);
    }

    pub(super) fn send_scene(&mut self, node: NodeIndex, scene: &Arc<EncodedScene>) {
        self.send(node, LinkCommand::Scene(Arc::clone(scene)));
    }

    /// Sends a scene to the connected nodes for which `lacks` holds.
    pub(super) fn announce(
        &mut self,
        scene: &Arc<EncodedScene>,
        lacks: impl Fn(&NodeEntry) -> bool,
    ) {
        for node in self.nodes.indices() {
            if self.nodes[node].is_open() && lacks(&self.nodes[node]) {
                self.send_scene(node, scene);
            }
        }
    }

    pub(super) fn deliver(&mut self, frame: Frame) {
        let action = CoordinatorAction::Deliver(Box::new(frame));
        self.actions.push_back(action);
    }

    pub(super) fn refuse(&mut self, refusal: FrameRefusal) {
        self.actions.push_back(CoordinatorAction::Refuse(refusal));
    }

    /// Queues closing the link to a node.
    pub(super) fn hang_up(&mut self, node: NodeIndex) {
        self.actions.push_back(CoordinatorAction::HangUp(node));
    }

    /// Queues a warning for the log.
    pub(super) fn warn(&mut self, sentence: String) {
        self.actions.push_back(CoordinatorAction::Warn(sentence));
    }

    pub(super) fn poll(&mut self) -> Option<CoordinatorAction> {
        self.actions.pop_front()
    }

    /// Requests ranges of tiles from a node, in order, split into several requests where they exceed the
    /// protocol's limits.
    pub(super) fn request(
        &mut self,
        now: f64,
        node: NodeIndex,
        frame: &mut FrameInFlight,
        tiles: &[TileRange],
        is_probe: bool,
    ) {
        if tiles.is_empty() {
            return;
        }
        let passes = frame.passes;
        let samples = u64::from(frame.spec.settings.samples);
        let tile_samples = u64::from(passes.grid.edge).pow(2) * samples;
        // The protocol's limits of a request, in tiles.
        let most = (REQUEST_SAMPLES_MAX / tile_samples.max(1))
            .clamp(1, u64::from(REQUEST_TILES_MAX)) as u32;
        // The link sends nothing if the node holds it; repeated because a node keeps only the scenes used
        // last.
        self.send_scene(node, &frame.scene);
        let mut wait_secs = self.nodes[node].workload.wait_secs(now, frame.id);
        let of = RequestedFrame {
            frame: frame.id,
            scene: frame.scene.hash(),
            spec: &frame.spec,
            passes,
            is_exact: frame.is_exact,
        };
        for range in tiles.iter().flat_map(|range| passes.split(*range)) {
            for first in range.indices().step_by(most as usize) {
                let count = most.min(range.end() - first);
                let tiles = TileRange { first, count };
                let work = frame.work.of(tiles);
                let mut request = OpenRequest::new(now, frame.id, passes, tiles, work);
                request.is_probe = is_probe;
                // The requests of one call are served one after the other: each is expected after those
                // before it.
                if let Some(busy_secs) = self.request_range(node, of, request, wait_secs) {
                    wait_secs += busy_secs;
                    frame.requested[first as usize..tiles.end() as usize].fill(true);
                }
            }
        }
        self.nodes.arm(node);
    }

    /// Requests a tile that another node has traced, for a spot check; `None` if the node has no room.
    pub(super) fn request_check(
        &mut self,
        now: f64,
        node: NodeIndex,
        tile: &CheckedTile,
    ) -> Option<RequestId> {
        if !self.nodes[node].has_room() {
            return None;
        }
        self.send_scene(node, &tile.scene);
        let mut request = OpenRequest::new(now, tile.frame, tile.passes, tile.unit, tile.work);
        (request.is_probe, request.is_check) = (true, true);
        let of = RequestedFrame {
            frame: tile.frame,
            scene: tile.scene.hash(),
            spec: &tile.spec,
            passes: tile.passes,
            is_exact: true,
        };
        let wait_secs = self.nodes[node].workload.wait_secs(now, tile.frame);
        self.request_range(node, of, request, wait_secs)?;
        self.nodes.arm(node);
        Some(self.last_request)
    }

    /// Sends one request, which waits at its node behind others for `wait_secs`. Returns for how many
    /// seconds the node should be busy with it; `None` if the node has no room, in which case the tiles are
    /// assigned again when one of its requests ends.
    fn request_range(
        &mut self,
        index: NodeIndex,
        of: RequestedFrame<'_>,
        mut request: OpenRequest,
        wait_secs: f64,
    ) -> Option<f64> {
        let node = &mut self.nodes[index];
        if !node.has_room() {
            return None;
        }
        // By the delivered cost, not by the one that divides work: lateness raises the latter, and must not
        // lengthen the timeout of the next request.
        let workload = &mut node.workload;
        let cost = workload.delivered();
        let busy_secs = cost.map_or(0.0, |cost| cost.secs_per_work * request.work);
        request.delay_secs = workload.delay.secs(of.frame);
        let comes = |cost: Estimate| request.issued + cost.fixed_secs + request.delay_secs;
        request.expected = cost.map(|cost| comes(cost) + wait_secs + busy_secs);
        self.last_request = RequestId(self.last_request.0 + 1);
        let samples = of.passes.samples(request.tiles.first);
        let message = Box::new(TraceRequest {
            frame: of.frame,
            id: self.last_request,
            scene: of.scene,
            update: of.spec.update.clone(),
            grid: of.passes.grid,
            tiles: of.passes.tiles(request.tiles),
            settings: RenderSettings {
                samples: samples.len() as u32,
                first_sample: of.spec.settings.first_sample + samples.start,
                ..of.spec.settings
            },
            format: of.spec.format,
            precision: match of.is_exact {
                true => PrecisionRange::EXACT,
                false => PrecisionRange::ANY,
            },
            references: Vec::new(),
            particles: CodedParticles::default(),
        });
        workload.add(request.issued, self.last_request, request);
        self.send(index, LinkCommand::Trace(message));
        Some(busy_secs)
    }

    /// Cancels a request.
    pub(super) fn cancel(&mut self, now: f64, node: NodeIndex, request: RequestId) {
        self.nodes[node].cancel(now, request);
        self.send(node, LinkCommand::CancelRequest(request));
    }

    /// Cancels the open requests of a frame, except probes.
    pub(super) fn cancel_frame(&mut self, now: f64, frame: FrameId) {
        for node in self.nodes.indices() {
            let requests = self.nodes[node].workload.requests.iter();
            let open = requests.filter(|(_, request)| {
                let is_whole = request.tiles_received >= request.tiles.count;
                request.frame == frame && request.is_wanted() && !is_whole
            });
            let open: Vec<RequestId> = open.map(|(id, _)| *id).collect();
            for id in open {
                self.cancel(now, node, id);
            }
        }
    }
}
