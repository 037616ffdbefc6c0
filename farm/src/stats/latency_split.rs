//! Breakdown of a tile's latency into stages.

use serde::Serialize;

/// Breakdown of a tile's time from [`crate::Farm::submit`] until its pixels were available, in seconds:
/// successive stages, each a duration by one clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LatencySplit {
    /// From submission to the request, by the client's clock.
    pub request_secs: f64,
    /// The rest of the round trip: both ways through the network, and queues in it.
    pub network_secs: f64,
    /// Waiting for the node's device, by the node's clock.
    pub queue_secs: f64,
    /// Tracing, and waiting for the tiles of the same message, by the node's clock.
    pub trace_secs: f64,
    /// Encoding, by the node's clock.
    pub encode_secs: f64,
    /// Decoding, by the client's clock.
    pub decode_secs: f64,
}
