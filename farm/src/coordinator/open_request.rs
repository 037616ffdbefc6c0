//! A request that a node has not answered in full.

use carom_protocol::{FrameId, NodeTimes};
use carom_tracer::TileRange;

use super::sample_passes::SamplePasses;
use crate::balancer::Estimate;
use crate::stats::LatencySplit;

/// Times are seconds on the client's clock.
#[derive(Clone, Debug)]
pub(super) struct OpenRequest {
    pub(super) frame: FrameId,
    pub(super) passes: SamplePasses,
    /// Units of one pass.
    pub(super) tiles: TileRange,
    pub(super) work: f64,
    pub(super) issued: f64,
    /// By how much its node's messages for its frame were late when it was asked for: see
    /// [`super::arrival_model::FrameDelay`].
    pub(super) delay_secs: f64,
    /// When the last tile should come; absent while nothing is known of the node.
    pub(super) expected: Option<f64>,
    /// Whether the frame does without: the tile has been asked of another node too.
    pub(super) is_probe: bool,
    /// Whether it is a probe only to compare its tile: nothing is learned from how long it takes.
    pub(super) is_check: bool,
    pub(super) is_cancelled: bool,
    /// Whether its node has been silent for so long that others are asked for it.
    pub(super) is_lost: bool,
    pub(super) tiles_received: u32,
    pub(super) work_received: f64,
    /// Work of the messages that came together last, and the most of any.
    burst_work: f64,
    pub(super) burst_max: f64,
    /// Messages for a frame that was still known: tiles, their work, and the seconds that the node
    /// says they took.
    pub(super) pieces: Vec<(TileRange, f64, f64)>,
    /// Since when its pace is measured, and what had come by then: from the first message on, or from
    /// the one before it, of another request.
    measured_since: f64,
    measured_work: f64,
    /// When the last tiles came.
    pub(super) last_heard: f64,
    pub(super) busy_secs: f64,
    /// Of the next tiles.
    pub(super) decode_secs: f64,
    /// When the node was last heard to work for an earlier request: until then this one may have
    /// been waiting.
    pub(super) others_until: f64,
}

impl OpenRequest {
    /// A request for `tiles` of one pass, of which nothing has come.
    pub(super) fn new(
        now: f64,
        frame: FrameId,
        passes: SamplePasses,
        tiles: TileRange,
        work: f64,
    ) -> Self {
        Self {
            frame,
            passes,
            tiles,
            work,
            issued: now,
            delay_secs: 0.0,
            expected: None,
            is_probe: false,
            is_check: false,
            is_cancelled: false,
            is_lost: false,
            tiles_received: 0,
            work_received: 0.0,
            burst_work: 0.0,
            burst_max: 0.0,
            pieces: Vec::new(),
            measured_since: now,
            measured_work: 0.0,
            last_heard: now,
            busy_secs: 0.0,
            decode_secs: 0.0,
            others_until: now,
        }
    }

    /// Notes tiles that have come of a node with that cost: they take longer than the time between
    /// messages that come together.
    pub(super) fn receive(
        &mut self,
        now: f64,
        tiles: TileRange,
        work: f64,
        busy_secs: f64,
        cost: Option<Estimate>,
        is_first: bool,
    ) {
        let pace = cost.map_or(0.0, |cost| cost.secs_per_work);
        if self.tiles_received == 0 {
            let asked = cost.map_or(now, |cost| self.issued + cost.fixed_secs);
            // The first message of a frame may have waited for a pause of its node, which says nothing
            // of the node's pace; one that follows another request's has been traced since that came.
            let follows = self.others_until > asked && !is_first;
            (self.measured_since, self.measured_work) = if follows {
                (self.others_until, 0.0)
            } else {
                (now, work)
            };
        }
        let together = self.tiles_received > 0 && now - self.last_heard < TOGETHER * pace * work;
        self.burst_work = work + if together { self.burst_work } else { 0.0 };
        self.burst_max = self.burst_max.max(self.burst_work);
        self.work_received += work;
        self.tiles_received += tiles.count;
        self.busy_secs += busy_secs;
        self.last_heard = now;
    }

    /// From when on its missing work counts, by the client's clock, if nothing else is before it.
    pub(super) fn begins(&self, cost: Estimate) -> f64 {
        match self.tiles_received {
            0 => (self.issued + cost.fixed_secs + self.delay_secs).max(self.others_until),
            _ => self.last_heard,
        }
    }

    /// Seconds per unit of work as it comes, of which `grace_secs` are put down to the network; 0 if
    /// that cannot be told yet.
    pub(super) fn pace(&self, grace_secs: f64) -> f64 {
        let work = self.work_received - self.measured_work;
        if work > 0.0 {
            (self.last_heard - self.measured_since - grace_secs) / work
        } else {
            0.0
        }
    }

    /// Work that is still to come, if it is wanted.
    pub(super) fn outstanding(&self) -> f64 {
        if self.is_cancelled {
            return 0.0;
        }
        (self.work - self.work_received).max(0.0)
    }

    /// Tiles that are lost with it if its node does not answer.
    pub(super) fn lost_tiles(&self) -> u64 {
        let missing = self.tiles.count.saturating_sub(self.tiles_received);
        if self.counts() { missing.into() } else { 0 }
    }

    /// Stages of the time of tiles that are there now, of a frame `submitted` then. A node that says
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
            // From the end backwards: what is claimed in excess of the whole time is cut from the
            // earliest stages.
            decode_secs: part(self.decode_secs),
            encode_secs: part(micros(times.encode_micros)),
            trace_secs: part(micros(times.trace_micros)),
            queue_secs: part(micros(times.queue_micros)),
            network_secs: left.max(0.0),
        }
    }

    /// Whether the frame relies on it.
    pub(super) fn counts(&self) -> bool {
        self.is_wanted() && !self.is_lost
    }

    /// The units of its frame that have not come of it. Those that have may not be in the frame any more: they are
    /// taken out with what a node has sent that is dropped.
    pub(super) fn awaited(&self) -> impl Iterator<Item = u32> {
        let mut is_awaited = vec![true; self.tiles.count as usize];
        for (tiles, ..) in &self.pieces {
            let first = (tiles.first - self.tiles.first) as usize;
            is_awaited[first..first + tiles.count as usize].fill(false);
        }
        let units = self.tiles.indices().zip(is_awaited);
        units.filter_map(|(unit, is_awaited)| is_awaited.then_some(unit))
    }

    /// Whether it is cancelled when the frame needs it no more.
    pub(super) fn is_wanted(&self) -> bool {
        !self.is_cancelled && !self.is_probe
    }

    /// How long the request waited behind earlier ones, by the client's clock: from when it reached
    /// the node until the last earlier message left there, a round trip less than what is seen here.
    pub(super) fn queue_secs(&self, round_trip_secs: Option<f64>) -> f64 {
        (self.others_until - self.issued - round_trip_secs.unwrap_or(0.0)).max(0.0)
    }
}

/// Messages come together if the time between them is less than this share of their work's.
const TOGETHER: f64 = 0.25;

#[cfg(test)]
mod tests {
    use carom_tracer::{ImageSize, TileGrid};

    use super::*;

    fn request(tiles: TileRange) -> OpenRequest {
        let passes = SamplePasses::one(TileGrid::new(ImageSize::new(40, 1), 1), 1);
        OpenRequest::new(1.0, FrameId(0), passes, tiles, f64::from(tiles.count))
    }

    #[test]
    fn stages_add_up_however_long_a_node_says_it_worked() {
        let mut request = request(TileRange {
            first: 0,
            count: 10,
        });
        request.decode_secs = 0.001;
        for trace_micros in [0, 3000, 3_000_000] {
            let times = NodeTimes {
                queue_micros: 2000,
                trace_micros,
                encode_micros: 500,
            };
            let split = request.split(1.010, 0.995, times);
            let stages = [
                split.request_secs,
                split.network_secs,
                split.queue_secs,
                split.trace_secs,
                split.encode_secs,
                split.decode_secs,
            ];
            assert!(stages.iter().all(|secs| *secs >= 0.0), "{split:?}");
            assert!((stages.iter().sum::<f64>() - 0.015).abs() < 1e-12);
        }
    }

    #[test]
    fn cancelled_and_probing_requests_lose_no_tiles() {
        let mut open = request(TileRange {
            first: 0,
            count: 10,
        });
        open.receive(1.1, TileRange { first: 0, count: 4 }, 4.0, 0.1, None, true);
        assert_eq!(open.lost_tiles(), 6);
        let mut probe = open.clone();
        probe.is_probe = true;
        open.is_cancelled = true;
        assert_eq!((open.lost_tiles(), probe.lost_tiles()), (0, 0));
        assert_eq!((open.outstanding(), probe.outstanding()), (0.0, 6.0));
    }
}
