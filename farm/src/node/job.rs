//! A request that a node has taken in, with its scene.

use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Instant;

use carom_protocol::TraceRequest;
use carom_tracer::{CompiledScene, Scene};

use super::client_connection::ClientConnection;

/// A request to trace.
pub(super) struct NodeJob {
    pub(super) client: Arc<ClientConnection>,
    pub(super) request: Box<TraceRequest>,
    pub(super) scene: Arc<Scene>,
    pub(super) cancelled: Arc<AtomicBool>,
    pub(super) arrived: Instant,
    /// The time at which its first slice was begun.
    pub(super) begun: OnceLock<Instant>,
    /// The scene, once it is compiled.
    pub(super) base: Option<Arc<CompiledScene>>,
    /// The scene with the request's update.
    pub(super) compiled: Mutex<Option<Arc<CompiledScene>>>,
    pub(super) encode_nanos: AtomicU64,
    /// Tiles that are not finished.
    unfinished: AtomicU32,
}

impl NodeJob {
    pub(super) fn new(
        client: Arc<ClientConnection>,
        request: Box<TraceRequest>,
        scene: Arc<Scene>,
        cancelled: Arc<AtomicBool>,
    ) -> Self {
        Self {
            client,
            unfinished: AtomicU32::new(request.tiles.count),
            request,
            scene,
            cancelled,
            arrived: Instant::now(),
            begun: OnceLock::new(),
            base: None,
            compiled: Mutex::default(),
            encode_nanos: AtomicU64::default(),
        }
    }

    /// Counts tiles as finished; whether they were the last.
    pub(super) fn finish(&self, tiles: u32) -> bool {
        self.unfinished.fetch_sub(tiles, Ordering::AcqRel) == tiles
    }

    /// Samples of so many of its tiles, if they are whole.
    pub(super) fn samples(&self, tiles: u32) -> f64 {
        let edge = f64::from(self.request.grid.edge);
        f64::from(tiles) * edge * edge * f64::from(self.request.settings.samples)
    }
}
