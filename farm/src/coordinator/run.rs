//! A request that a node has not answered in full.

use carom_protocol::FrameId;
use carom_tracer::TileRun;

/// Times are seconds on the client's clock.
#[derive(Clone, Debug)]
pub(super) struct Run {
    pub(super) frame: FrameId,
    pub(super) tiles: TileRun,
    pub(super) work: f64,
    pub(super) issued: f64,
    /// When the last tile should come; absent while nothing is known of the node.
    pub(super) expected: Option<f64>,
    /// Whether the frame does without: the tile has been asked of another node too.
    pub(super) probe: bool,
    pub(super) cancelled: bool,
    pub(super) tiles_received: u32,
    pub(super) work_received: f64,
    /// The most work that came in one message.
    pub(super) message_work: f64,
    /// When the last tiles came.
    pub(super) heard: f64,
    pub(super) busy_secs: f64,
    /// When the node was last heard to work for an earlier request: until then this one may have
    /// been waiting.
    pub(super) others_until: f64,
}

impl Run {
    /// Work that is still to come, if it is wanted.
    pub(super) fn outstanding(&self) -> f64 {
        if self.cancelled {
            return 0.0;
        }
        (self.work - self.work_received).max(0.0)
    }

    /// Whether the frame relies on it.
    pub(super) fn counts(&self) -> bool {
        !self.cancelled && !self.probe
    }

    /// How long the request waited behind earlier ones, by the client's clock: from when it reached
    /// the node until the last earlier message left there, a round trip less than what is seen here.
    pub(super) fn queue_secs(&self, round_trip_secs: Option<f64>) -> f64 {
        (self.others_until - self.issued - round_trip_secs.unwrap_or(0.0)).max(0.0)
    }
}
