//! A request that a node has taken in, with its scene.

use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Instant;

use carom_protocol::TraceRequest;
use carom_tracer::{CompiledScene, Scene, Tile};

use super::client_connection::ClientConnection;
use super::partial_tile::PartialTile;

/// A request whose scene is to be compiled.
pub(super) struct UncompiledJob {
    pub(super) client: Arc<ClientConnection>,
    pub(super) request: Box<TraceRequest>,
    pub(super) scene: Arc<Scene>,
    pub(super) cancelled: Arc<AtomicBool>,
    pub(super) arrived: Instant,
}

/// A request to trace.
pub(super) struct NodeJob {
    pub(super) client: Arc<ClientConnection>,
    pub(super) request: Box<TraceRequest>,
    pub(super) cancelled: Arc<AtomicBool>,
    pub(super) arrived: Instant,
    /// The time at which its first slice was begun.
    pub(super) begun: OnceLock<Instant>,
    /// The scene without the request's update.
    pub(super) base: Arc<CompiledScene>,
    /// The scene with the request's update.
    pub(super) compiled: Mutex<Option<Arc<CompiledScene>>>,
    pub(super) encode_nanos: AtomicU64,
    /// Tiles of which a part has been traced: at most one a worker.
    partial: Mutex<Vec<PartialTile>>,
    /// Tiles that are not finished.
    unfinished: AtomicU32,
}

impl NodeJob {
    pub(super) fn new(job: UncompiledJob, base: Arc<CompiledScene>) -> Self {
        Self {
            unfinished: AtomicU32::new(job.request.tiles.count),
            client: job.client,
            request: job.request,
            cancelled: job.cancelled,
            arrived: job.arrived,
            begun: OnceLock::new(),
            base,
            compiled: Mutex::default(),
            encode_nanos: AtomicU64::default(),
            partial: Mutex::default(),
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

    /// Samples of a pixel.
    pub(super) fn samples_per_pixel(&self) -> f64 {
        f64::from(self.request.settings.samples)
    }

    /// Whether a tile can be traced in parts.
    pub(super) fn has_divisible_tiles(&self) -> bool {
        !self.request.settings.denoise
    }

    /// Takes out what has been traced of a tile that is traced in parts.
    pub(super) fn take_partial(&self, tile: u32) -> Option<PartialTile> {
        let mut partial = self.lock_partial();
        let place = partial.iter().position(|partial| partial.index == tile)?;
        Some(partial.swap_remove(place))
    }

    /// Keeps what has been traced of a tile for its next part.
    pub(super) fn keep_partial(&self, partial: PartialTile) {
        self.lock_partial().push(partial);
    }

    /// The next part to trace of a tile, of at most so many pixels, but for the first; none if it is to be traced as a
    /// whole.
    pub(super) fn next_part(&self, tile: u32, pixels: Option<u32>) -> Option<Tile> {
        let mut partial = self.lock_partial();
        if let Some(begun) = partial.iter().find(|partial| partial.index == tile) {
            return Some(begun.next(pixels.unwrap_or(u32::MAX)));
        }
        let pixels = pixels.filter(|_| self.has_divisible_tiles())?;
        partial.push(PartialTile::new(tile, self.request.grid.tile(tile)));
        partial.last().map(|begun| begun.next(pixels))
    }

    fn lock_partial(&self) -> MutexGuard<'_, Vec<PartialTile>> {
        self.partial.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
