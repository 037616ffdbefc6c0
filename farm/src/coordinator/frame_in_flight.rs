//! A frame that has been submitted and not yet delivered: its tiles so far, its plan, and its statistics.

use std::sync::Arc;

use carom_protocol::tile_codec::TilePixels;
use carom_protocol::{EncodedScene, FrameId, NodeTimes};
use carom_tracer::TileRange;

use super::frame_buffer::FrameBuffer;
use super::frame_refusals::FrameRefusals;
use super::open_request::OpenRequest;
use super::partition::WorkMap;
use super::sample_passes::SamplePasses;
use crate::frame::{Frame, FrameSpec};
use crate::node_status::NodeIndex;
use crate::stats::{Delivery, FrameStats, LatencySplit};

/// State of one frame. Times are seconds on the client's clock.
#[derive(Debug)]
pub(super) struct FrameInFlight {
    pub(super) id: FrameId,
    pub(super) spec: FrameSpec,
    pub(super) scene: Arc<EncodedScene>,
    pub(super) passes: SamplePasses,
    pub(super) work: WorkMap,
    pub(super) submitted: f64,
    /// Whether links must not reduce the precision of its pixels.
    pub(super) is_exact: bool,
    /// The tiles that have arrived; absent once it is finished.
    pub(super) buffer: Option<FrameBuffer>,
    /// Whether its tiles have been assigned for the first time.
    pub(super) is_assigned: bool,
    /// Whether some node that took part in the first assignment had no delivered cost.
    pub(super) is_guessed: bool,
    /// By unit: whether it has been requested and not been lost since.
    pub(super) requested: Vec<bool>,
    /// Ranges that have been assigned more than once, including those that only waited for room.
    pub(super) reissued: Vec<TileRange>,
    /// Ranges that no node has pulled yet, where nodes pull their tiles.
    pub(super) pool: Vec<TileRange>,
    /// When it should be complete.
    pub(super) target: f64,
    /// How many seconds it should take, as of its assignment.
    pub(super) planned_secs: f64,
    /// When it is next evaluated for late tiles; absent while there is no prediction.
    pub(super) evaluate_at: Option<f64>,
    pub(super) last_evaluation: f64,
    /// When it must be shown, unless it has been delivered before.
    pub(super) deadline: Option<f64>,
    /// Whether it has had a deadline: it is dropped once a newer frame has been delivered.
    pub(super) perishes: bool,
    pub(super) refusals: FrameRefusals,
    pub(super) stats: FrameStats,
    /// Reported busy seconds, by node.
    busy_secs: Vec<f64>,
    pub(super) finished: Option<Frame>,
}

/// Tiles of a node's message: units of one pass, and their pixels.
pub(super) struct TileArrival<'a> {
    pub(super) tiles: TileRange,
    pub(super) pixels: &'a TilePixels,
    pub(super) dropped_samples: u32,
    pub(super) payload_bytes: usize,
    pub(super) times: NodeTimes,
    /// Whether JPEG has changed the pixels.
    pub(super) is_lossy: bool,
}

impl FrameInFlight {
    pub(super) fn new(
        now: f64,
        id: FrameId,
        spec: FrameSpec,
        scene: Arc<EncodedScene>,
        passes: SamplePasses,
        work: WorkMap,
    ) -> Self {
        let stats = FrameStats {
            raw_bytes: (spec.size.pixels() * spec.format.bytes()) as u64,
            tile_edge: passes.grid.edge,
            passes: 1,
            tile_work: work.tiles().collect(),
            ..FrameStats::default()
        };
        Self {
            id,
            work,
            buffer: Some(FrameBuffer::new(passes, spec.format)),
            spec,
            scene,
            passes,
            submitted: now,
            is_exact: false,
            is_assigned: false,
            is_guessed: false,
            requested: vec![false; passes.all().count as usize],
            reissued: Vec::new(),
            pool: Vec::new(),
            target: f64::INFINITY,
            planned_secs: f64::INFINITY,
            evaluate_at: None,
            last_evaluation: now,
            deadline: None,
            perishes: false,
            refusals: FrameRefusals::default(),
            stats,
            busy_secs: Vec::new(),
            finished: None,
        }
    }

    /// Splits it into passes before its assignment. `costs` are the relative costs of its tiles.
    pub(super) fn split_into_passes(&mut self, count: u32, costs: &[f64]) {
        let passes = SamplePasses::several(self.passes.grid, self.spec.settings.samples, count);
        self.work = WorkMap::new(passes, costs);
        self.buffer = Some(FrameBuffer::new(passes, self.spec.format));
        self.requested = vec![false; passes.all().count as usize];
        self.stats.passes = count;
        self.passes = passes;
    }

    /// Counts the lost ones among unassigned tiles, which are those that a node had been asked for. The
    /// others have only waited for room.
    pub(super) fn count_lost(&mut self, tiles: &[TileRange]) {
        let tile = |tile: u32| std::mem::take(&mut self.requested[tile as usize]);
        let lost = tiles.iter().flat_map(|range| range.indices()).map(tile);
        let lost: u32 = lost.map(u32::from).sum();
        self.stats.reissued_tiles += lost;
        self.stats.lost_tiles += lost;
        self.reissued.extend(tiles);
    }

    /// Adds time that a node reports to have worked on it.
    pub(super) fn count_busy(&mut self, node: NodeIndex, secs: f64) {
        let nodes = self.busy_secs.len().max(node.0 + 1);
        self.busy_secs.resize(nodes, 0.0);
        self.busy_secs[node.0] += secs;
        self.stats.busy_secs = self.stats.busy_secs.max(self.busy_secs[node.0]);
    }

    /// Stores tiles that have arrived for `request` from one of `nodes` nodes. Returns how many of them
    /// were missing, and where their time went; `None` if the frame is finished.
    pub(super) fn add_tiles(
        &mut self,
        now: f64,
        node: NodeIndex,
        nodes: usize,
        request: &OpenRequest,
        arrival: &TileArrival<'_>,
    ) -> Option<(u32, LatencySplit)> {
        let tiles = arrival.tiles;
        // Tiles show that the node can trace this frame.
        self.refusals.forget(node);
        let fresh = self.buffer.as_mut()?.fill(tiles, arrival.pixels);
        let arrived_secs = now - self.submitted;
        let split = request.split(now, self.submitted, arrival.times);
        let split = self.note_split(node, split);
        let stats = &mut self.stats;
        stats.payload_bytes += arrival.payload_bytes as u64;
        stats.duplicate_tiles += tiles.count - fresh;
        if fresh == tiles.count {
            // The count is per message: with duplicates in it, the dropped samples cannot be attributed to
            // the tiles that were kept.
            stats.dropped_samples += u64::from(arrival.dropped_samples);
        }
        stats.tiles_by_node.resize(nodes, 0);
        stats.tiles_by_node[node.0] += fresh;
        stats.response_secs_by_node.resize(nodes, 0.0);
        stats.response_secs_by_node[node.0] = arrived_secs;
        // Pushed by `Workload::receive` just before.
        let (_, work, busy_secs) = request.pieces.last().copied().unwrap_or((tiles, 0.0, 0.0));
        stats.deliveries.push(Delivery {
            node,
            tiles: request.passes.tiles(tiles),
            fresh_tiles: fresh,
            work,
            expected_secs: request.expected.map(|at| at - self.submitted),
            arrived_secs,
            busy_secs,
            split,
            payload_bytes: u32::try_from(arrival.payload_bytes).unwrap_or(u32::MAX),
        });
        Some((fresh, split))
    }

    /// Records where the time of a node's latest tiles went; to be called before its response time is
    /// recorded. A share is sent as several requests at once: the time that the later ones wait while the
    /// earlier ones are traced counts as tracing.
    fn note_split(&mut self, node: NodeIndex, mut split: LatencySplit) -> LatencySplit {
        let splits = self.stats.split_by_node.len().max(node.0 + 1);
        self.stats
            .split_by_node
            .resize(splits, LatencySplit::default());
        let noted = &mut self.stats.split_by_node[node.0];
        let answered = self.stats.response_secs_by_node.get(node.0).copied() > Some(0.0);
        if answered && noted.request_secs == split.request_secs {
            let earlier = (split.queue_secs - noted.queue_secs).max(0.0);
            split.queue_secs -= earlier;
            split.trace_secs += earlier;
        }
        *noted = split;
        split
    }

    /// Removes the tiles of a node whose pixels are wrong; with several passes, whose sums cannot be
    /// separated, all tiles.
    pub(super) fn retract(&mut self, node: NodeIndex) {
        let Some(buffer) = &mut self.buffer else {
            return;
        };
        let several = self.passes.count() > 1;
        let is_out = |delivery: &Delivery| several || delivery.node == node;
        let out = self
            .stats
            .deliveries
            .extract_if(.., |delivery| is_out(delivery));
        for delivery in out {
            // Without fresh tiles, those in the buffer are another node's.
            if delivery.fresh_tiles > 0 {
                buffer.clear(delivery.tiles);
            }
            self.stats.tiles_by_node[delivery.node.0] = 0;
            self.stats.response_secs_by_node[delivery.node.0] = 0.0;
        }
        if several {
            *buffer = FrameBuffer::new(self.passes, self.spec.format);
        }
    }

    /// Mean number of times that each tile has been reassigned.
    pub(super) fn reissued_per_tile(&self) -> f64 {
        let reissued: u32 = self.reissued.iter().map(|range| range.count).sum();
        f64::from(reissued) / f64::from(self.passes.all().count.max(1))
    }

    /// Seconds after its target from which on a tile is requested again: `price` times the usual margin.
    pub(super) fn margin_secs(&self, price: f64) -> f64 {
        let planned = self.target - self.submitted;
        let share = if planned.is_finite() {
            MARGIN_SHARE * planned
        } else {
            0.0
        };
        price * (MARGIN_SECS + share)
    }

    /// Finishes it if all tiles have arrived. Returns whether it did.
    pub(super) fn finish(&mut self, now: f64) -> bool {
        let Some(buffer) = self.buffer.take_if(|buffer| buffer.is_complete()) else {
            return false;
        };
        self.stats.makespan_secs = now - self.submitted;
        self.evaluate_at = None;
        self.finished = Some(Frame {
            id: self.id,
            size: self.spec.size,
            pixels: buffer.into_pixels(),
            missing: Vec::new(),
            stats: std::mem::take(&mut self.stats),
        });
        true
    }

    /// A frame of the tiles so far; `None` if it is finished.
    pub(super) fn partial_frame(&mut self, now: f64) -> Option<Frame> {
        let buffer = self.buffer.as_ref()?;
        let late = buffer.missing(self.passes.all(), |_| true);
        self.stats.late_tiles = late.iter().map(|range| range.count).sum();
        let mut stats = self.stats.clone();
        stats.makespan_secs = now - self.submitted;
        Some(Frame {
            id: self.id,
            size: self.spec.size,
            pixels: buffer.pixels(),
            missing: buffer.missing_tiles(),
            stats,
        })
    }
}

/// Usual lateness margin: a constant in seconds, plus a share of the frame's planned duration.
const MARGIN_SECS: f64 = 0.25e-3;
const MARGIN_SHARE: f64 = 0.01;
