//! The frames in flight, and the pace at which they come.

use std::collections::VecDeque;
use std::sync::Arc;

use carom_protocol::{FrameId, SceneHash};
use carom_tracer::{Scene, TileRange};

use super::NodeIndex;
use super::frame_buffer::Film;
use super::partition::WorkMap;
use super::sample_passes::Passes;
use crate::{Frame, FrameSpec, FrameStats, LatencySplit};

/// A frame that has been submitted and not been delivered.
#[derive(Debug)]
pub(super) struct FrameInFlight {
    pub(super) id: FrameId,
    pub(super) spec: FrameSpec,
    pub(super) scene: (SceneHash, Arc<Scene>),
    pub(super) passes: Passes,
    pub(super) work: WorkMap,
    pub(super) submitted: f64,
    /// Absent once it is finished.
    pub(super) film: Option<Film>,
    /// Whether its tiles have been handed out once.
    pub(super) divided: bool,
    /// What more than one node has been asked for.
    pub(super) asked_again: Vec<TileRange>,
    /// Tiles that nodes have not taken yet, where they take them as they can.
    pub(super) pool: TileRange,
    /// When it should be whole.
    pub(super) target: f64,
    /// How long it should take when it is divided.
    pub(super) planned_secs: f64,
    /// When it is looked at for tiles that will be late; absent while there is no prediction.
    pub(super) hedge_at: Option<f64>,
    pub(super) last_look: f64,
    /// When it must be shown, if it has not been handed over by then.
    pub(super) deadline: Option<f64>,
    /// Whether older frames with this set are of no use once it has been handed over.
    pub(super) perishes: bool,
    pub(super) stats: FrameStats,
    /// By node.
    busy_secs: Vec<f64>,
    pub(super) finished: Option<Frame>,
}

impl FrameInFlight {
    pub(super) fn new(
        now: f64,
        id: FrameId,
        spec: FrameSpec,
        scene: (SceneHash, Arc<Scene>),
        passes: Passes,
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
            film: Some(Film::new(passes, spec.format)),
            spec,
            scene,
            passes,
            submitted: now,
            divided: false,
            asked_again: Vec::new(),
            pool: TileRange { first: 0, count: 0 },
            target: f64::INFINITY,
            planned_secs: f64::INFINITY,
            hedge_at: None,
            last_look: now,
            deadline: None,
            perishes: false,
            stats,
            busy_secs: Vec::new(),
            finished: None,
        }
    }

    /// Cuts it into passes before it is handed out. `costs` are of its tiles.
    pub(super) fn cut(&mut self, count: u32, costs: &[f64]) {
        let passes = Passes::several(self.passes.grid, self.spec.settings.samples, count);
        self.work = WorkMap::new(passes, costs);
        self.film = Some(Film::new(passes, self.spec.format));
        self.stats.passes = count;
        self.passes = passes;
    }

    /// A node worked on it.
    pub(super) fn note_busy(&mut self, node: NodeIndex, secs: f64) {
        let nodes = self.busy_secs.len().max(node.0 + 1);
        self.busy_secs.resize(nodes, 0.0);
        self.busy_secs[node.0] += secs;
        self.stats.busy_secs = self.stats.busy_secs.max(self.busy_secs[node.0]);
    }

    /// Notes where the time of a node's latest tiles went, before its response is noted. A share is
    /// asked for in several requests at once: what the later ones wait for while the earlier ones
    /// are traced is tracing.
    pub(super) fn note_split(&mut self, node: NodeIndex, mut split: LatencySplit) -> LatencySplit {
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

    /// How much later than its target a tile may come before it is asked for again, in seconds.
    pub(super) fn margin_secs(&self, price: f64) -> f64 {
        let planned = self.target - self.submitted;
        let share = if planned.is_finite() {
            MARGIN_SHARE * planned
        } else {
            0.0
        };
        price * (MARGIN_SECS + share)
    }

    /// Ends it if all tiles are there. `true` if it has just ended.
    pub(super) fn finish(&mut self, now: f64) -> bool {
        let Some(film) = self.film.take_if(|film| film.is_complete()) else {
            return false;
        };
        self.stats.makespan_secs = now - self.submitted;
        self.hedge_at = None;
        self.finished = Some(Frame {
            id: self.id,
            size: self.spec.size,
            pixels: film.into_pixels(),
            missing: Vec::new(),
            stats: std::mem::take(&mut self.stats),
        });
        true
    }
}

/// Frames in the order of submission.
#[derive(Debug, Default)]
pub(super) struct Pipeline {
    frames: VecDeque<FrameInFlight>,
    last_submit: Option<f64>,
    period_secs: Option<f64>,
}

impl Pipeline {
    pub(super) fn push(&mut self, frame: FrameInFlight) {
        let overlaps = self.iter().any(|earlier| earlier.film.is_some());
        let interval = self.last_submit.map(|last| frame.submitted - last);
        self.last_submit = Some(frame.submitted);
        self.period_secs = match (overlaps, interval, self.period_secs) {
            (false, ..) => None,
            (true, Some(new), Some(old)) => Some(old + PERIOD_GAIN * (new - old)),
            (true, new, None) => new,
            (true, None, old) => old,
        };
        self.frames.push_back(frame);
    }

    /// The oldest frame, if it is finished.
    pub(super) fn pop_finished(&mut self) -> Option<Frame> {
        let frame = self.frames.front_mut()?.finished.take()?;
        self.frames.pop_front();
        Some(frame)
    }

    pub(super) fn remove(&mut self, id: FrameId) {
        self.frames.retain(|frame| frame.id != id);
    }

    pub(super) fn drop_before(&mut self, id: FrameId) {
        self.frames.retain(|frame| frame.id >= id);
    }

    /// Seconds between frames while they overlap, else infinite.
    pub(super) fn period_secs(&self) -> f64 {
        self.period_secs
            .filter(|secs| *secs > 0.0)
            .unwrap_or(f64::INFINITY)
    }

    pub(super) fn by_id(&mut self, id: FrameId) -> Option<&mut FrameInFlight> {
        self.frames.iter_mut().find(|frame| frame.id == id)
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &FrameInFlight> {
        self.frames.iter()
    }

    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = &mut FrameInFlight> {
        self.frames.iter_mut()
    }

    /// The frames that are not finished, oldest first.
    pub(super) fn unfinished(&self) -> Vec<FrameId> {
        let unfinished = self.iter().filter(|frame| frame.film.is_some());
        unfinished.map(|frame| frame.id).collect()
    }
}

/// Share of an interval's deviation that the period follows.
const PERIOD_GAIN: f64 = 0.1;
/// How late a tile may be: so many seconds, and a share of the time that the frame should take.
const MARGIN_SECS: f64 = 0.25e-3;
const MARGIN_SHARE: f64 = 0.01;
