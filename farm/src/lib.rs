//! Many machines as one path tracer: the API for distributed ray tracing applications.
//!
//! ```text
//! Farm ──submit──▶ coordinator ──TraceRequest──▶ nodes (in this process, or over QUIC)
//!      ◀─poll_frame─   Film    ◀────tiles───────
//! ```
//!
//! A picture on this machine, with or without a GPU and with no node set up; add `host:port`s to
//! [`FarmConfig::nodes`] and it is traced on all of them together.
//!
//! ```
//! use std::time::Duration;
//!
//! use carom_farm::{Farm, FarmConfig, FrameSpec, LocalNode, PixelFormat, Pixels};
//! use carom_tracer::{ImageSize, RadianceImage, RenderSettings, Scene, SceneUpdate};
//!
//! let scene = Scene::from_json(include_str!("../../assets/scenes/pool.json"))?;
//! let mut farm = Farm::new(FarmConfig {
//!     local: LocalNode::Cpu,
//!     ..FarmConfig::default()
//! })?;
//! farm.set_scene(&scene)?;
//! farm.submit(FrameSpec {
//!     update: SceneUpdate::default(),
//!     size: ImageSize::new(96, 54),
//!     settings: RenderSettings::default(),
//!     format: PixelFormat::LinearF32,
//! })?;
//! let frame = farm.wait_frame(Duration::from_secs(60)).expect("a minute is enough");
//! let Pixels::Linear(pixels) = frame.pixels else {
//!     unreachable!("linear pixels were asked for");
//! };
//! let size = frame.size;
//! let output = std::env::temp_dir().join("carom-one-frame.png");
//! RadianceImage { size, pixels }.write_png(output, 1.0)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Submitting never waits, several frames are in flight at once, and nodes may come, slow down or
//! die meanwhile: see [`Farm`]. How work is divided is in [`balancer`].

mod accumulated_render;
pub mod backend;
pub mod balancer;
mod balancing;
mod channel;
mod config;
mod config_fault;
pub mod coordinator;
pub mod directory;
mod driver;
mod error;
mod farm;
mod frame;
pub mod link;
mod local_devices;
pub mod logging;
mod memory_link;
pub mod multi_device;
pub mod net;
pub mod node;
mod node_status;
pub mod pacing;
mod stats;
mod submission;

pub use accumulated_render::{AccumulatedRender, SampleBatch, trace_aovs};
pub use balancing::{Algorithm, Balancing, Distribution};
pub use carom_protocol::{FrameId, NodeInfo, PixelFormat, PixelPrecision, PrecisionRange};
pub use config::{FarmConfig, LocalNode};
pub use config_fault::ConfigFault;
pub use error::Error;
pub use farm::Farm;
pub use frame::{Frame, FrameSpec, Pixels};
pub use node_status::{NodeIndex, NodeState, NodeStatus};
pub use stats::{Delivery, FrameStats, LatencySplit, NodeEffort};
pub use submission::{Priority, SceneHandle, Submission};
