//! Reference tiles that the two ends of a connection remember for delta coding.
//!
//! With each request the client names the tiles of earlier requests that it holds there; the node
//! delta-codes a tile against one that was named and that it still remembers. A tile is therefore only
//! coded against one that has arrived, and an end that forgets tiles costs bytes and nothing else.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use carom_tracer::{TileGrid, TileRange};

use crate::limits::{REFERENCE_RANGES_MAX, REFERENCE_REQUESTS_MAX, SENT_REFERENCES_BYTES_MAX};
use crate::message::{PixelFormat, ReferenceRange, RequestId, TraceRequest};
use crate::tile_codec::ReferenceTile;

/// The reference of each tile of a range, if there is one.
pub type References = Vec<Option<Arc<ReferenceTile>>>;

/// The client's end: the newest tile received at each place, of the last [`REFERENCE_REQUESTS_MAX`] requests.
#[derive(Debug, Default)]
pub(super) struct ReferenceList {
    grid: Option<TileGrid>,
    tiles: BTreeMap<u32, (RequestId, Arc<ReferenceTile>)>,
    /// Requests with tiles in here, in the order of their first tiles' arrival.
    requests: VecDeque<RequestId>,
}

impl ReferenceList {
    /// Fills in the references of `request`, and returns them, to be kept until its tiles have arrived.
    pub(super) fn fill_in(&mut self, request: &mut TraceRequest) -> References {
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
        for (&tile, (id, tile_held)) in self.tiles.range(request.tiles.indices()) {
            // Adjacent tiles of one request are merged into a range.
            let ranges = request.references.len();
            match request.references.last_mut() {
                Some(last) if last.request == *id && last.tiles.end() == tile => {
                    last.tiles.count += 1
                }
                _ if ranges == REFERENCE_RANGES_MAX => break,
                _ => {
                    let (first, count) = (tile, 1);
                    let tiles = TileRange { first, count };
                    request.references.push(ReferenceRange {
                        request: *id,
                        tiles,
                    });
                }
            }
            references[place(tile)] = Some(Arc::clone(tile_held));
        }
        references
    }

    /// Remembers tiles that have arrived.
    pub(super) fn insert(
        &mut self,
        grid: TileGrid,
        request: RequestId,
        tiles: TileRange,
        references: Vec<Arc<ReferenceTile>>,
    ) {
        if self.grid != Some(grid) {
            return;
        }
        if !self.requests.contains(&request) {
            self.requests.push_back(request);
        }
        for (tile, reference) in tiles.indices().zip(references) {
            // Requests overtake each other: an older tile does not replace a newer one.
            match self.tiles.get(&tile) {
                Some((newer, _)) if *newer > request => {}
                _ => drop(self.tiles.insert(tile, (request, reference))),
            }
        }
        if self.requests.len() > REFERENCE_REQUESTS_MAX {
            let oldest = self.requests.pop_front();
            self.tiles
                .retain(|_, (request, _)| Some(*request) != oldest);
        }
    }
}

/// The node's end: the tiles it has sent to a client, until the client holds later ones or
/// [`SENT_REFERENCES_BYTES_MAX`] bytes are remembered.
#[derive(Debug, Default)]
pub struct SentReferences {
    grid: Option<TileGrid>,
    tiles: BTreeMap<(u32, RequestId), Arc<ReferenceTile>>,
    /// In the order of sending; may include tiles already dropped.
    order: VecDeque<(u32, RequestId)>,
    bytes: usize,
}

impl SentReferences {
    /// The references of `tiles`, which are part of the request's.
    pub fn references(&mut self, request: &TraceRequest, tiles: TileRange) -> References {
        let mut references = vec![None; tiles.count as usize];
        if self.grid != Some(request.grid) {
            return references;
        }
        for named in &request.references {
            let range = named.tiles.first.max(tiles.first)..named.tiles.end().min(tiles.end());
            for tile in range {
                self.drop_before(tile, named.request);
                let reference = self.tiles.get(&(tile, named.request));
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
        references: Vec<Arc<ReferenceTile>>,
    ) {
        if self.grid != Some(request.grid) {
            *self = Self::default();
            self.grid = Some(request.grid);
        }
        for (tile, reference) in tiles.indices().zip(references) {
            self.bytes += reference.bytes();
            self.order.push_back((tile, request.id));
            if let Some(before) = self.tiles.insert((tile, request.id), reference) {
                self.bytes -= before.bytes();
            }
        }
        // Tiles dropped elsewhere stay in the order until they reach its front, so its length needs a bound
        // of its own.
        while self.bytes > SENT_REFERENCES_BYTES_MAX || self.order.len() > 2 * self.tiles.len() + 64
        {
            let Some(oldest) = self.order.pop_front() else {
                return;
            };
            self.forget(oldest);
        }
    }

    /// Drops the tiles sent before `request`: the client holds a later one and will not name these again.
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
