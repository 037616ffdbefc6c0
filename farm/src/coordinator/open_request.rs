//! A request that a node has not answered in full.

use carom_protocol::{FrameId, NodeTimes};
use carom_tracer::TileRange;

use super::sample_passes::Passes;
use crate::LatencySplit;
use crate::balancer::Estimate;

/// Times are seconds on the client's clock.
#[derive(Clone, Debug)]
pub(super) struct Run {
    pub(super) frame: FrameId,
    pub(super) passes: Passes,
    /// Units of one pass.
    pub(super) tiles: TileRange,
    pub(super) work: f64,
    pub(super) issued: f64,
    /// By how much its node's messages for its frame were late when it was asked for: see [`super::arrival_model::Drift`].
    pub(super) drift_secs: f64,
    /// When the last tile should come; absent while nothing is known of the node.
    pub(super) expected: Option<f64>,
    /// Whether the frame does without: the tile has been asked of another node too.
    pub(super) probe: bool,
    pub(super) cancelled: bool,
    /// Whether its node has been silent for so long that others are asked for it.
    pub(super) lost: bool,
    pub(super) tiles_received: u32,
    pub(super) work_received: f64,
    /// Work of the messages that came together last, and the most of any.
    burst_work: f64,
    pub(super) burst_max: f64,
    /// What came of a frame that was still known: tiles, their work, and the seconds that the node
    /// says they took.
    pub(super) pieces: Vec<(TileRange, f64, f64)>,
    /// Since when its pace is seen, and what had come by then: from the first message on, or from the
    /// one before it, of another run.
    seen_since: f64,
    seen_work: f64,
    /// When the last tiles came.
    pub(super) heard: f64,
    pub(super) busy_secs: f64,
    /// Of the next tiles.
    pub(super) decode_secs: f64,
    /// When the node was last heard to work for an earlier request: until then this one may have
    /// been waiting.
    pub(super) others_until: f64,
}

impl Run {
    /// A request for `tiles` of one pass, of which nothing has come.
    pub(super) fn new(
        now: f64,
        frame: FrameId,
        passes: Passes,
        tiles: TileRange,
        work: f64,
    ) -> Self {
        Self {
            frame,
            passes,
            tiles,
            work,
            issued: now,
            drift_secs: 0.0,
            expected: None,
            probe: false,
            cancelled: false,
            lost: false,
            tiles_received: 0,
            work_received: 0.0,
            burst_work: 0.0,
            burst_max: 0.0,
            pieces: Vec::new(),
            seen_since: now,
            seen_work: 0.0,
            heard: now,
            busy_secs: 0.0,
            decode_secs: 0.0,
            others_until: now,
        }
    }

    /// Takes note of tiles that have come of a node with that line: they take longer than the time
    /// between messages that come together.
    pub(super) fn receive(
        &mut self,
        now: f64,
        tiles: TileRange,
        work: f64,
        busy_secs: f64,
        line: Option<Estimate>,
        is_first: bool,
    ) {
        let pace = line.map_or(0.0, |line| line.secs_per_work);
        if self.tiles_received == 0 {
            let asked = line.map_or(now, |line| self.issued + line.fixed_secs);
            let follows = self.others_until > asked && !is_first;
            (self.seen_since, self.seen_work) = if follows {
                (self.others_until, 0.0)
            } else {
                (now, work)
            };
        }
        let together = self.tiles_received > 0 && now - self.heard < TOGETHER * pace * work;
        self.burst_work = work + if together { self.burst_work } else { 0.0 };
        self.burst_max = self.burst_max.max(self.burst_work);
        self.work_received += work;
        self.tiles_received += tiles.count;
        self.busy_secs += busy_secs;
        self.heard = now;
    }

    /// From when on its missing work counts, by the client's clock, if nothing else is before it.
    pub(super) fn begins(&self, line: Estimate) -> f64 {
        match self.tiles_received {
            0 => (self.issued + line.fixed_secs + self.drift_secs).max(self.others_until),
            _ => self.heard,
        }
    }

    /// Seconds per unit of work as it comes, of which `grace_secs` are put down to its way; 0 if that
    /// cannot be told yet.
    pub(super) fn pace(&self, grace_secs: f64) -> f64 {
        let work = self.work_received - self.seen_work;
        if work > 0.0 {
            (self.heard - self.seen_since - grace_secs) / work
        } else {
            0.0
        }
    }

    /// Work that is still to come, if it is wanted.
    pub(super) fn outstanding(&self) -> f64 {
        if self.cancelled {
            return 0.0;
        }
        (self.work - self.work_received).max(0.0)
    }

    /// Where the time of tiles went that are there now, of a frame `submitted` then. A node that says
    /// it worked longer than it was waited for is believed no more than that.
    pub(super) fn split(&self, now: f64, submitted: f64, times: NodeTimes) -> LatencySplit {
        let mut left = now - self.issued;
        let mut part = |secs: f64| {
            let secs = secs.clamp(0.0, left.max(0.0));
            left -= secs;
            secs
        };
        let micros = |micros: u32| 1e-6 * f64::from(micros);
        LatencySplit {
            request_secs: (self.issued - submitted).max(0.0),
            decode_secs: part(self.decode_secs),
            encode_secs: part(micros(times.encode_micros)),
            trace_secs: part(micros(times.trace_micros)),
            queue_secs: part(micros(times.queue_micros)),
            network_secs: left.max(0.0),
        }
    }

    /// Whether the frame relies on it.
    pub(super) fn counts(&self) -> bool {
        self.is_wanted() && !self.lost
    }

    /// Whether it is taken back when the frame needs it no more.
    pub(super) fn is_wanted(&self) -> bool {
        !self.cancelled && !self.probe
    }

    /// How long the request waited behind earlier ones, by the client's clock: from when it reached
    /// the node until the last earlier message left there, a round trip less than what is seen here.
    pub(super) fn queue_secs(&self, round_trip_secs: Option<f64>) -> f64 {
        (self.others_until - self.issued - round_trip_secs.unwrap_or(0.0)).max(0.0)
    }
}

/// Messages come together if the time between them is less than this share of their work's.
const TOGETHER: f64 = 0.25;
