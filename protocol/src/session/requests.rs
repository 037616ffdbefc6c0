//! Requests of a client that the node has not finished, and those that it has refused.

use std::collections::VecDeque;
use std::sync::Arc;

use carom_tracer::{Tile, TileGrid, TileRange};

use super::reference_tiles::References;
use crate::error::Error;
use crate::limits::REQUESTS_REFUSED_KEPT;
use crate::message::{FrameId, PixelFormat, RequestId, RequestReport, TraceRequest};
use crate::precision::PrecisionRange;
use crate::tile_codec::ReferenceTile;

/// A request that is neither done nor refused.
#[derive(Debug)]
pub(super) struct OpenRequest {
    pub(super) frame: FrameId,
    pub(super) grid: TileGrid,
    tiles: TileRange,
    pub(super) format: PixelFormat,
    pub(super) precision: PrecisionRange,
    /// References of its tiles, by place in the request; empty for linear formats.
    pub(super) references: References,
    /// Whether each tile has arrived, by its place in the request.
    received: Vec<bool>,
    pub(super) missing: u32,
    pub(super) cancelled: bool,
    /// A report that arrived before the last tile.
    pub(super) report: Option<RequestReport>,
}

/// The last [`REQUESTS_REFUSED_KEPT`] refused requests, whose tiles may still be on their way.
#[derive(Debug, Default)]
pub(super) struct RefusedRequests {
    kept: VecDeque<RequestId>,
    /// The highest request that has been forgotten: whether it or one below was refused is unknown.
    forgotten: Option<RequestId>,
}

impl OpenRequest {
    pub(super) fn new(request: &TraceRequest, references: References) -> Self {
        Self {
            frame: request.frame,
            grid: request.grid,
            tiles: request.tiles,
            format: request.format,
            precision: request.precision,
            references,
            received: Vec::new(),
            missing: request.tiles.count,
            cancelled: false,
            report: None,
        }
    }

    /// The tiles of a message, each with its reference.
    pub(super) fn with_references(
        &self,
        tiles: TileRange,
    ) -> Vec<(Tile, Option<&Arc<ReferenceTile>>)> {
        let place = |tile: u32| (tile - self.tiles.first) as usize;
        let reference = |tile| self.references.get(place(tile))?.as_ref();
        let tiles = tiles.indices();
        tiles
            .map(|tile| (self.grid.tile(tile), reference(tile)))
            .collect()
    }

    /// Marks `tiles` as received.
    pub(super) fn receive(&mut self, tiles: TileRange) -> Result<(), Error> {
        const WHAT: &str = "tile message";
        if tiles.first < self.tiles.first || tiles.end() > self.tiles.end() {
            let requested = self.tiles;
            let rule = format!("{tiles:?} was not asked for: the request is {requested:?}");
            return Err(Error::out_of_order(WHAT, rule));
        }
        self.received.resize(self.tiles.count as usize, false);
        let start = (tiles.first - self.tiles.first) as usize;
        let received = &mut self.received[start..][..tiles.count as usize];
        if received.contains(&true) {
            let rule = format!("some of {tiles:?} have come before");
            return Err(Error::out_of_order(WHAT, rule));
        }
        received.fill(true);
        self.missing -= tiles.count;
        Ok(())
    }
}

impl RefusedRequests {
    pub(super) fn insert(&mut self, request: RequestId) {
        self.kept.push_back(request);
        if self.kept.len() > REQUESTS_REFUSED_KEPT {
            self.forgotten = self.forgotten.max(self.kept.pop_front());
        }
    }

    /// Whether the request was refused, or is so old that it may have been.
    pub(super) fn may_hold(&self, request: RequestId) -> bool {
        // `None` is less than every request: while nothing is forgotten, the list alone decides.
        Some(request) <= self.forgotten || self.kept.contains(&request)
    }
}
