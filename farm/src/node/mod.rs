//! Node: owns one tracer, traces its clients' requests, and answers with encoded tiles.
//!
//! ```text
//! NodeConnection (NodeSession) ─UncompiledJob─▶ scene compiler ─NodeJob─▶ queue ─▶ worker: Tracer::trace ─▶ groups of tiles
//!       ▲  one per client                                                                      │
//!       └─────────────────── TilesDone, RequestDone ◀── encoded on rayon's threads ◀───────────┘
//! ```
//!
//! A tracer that fails or panics costs a refused request, never the node. Stale and cancelled requests
//! leave the queue before they are traced. Durations are measured on the node's own clock.

mod asset_cache;
mod bitrate_control;
mod client_connection;
mod connection;
mod cost;
mod device_quota;
mod fair_queue;
mod guard_band;
mod job;
mod load_meter;
mod partial_tile;
mod queue;
mod rate_model;
mod scene_compiler;
mod worker;

use std::hash::{BuildHasher, RandomState};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use carom_protocol::NodeInfo;
use carom_protocol::session::ChunkStore;
use carom_tracer::{DeviceKind, Tracer};

pub use asset_cache::AssetCache;
pub use bitrate_control::LinkEstimate;
#[cfg(feature = "net")]
pub(crate) use client_connection::STALL_TIMEOUT;
use client_connection::TileSharing;
pub use connection::{ConnectionDrain, NodeConnection, PacketHandler};
pub use fair_queue::{FairQueue, PlayerId};
use queue::JobQueue;

/// One device, shared by any number of clients.
pub struct Node {
    name: String,
    instance: u64,
    tracer: Arc<dyn Tracer>,
    queue: Arc<JobQueue>,
    store: OnceLock<Arc<dyn ChunkStore>>,
}

impl Node {
    /// Starts the threads of a node called `name`: a watchdog that stops requests which take too long, a
    /// scene compiler, and the workers. A GPU gets two, so that its next work is submitted before the
    /// current one ends, a CPU one, which uses all its cores.
    pub fn new(name: impl Into<String>, tracer: Arc<dyn Tracer>) -> Arc<Self> {
        let workers = match tracer.info().kind {
            DeviceKind::Gpu => 2,
            DeviceKind::Cpu | DeviceKind::Scalar => 1,
        };
        let queue = Arc::new(JobQueue::default());
        for _ in 0..workers {
            worker::start(Arc::clone(&queue), Arc::clone(&tracer));
        }
        worker::start_watch(Arc::clone(&queue));
        worker::start_compiler(Arc::clone(&queue));
        Arc::new(Self {
            name: name.into(),
            // Random without a dependency: `RandomState` has random keys.
            instance: RandomState::new().hash_one("instance").max(1),
            tracer,
            queue,
            store: OnceLock::new(),
        })
    }

    /// Limits each player to `secs_per_hour` seconds of the device, above 0, even where no other player
    /// uses it; without a quota, the active players share all of it. Requests beyond the quota are refused
    /// with an explanation.
    pub fn set_player_quota(&self, secs_per_hour: f64) {
        self.queue.set_quota(secs_per_hour);
    }

    /// Limits the memory of all compiled scenes, in bytes; a player may use half of it. The default is 1
    /// GiB.
    pub fn set_scene_memory(&self, bytes: u64) {
        self.queue.scenes.set_bytes_max(bytes);
    }

    /// Keeps chunks of players' scenes in `store`, such as an [`AssetCache`], for connections from here on:
    /// chunks that it holds are not sent again. Without a store, none are kept. Only the first call has an
    /// effect.
    pub fn set_chunk_store(&self, store: Arc<dyn ChunkStore>) {
        let _ = self.store.set(store);
    }

    /// The node's name and device; the device's name includes the reason of a failure.
    pub fn info(&self) -> NodeInfo {
        NodeInfo {
            name: self.name.clone(),
            instance: self.instance,
            device: self.tracer.info(),
        }
    }

    /// Opens a session for a new connection of a player, whose connections share the player's part of the
    /// device. Dropping it cancels all its requests.
    pub fn connect(&self, player: PlayerId) -> NodeConnection {
        let queue = Arc::clone(&self.queue);
        let connection = NodeConnection::new(self.info(), player, queue, TileSharing::Encoded);
        connection.with_store(self.store.get().cloned())
    }

    /// The same for a client in this process, to which pixels are passed without encoding.
    pub(crate) fn connect_local(&self) -> NodeConnection {
        let queue = Arc::clone(&self.queue);
        NodeConnection::new(self.info(), PlayerId::LOCAL, queue, TileSharing::InMemory)
    }
}

impl Drop for Node {
    /// Ends the workers, but waits for a hanging device no longer than a second.
    fn drop(&mut self) {
        self.queue.close(WORKERS_TIMEOUT);
    }
}

/// Time that the workers get to finish after they have been told to stop.
const WORKERS_TIMEOUT: Duration = Duration::from_secs(1);
