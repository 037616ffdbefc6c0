//! Accepted request of a node, with its scene.

use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Instant;

use carom_protocol::TraceRequest;
use carom_tracer::{CompiledScene, Scene, Tile, TileRange};

use super::client_connection::ClientConnection;
use super::guard_band::{guarded_pixels, guarded_pixels_of_run, halves};
use super::partial_tile::PartialTile;
use crate::lock::lock;

/// A request whose scene has not been compiled.
pub(super) struct UncompiledJob {
    pub(super) client: Arc<ClientConnection>,
    pub(super) request: Box<TraceRequest>,
    pub(super) scene: Arc<Scene>,
    pub(super) cancelled: Arc<AtomicBool>,
    pub(super) arrived: Instant,
}

/// A request with its compiled scene.
pub(super) struct NodeJob {
    pub(super) client: Arc<ClientConnection>,
    pub(super) request: Box<TraceRequest>,
    pub(super) cancelled: Arc<AtomicBool>,
    pub(super) arrived: Instant,
    /// Start of its first slice.
    pub(super) begun: OnceLock<Instant>,
    /// The scene without the request's update.
    pub(super) base: Arc<CompiledScene>,
    /// The scene with the request's update.
    pub(super) compiled: Mutex<Option<Arc<CompiledScene>>>,
    pub(super) encode_nanos: AtomicU64,
    /// Partly traced tiles: at most one per worker.
    partial: Mutex<Vec<PartialTile>>,
    /// Number of unfinished tiles.
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

    /// Counts tiles as finished. Returns whether they were the last.
    pub(super) fn finish(&self, tiles: u32) -> bool {
        // AcqRel: whoever finishes the last tile sees what other workers have done for theirs.
        self.unfinished.fetch_sub(tiles, Ordering::AcqRel) == tiles
    }

    /// Samples traced for some of its tiles, including the guard band of denoised ones.
    pub(super) fn samples(&self, tiles: TileRange) -> f64 {
        let grid = self.request.grid;
        let pixels = match self.is_denoised() {
            true => guarded_pixels_of_run(grid, tiles),
            false => grid.pixels(tiles),
        };
        pixels as f64 * self.samples_per_pixel()
    }

    /// The same for a part of a tile.
    pub(super) fn samples_of_part(&self, part: Tile) -> f64 {
        let pixels = match self.is_denoised() {
            true => guarded_pixels(part, self.request.grid.size),
            false => part.pixels(),
        };
        pixels as f64 * self.samples_per_pixel()
    }

    /// The largest number of tiles from the first of `all` on for which at most `samples` samples are
    /// traced.
    pub(super) fn tiles_within(&self, all: TileRange, samples: f64) -> u32 {
        // Binary search: the samples grow with the number of tiles.
        let (mut fitting, mut too_many) = (0, all.count + 1);
        while too_many - fitting > 1 {
            let count = fitting + (too_many - fitting) / 2;
            let tiles = TileRange { count, ..all };
            match self.samples(tiles) <= samples {
                true => fitting = count,
                false => too_many = count,
            }
        }
        fitting
    }

    /// Samples per pixel.
    pub(super) fn samples_per_pixel(&self) -> f64 {
        f64::from(self.request.settings.samples)
    }

    /// Whether its tiles are denoised, and so need a guard band.
    pub(super) fn is_denoised(&self) -> bool {
        self.request.settings.denoise
    }

    /// Whether a tile or part can be divided further.
    pub(super) fn is_divisible(&self, part: Tile) -> bool {
        match self.is_denoised() {
            true => halves(part).is_some(),
            false => part.pixels() > 1,
        }
    }

    /// Removes and returns the progress of a tile that is traced in parts.
    pub(super) fn take_partial(&self, tile: u32) -> Option<PartialTile> {
        let mut partial = lock(&self.partial);
        let place = partial.iter().position(|partial| partial.index == tile)?;
        Some(partial.swap_remove(place))
    }

    /// Stores the progress of a tile for its next part.
    pub(super) fn keep_partial(&self, partial: PartialTile) {
        lock(&self.partial).push(partial);
    }

    /// The next part of a tile that is traced in parts, or is to be if `divides`: it takes at most `pixels`
    /// pixels where it can be divided that far. `None` if the tile is to be traced as a whole.
    pub(super) fn next_part(&self, tile: u32, divides: bool, pixels: u32) -> Option<Tile> {
        let mut partial = lock(&self.partial);
        let begun = partial.iter_mut().find(|partial| partial.index == tile);
        match begun {
            Some(begun) => Some(begun.next(pixels)),
            None if divides => {
                let mut begun = self.undivided(tile);
                let part = begun.next(pixels);
                partial.push(begun);
                Some(part)
            }
            None => None,
        }
    }

    /// Records that a tile or its next part has been stopped, and returns how often. The tile is traced in
    /// parts from then on, as the work on a stopped whole tile is lost.
    pub(super) fn note_stop(&self, tile: u32) -> u32 {
        let mut partial = self.take_partial(tile);
        let begun = partial.get_or_insert_with(|| self.undivided(tile));
        let stops = begun.note_stop();
        partial
            .into_iter()
            .for_each(|begun| self.keep_partial(begun));
        stops
    }

    fn undivided(&self, tile: u32) -> PartialTile {
        let grid = self.request.grid;
        PartialTile::new(
            tile,
            grid.tile(tile),
            self.is_denoised().then_some(grid.size),
        )
    }
}
