//! Many machines as one path tracer: the API for distributed ray tracing applications.
//!
//! ```text
//! Farm ──submit──▶ coordinator ──TraceRequest──▶ nodes (in this process, or over QUIC)
//!      ◀─poll_frame─   Film    ◀────tiles───────
//! ```

pub mod config;
pub mod error;
pub mod frame;
pub mod net;

pub use config::{Algorithm, FarmConfig, LocalNode};
pub use error::Error;
pub use frame::{Frame, FrameSpec, FrameStats, NodeState, NodeStatus, Pixels};
