//! Stages of a tile's latency.

use serde::Serialize;

/// Where the time of a tile went, from [`crate::Farm::submit`] until its pixels were there, in
/// seconds: one after the other, each a duration by one clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LatencySplit {
    /// From submission until the node was asked, by the client's clock.
    pub request_secs: f64,
    /// What is left of the round trip: both ways through the network, and waiting for it.
    pub network_secs: f64,
    /// Waiting for the node's device, by the node's clock.
    pub queue_secs: f64,
    /// Tracing, and waiting for the tiles that travel together, by the node's clock.
    pub trace_secs: f64,
    /// Encoding, by the node's clock.
    pub encode_secs: f64,
    /// Decoding, by the client's clock.
    pub decode_secs: f64,
}
