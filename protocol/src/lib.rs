//! What crosses the wire between a client and its farm nodes.
//!
//! ```text
//! client                                      node
//!   Hello ──────────────────────────────────▶
//!         ◀────────────────────────── Welcome      both check the version
//!   Scene ──────────────────────────────────▶      once per content hash
//!         ◀─────────────────────── SceneReady
//!   Trace ──────────────────────────────────▶      camera, poses, a run of tiles
//!         ◀──────────────── Tiles … Tiles, RunDone
//! ```
//!
//! The crate knows no socket, no clock and no thread: [`session`] turns bytes into events and
//! events into bytes.

pub mod error;
pub mod limits;
pub mod message;

pub use error::Error;
pub use message::{
    FrameId, NodeInfo, PixelFormat, Refusal, RefusalReason, RunId, RunReport, SceneHash, TilesDone,
    ToClient, ToNode, TraceRequest,
};
