//! Many machines as one path tracer: the API for distributed ray tracing applications.
//!
//! ```text
//! Farm ──submit──▶ coordinator ──TraceRequest──▶ nodes (in this process, or over QUIC)
//!      ◀─poll_frame─   Film    ◀────tiles───────
//! ```

pub mod config;
pub mod coordinator;
mod driver;
pub mod error;
mod farm;
pub mod frame;
pub mod link;
pub mod local;
mod mailbox;
pub mod net;
pub mod node;
pub mod sim;

pub use config::{Algorithm, FarmConfig, LocalNode};
pub use error::Error;
pub use farm::Farm;
pub use frame::{Frame, FrameSpec, FrameStats, NodeState, NodeStatus, Pixels};
