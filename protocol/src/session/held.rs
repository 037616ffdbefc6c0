//! Which tiles both ends remember, so that later ones can be told from them.
//!
//! The client says with each request which tiles of earlier runs it holds there; the node tells a
//! tile from one that was named and that it remembers too, or from nothing. So a tile is only ever
//! told from one that has arrived, and whichever end forgets costs bytes and nothing else.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use carom_tracer::{TileGrid, TileRun};

use crate::limits::{HELD_RUNS_MAX, HELD_STRETCHES_MAX, SENT_TILES_BYTES_MAX};
use crate::message::{HeldTiles, PixelFormat, RunId, TraceRequest};
use crate::tile_codec::ReferenceTile;

/// What each tile of a stretch may be told from.
pub type References = Vec<Option<Arc<ReferenceTile>>>;

/// The client's end: the last tile that came at each place of the last [`HELD_RUNS_MAX`] runs.
#[derive(Debug, Default)]
pub(super) struct Held {
    grid: Option<TileGrid>,
    tiles: BTreeMap<u32, (RunId, Arc<ReferenceTile>)>,
    /// Runs with tiles in here, in the order in which they began to come.
    runs: VecDeque<RunId>,
}

impl Held {
    /// Names the tiles that are held where `request` asks for some; and hands them out, to be
    /// kept until its tiles have come.
    pub(super) fn name(&mut self, request: &mut TraceRequest) -> References {
        request.held.clear();
        if !matches!(request.format, PixelFormat::Srgb8 { .. }) {
            return Vec::new();
        }
        if self.grid != Some(request.grid) {
            *self = Self::default();
            self.grid = Some(request.grid);
        }
        let place = |tile: u32| (tile - request.tiles.first) as usize;
        let mut references = vec![None; request.tiles.count as usize];
        for (&tile, (run, held)) in self.tiles.range(request.tiles.indices()) {
            let stretches = request.held.len();
            match request.held.last_mut() {
                Some(last) if last.run == *run && last.tiles.end() == tile => last.tiles.count += 1,
                _ if stretches == HELD_STRETCHES_MAX => break,
                _ => {
                    let (first, count) = (tile, 1);
                    let tiles = TileRun { first, count };
                    request.held.push(HeldTiles { run: *run, tiles });
                }
            }
            references[place(tile)] = Some(Arc::clone(held));
        }
        references
    }

    /// Remembers tiles that have come.
    pub(super) fn insert(
        &mut self,
        grid: TileGrid,
        run: RunId,
        tiles: TileRun,
        kept: Vec<Arc<ReferenceTile>>,
    ) {
        if self.grid != Some(grid) {
            return;
        }
        if !self.runs.contains(&run) {
            self.runs.push_back(run);
        }
        for (tile, kept) in tiles.indices().zip(kept) {
            match self.tiles.get(&tile) {
                Some((newer, _)) if *newer > run => {}
                _ => drop(self.tiles.insert(tile, (run, kept))),
            }
        }
        if self.runs.len() > HELD_RUNS_MAX {
            let oldest = self.runs.pop_front();
            self.tiles.retain(|_, (run, _)| Some(*run) != oldest);
        }
    }
}

/// The node's end: the tiles it has sent to a client, until that holds later ones or
/// [`SENT_TILES_BYTES_MAX`] bytes are kept.
#[derive(Debug, Default)]
pub struct SentTiles {
    grid: Option<TileGrid>,
    tiles: BTreeMap<(u32, RunId), Arc<ReferenceTile>>,
    /// In the order of sending; some may have been dropped already.
    order: VecDeque<(u32, RunId)>,
    bytes: usize,
}

impl SentTiles {
    /// What `tiles`, of a request's own, may be told from.
    pub fn references(&mut self, request: &TraceRequest, tiles: TileRun) -> References {
        let mut references = vec![None; tiles.count as usize];
        if self.grid != Some(request.grid) {
            return references;
        }
        for held in &request.held {
            let stretch = held.tiles.first.max(tiles.first)..held.tiles.end().min(tiles.end());
            for tile in stretch {
                self.drop_before(tile, held.run);
                let reference = self.tiles.get(&(tile, held.run));
                references[(tile - tiles.first) as usize] = reference.cloned();
            }
        }
        references
    }

    /// Remembers tiles that are sent.
    pub fn insert(
        &mut self,
        request: &TraceRequest,
        tiles: TileRun,
        kept: Vec<Arc<ReferenceTile>>,
    ) {
        if self.grid != Some(request.grid) {
            *self = Self::default();
            self.grid = Some(request.grid);
        }
        for (tile, kept) in tiles.indices().zip(kept) {
            self.bytes += kept.bytes();
            self.order.push_back((tile, request.run));
            if let Some(before) = self.tiles.insert((tile, request.run), kept) {
                self.bytes -= before.bytes();
            }
        }
        while self.bytes > SENT_TILES_BYTES_MAX || self.order.len() > 2 * self.tiles.len() + 64 {
            let Some(oldest) = self.order.pop_front() else {
                return;
            };
            self.forget(oldest);
        }
    }

    /// The client holds a later one: it will not name these again.
    fn drop_before(&mut self, tile: u32, run: RunId) {
        let stale = self.tiles.range((tile, RunId(0))..(tile, run));
        let stale: Vec<(u32, RunId)> = stale.map(|(key, _)| *key).collect();
        for key in stale {
            self.forget(key);
        }
    }

    fn forget(&mut self, key: (u32, RunId)) {
        if let Some(tile) = self.tiles.remove(&key) {
            self.bytes -= tile.bytes();
        }
    }
}
