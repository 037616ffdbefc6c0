//! Many machines as one path tracer: the API for distributed ray tracing applications.
//!
//! ```text
//! Farm ──submit──▶ coordinator ──TraceRequest──▶ nodes (in this process, or over QUIC)
//!      ◀─poll_frame─   Film    ◀────tiles───────
//! ```
//!
//! The example traces a picture on this machine, with or without a GPU and without any set-up; with the
//! `host:port`s of nodes in a `farm.toml` ([`FarmConfig`]), it is traced on all of them together.
//!
//! ```
//! use carom_farm::prelude::*;
//!
//! # fn main() -> carom_farm::Result<()> {
//! # let _folder = std::env::set_current_dir(std::env::temp_dir());
//! let mut scene = Scene::new().camera(Camera::looking_at([0.0, -4.0, 2.0], [0.0, 0.0, 0.5]));
//! scene.add(Sphere::new(0.5).at([0.0, 0.0, 0.5]), Material::diffuse([0.8, 0.1, 0.1]));
//! scene.add(Plane::z(0.0), Material::grey(0.5));
//! Farm::auto()?.render(&scene, Still::new(64, 36).samples(4))?.save("hello.png")
//! # }
//! ```
//!
//! [`Still`] is one picture, [`Film`] many in sequence, [`Live`] a view that follows its camera. At a lower
//! level, [`Farm::submit`] takes single frames. Submitting does not block, several frames are in flight at
//! once, and nodes may join, slow down or fail meanwhile: see [`Farm`]. The division of work is in
//! [`balancer`]; the [`guide`] is organised by subject.

mod accumulated_render;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod backend;
pub mod balancer;
mod balancing;
mod channel;
mod checkpoint;
#[doc(hidden)]
pub mod checkpoint_format;
mod config;
mod config_fault;
#[doc(hidden)]
pub mod coordinator;
pub mod directory;
mod driver;
mod error;
mod events;
mod farm;
mod film;
mod frame;
pub mod guide;
#[cfg(feature = "cli")]
pub mod health;
mod job;
#[doc(hidden)]
pub mod link;
mod live;
mod local_devices;
mod lock;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod logging;
mod memory_link;
pub mod multi_device;
#[cfg(feature = "net")]
pub mod net;
#[cfg(not(feature = "net"))]
#[path = "net/absent.rs"]
pub mod net;
pub mod node;
mod node_status;
pub mod pacing;
mod picture;
pub mod prelude;
pub mod quality;
mod scene_file;
mod stats;
mod still;
mod submission;
mod submitter;
mod token_bucket;
mod whole_file;

pub use accumulated_render::{AccumulatedRender, SampleBatch, trace_aovs};
pub use balancing::{Algorithm, Balancing, Distribution};
pub use carom_protocol::{FrameId, NodeInfo, PixelFormat, PixelPrecision, PrecisionRange};
pub use carom_tracer;
pub use carom_tracer::glam;
pub use config::{FarmConfig, LocalNode};
pub use config_fault::ConfigFault;
pub use coordinator::FrameRefusal;
pub use error::{Error, Result};
pub use events::{FarmEvent, FarmEvents};
pub use farm::Farm;
pub use film::{Film, FilmFormat, FilmFrames, FilmJob, FilmProgress, FilmState, FrameRange};
pub use frame::{Frame, FrameSpec, Pixels};
pub use job::{Canceller, Job};
pub use live::{Live, LiveFrame, LiveView};
pub use node_status::{NodeIndex, NodeState, NodeStatus};
pub use picture::{FileFormat, Picture};
pub use scene_file::{SCENE_FILES, SceneAnimation, SceneFile, open_scene};
pub use stats::{Delivery, FrameStats, LatencySplit, NodeEffort};
pub use still::{Still, StillJob, StillProgress};
pub use submission::{Priority, SceneHandle, Submission};
pub use whole_file::WholeFile;
