//! Which tiles both ends remember, so that later ones can be told from them.
//!
//! The client says with each request which tiles of earlier requests it holds there; the node tells a
//! tile from one that was named and that it remembers too, or from nothing. So a tile is only ever
//! told from one that has arrived, and whichever end forgets costs bytes and nothing else.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use carom_tracer::{TileGrid, TileRange};

use crate::limits::{REFERENCE_RANGES_MAX, REFERENCE_REQUESTS_MAX, SENT_REFERENCES_BYTES_MAX};
use crate::message::{PixelFormat, ReferenceRange, RequestId, TraceRequest};
use crate::tile_codec::ReferenceTile;

/// What each tile of a stretch may be told from.
pub type References = Vec<Option<Arc<ReferenceTile>>>;

/// The client's end: the last tile that came at each place of the last [`REFERENCE_REQUESTS_MAX`] requests.
#[derive(Debug, Default)]
pub(super) struct Held {
    grid: Option<TileGrid>,
    tiles: BTreeMap<u32, (RequestId, Arc<ReferenceTile>)>,
    /// Requests with tiles in here, in the order in which they began to come.
    requests: VecDeque<RequestId>,
}

impl Held {
    /// Names the tiles that are held where `request` asks for some; and hands them out, to be
    /// kept until its tiles have come.
    pub(super) fn name(&mut self, request: &mut TraceRequest) -> References {
        request.references.clear();
        if !matches!(request.format, PixelFormat::Srgb8 { .. }) {
            return Vec::new();
        }
        if self.grid != Some(request.grid) {
            *self = Self::default();
            self.grid = Some(request.grid);
        }
        let place = |tile: u32| (tile - request.tiles.first) as usize;
        let mut references = vec![None; request.tiles.count as usize];
        for (&tile, (id, held)) in self.tiles.range(request.tiles.indices()) {
            let stretches = request.references.len();
            match request.references.last_mut() {
                Some(last) if last.request == *id && last.tiles.end() == tile => {
                    last.tiles.count += 1
                }
                _ if stretches == REFERENCE_RANGES_MAX => break,
                _ => {
                    let (first, count) = (tile, 1);
                    let tiles = TileRange { first, count };
                    request.references.push(ReferenceRange {
                        request: *id,
                        tiles,
                    });
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
        request: RequestId,
        tiles: TileRange,
        kept: Vec<Arc<ReferenceTile>>,
    ) {
        if self.grid != Some(grid) {
            return;
        }
        if !self.requests.contains(&request) {
            self.requests.push_back(request);
        }
        for (tile, kept) in tiles.indices().zip(kept) {
            match self.tiles.get(&tile) {
                Some((newer, _)) if *newer > request => {}
                _ => drop(self.tiles.insert(tile, (request, kept))),
            }
        }
        if self.requests.len() > REFERENCE_REQUESTS_MAX {
            let oldest = self.requests.pop_front();
            self.tiles
                .retain(|_, (request, _)| Some(*request) != oldest);
        }
    }
}

/// The node's end: the tiles it has sent to a client, until that holds later ones or
/// [`SENT_REFERENCES_BYTES_MAX`] bytes are kept.
#[derive(Debug, Default)]
pub struct SentReferences {
    grid: Option<TileGrid>,
    tiles: BTreeMap<(u32, RequestId), Arc<ReferenceTile>>,
    /// In the order of sending; some may have been dropped already.
    order: VecDeque<(u32, RequestId)>,
    bytes: usize,
}

impl SentReferences {
    /// What `tiles`, of a request's own, may be told from.
    pub fn references(&mut self, request: &TraceRequest, tiles: TileRange) -> References {
        let mut references = vec![None; tiles.count as usize];
        if self.grid != Some(request.grid) {
            return references;
        }
        for held in &request.references {
            let stretch = held.tiles.first.max(tiles.first)..held.tiles.end().min(tiles.end());
            for tile in stretch {
                self.drop_before(tile, held.request);
                let reference = self.tiles.get(&(tile, held.request));
                references[(tile - tiles.first) as usize] = reference.cloned();
            }
        }
        references
    }

    /// Remembers tiles that are sent.
    pub fn insert(
        &mut self,
        request: &TraceRequest,
        tiles: TileRange,
        kept: Vec<Arc<ReferenceTile>>,
    ) {
        if self.grid != Some(request.grid) {
            *self = Self::default();
            self.grid = Some(request.grid);
        }
        for (tile, kept) in tiles.indices().zip(kept) {
            self.bytes += kept.bytes();
            self.order.push_back((tile, request.id));
            if let Some(before) = self.tiles.insert((tile, request.id), kept) {
                self.bytes -= before.bytes();
            }
        }
        while self.bytes > SENT_REFERENCES_BYTES_MAX || self.order.len() > 2 * self.tiles.len() + 64
        {
            let Some(oldest) = self.order.pop_front() else {
                return;
            };
            self.forget(oldest);
        }
    }

    /// The client holds a later one: it will not name these again.
    fn drop_before(&mut self, tile: u32, request: RequestId) {
        let stale = self.tiles.range((tile, RequestId(0))..(tile, request));
        let stale: Vec<(u32, RequestId)> = stale.map(|(key, _)| *key).collect();
        for key in stale {
            self.forget(key);
        }
    }

    fn forget(&mut self, key: (u32, RequestId)) {
        if let Some(tile) = self.tiles.remove(&key) {
            self.bytes -= tile.bytes();
        }
    }
}
