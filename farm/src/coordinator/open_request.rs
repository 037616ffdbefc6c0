//! A request that its node has not answered in full.

use carom_protocol::{FrameId, NodeTimes};
use carom_tracer::TileRange;

use super::sample_passes::SamplePasses;
use crate::balancer::Estimate;
use crate::stats::LatencySplit;

/// State of one request. Times are seconds on the client's clock.
#[derive(Clone, Debug)]
pub(super) struct OpenRequest {
    pub(super) frame: FrameId,
    pub(super) passes: SamplePasses,
    /// The requested units, all of one pass.
    pub(super) tiles: TileRange,
    pub(super) work: f64,
    pub(super) issued: f64,
    /// Lateness of its node's messages for its frame when it was issued: see
    /// [`super::arrival_model::FrameDelay`].
    pub(super) delay_secs: f64,
    /// When the last tile should arrive; absent while nothing is known of the node.
    pub(super) expected: Option<f64>,
    /// Whether the frame does not depend on it, as the tile has been requested from another node too.
    pub(super) is_probe: bool,
    /// Whether it is a probe for a spot check: its timing is not learned from.
    pub(super) is_check: bool,
    pub(super) is_cancelled: bool,
    /// Whether its node has been silent for so long that its tiles are reassigned.
    pub(super) is_lost: bool,
    pub(super) tiles_received: u32,
    pub(super) work_received: f64,
    /// Work of the latest burst of messages, and of the largest one.
    burst_work: f64,
    pub(super) burst_max: f64,
    /// Messages for a frame that still existed: tiles, their work, and the busy seconds that the node
    /// reports for them.
    pub(super) pieces: Vec<(TileRange, f64, f64)>,
    /// Start of the pace measurement, and the work received by then: from the request's first message, or
    /// from the preceding message of another request.
    measured_since: f64,
    measured_work: f64,
    /// When the latest tiles arrived.
    pub(super) last_heard: f64,
    pub(super) busy_secs: f64,
    /// Seconds that decoding the next tiles took.
    pub(super) decode_secs: f64,
    /// When a message of an earlier request last arrived: until then this one may have been queued.
    pub(super) others_until: f64,
}

impl OpenRequest {
    /// A request for `tiles` of one pass, of which nothing has arrived.
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

    /// Records tiles that have arrived from a node of that cost. Messages closer together than their
    /// tracing takes form one burst.
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
            // A frame's first message may have been delayed by a stall of its node, which says nothing
            // about pace: the measurement starts with it. A first message that follows another request's
            // was traced entirely after that one.
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

    /// When its missing work begins to be delivered, on the client's clock, if nothing else is before it.
    pub(super) fn begins(&self, cost: Estimate) -> f64 {
        // Before the first message, the request's own latency or the end of its predecessors counts;
        // afterwards the work follows the last message.
        match self.tiles_received {
            0 => (self.issued + cost.fixed_secs + self.delay_secs).max(self.others_until),
            _ => self.last_heard,
        }
    }

    /// Measured seconds per unit of work, with `grace_secs` attributed to the network; 0 if it cannot be
    /// told yet.
    pub(super) fn pace(&self, grace_secs: f64) -> f64 {
        let work = self.work_received - self.measured_work;
        if work > 0.0 {
            (self.last_heard - self.measured_since - grace_secs) / work
        } else {
            0.0
        }
    }

    /// Work that has not arrived, 0 if the request is cancelled.
    pub(super) fn outstanding(&self) -> f64 {
        if self.is_cancelled {
            return 0.0;
        }
        (self.work - self.work_received).max(0.0)
    }

    /// Number of tiles that are lost if its node does not answer.
    pub(super) fn lost_tiles(&self) -> u64 {
        let missing = self.tiles.count.saturating_sub(self.tiles_received);
        if self.counts() { missing.into() } else { 0 }
    }

    /// Breakdown of the latency of tiles that have just arrived, of a frame submitted at `submitted`. The
    /// times that a node reports are cut so that the sum is what the client has measured.
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
            // From the last stage backwards: an excess of reported times is cut from the earliest stages.
            decode_secs: part(self.decode_secs),
            encode_secs: part(micros(times.encode_micros)),
            trace_secs: part(micros(times.trace_micros)),
            queue_secs: part(micros(times.queue_micros)),
            network_secs: left.max(0.0),
        }
    }

    /// Whether the frame relies on it for its tiles.
    pub(super) fn counts(&self) -> bool {
        self.is_wanted() && !self.is_lost
    }

    /// The units that it has not delivered. Delivered ones may be missing from the frame again, if their
    /// node was dropped and its tiles retracted.
    pub(super) fn awaited(&self) -> impl Iterator<Item = u32> {
        let mut is_awaited = vec![true; self.tiles.count as usize];
        for (tiles, ..) in &self.pieces {
            let first = (tiles.first - self.tiles.first) as usize;
            is_awaited[first..first + tiles.count as usize].fill(false);
        }
        let units = self.tiles.indices().zip(is_awaited);
        units.filter_map(|(unit, is_awaited)| is_awaited.then_some(unit))
    }

    /// Whether it is to be cancelled once the frame no longer needs it.
    pub(super) fn is_wanted(&self) -> bool {
        !self.is_cancelled && !self.is_probe
    }

    /// Seconds for which the request waited behind earlier ones, on the client's clock: from its arrival at
    /// the node to the departure of the last earlier message, which is a round trip less than the interval
    /// seen here.
    pub(super) fn queue_secs(&self, round_trip_secs: Option<f64>) -> f64 {
        (self.others_until - self.issued - round_trip_secs.unwrap_or(0.0)).max(0.0)
    }
}

/// Messages form a burst if the time between them is less than this share of their work's duration.
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
