//! Health of a node, for its operators: counters, probes over HTTP, and the notice that a cloud reclaims
//! the machine.
//!
//! ```text
//! MeteredTracer, connections ──▶ NodeCounters ──▶ /metrics, a line a minute, the exit when idle
//!                       POST /drain, spot notice ──▶ StopHandle: the node finishes and ends
//! ```

mod counters;
mod http;
mod http_client;
mod metered_tracer;
mod spot_notice;

pub use counters::{NodeCounters, NodeFigures};
pub use http::{HealthServer, NodeProbe};
pub use http_client::{http_get, http_get_all};
pub use metered_tracer::MeteredTracer;
pub use spot_notice::watch_spot_notice;
