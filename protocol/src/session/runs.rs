//! What a client knows of the runs it asked for.

use std::collections::VecDeque;
use std::sync::Arc;

use carom_tracer::{Tile, TileGrid, TileRun};

use super::held::References;
use crate::Error;
use crate::limits::RUNS_REFUSED_KEPT;
use crate::message::{FrameId, PixelFormat, RunId, RunReport, TraceRequest};
use crate::precision::PrecisionRange;
use crate::tile_codec::ReferenceTile;

/// A run that is neither done nor refused.
#[derive(Debug)]
pub(super) struct Run {
    pub(super) frame: FrameId,
    pub(super) grid: TileGrid,
    tiles: TileRun,
    pub(super) format: PixelFormat,
    pub(super) precision: PrecisionRange,
    /// What its tiles may be told from, by place in the run; empty for linear formats.
    pub(super) references: References,
    /// By the tile's place in the run.
    received: Vec<bool>,
    pub(super) missing: u32,
    pub(super) cancelled: bool,
    /// A report that came before the last tile.
    pub(super) report: Option<RunReport>,
}

/// The last [`RUNS_REFUSED_KEPT`] refused runs, whose tiles may still be on their way.
#[derive(Debug, Default)]
pub(super) struct RefusedRuns {
    kept: VecDeque<RunId>,
    /// The highest run that has been forgotten; up to here nothing is known for sure.
    forgotten: Option<RunId>,
}

impl Run {
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

    /// The tiles of a message, each with what it may be told from.
    pub(super) fn with_references(
        &self,
        tiles: TileRun,
    ) -> Vec<(Tile, Option<&Arc<ReferenceTile>>)> {
        let place = |tile: u32| (tile - self.tiles.first) as usize;
        let reference = |tile| self.references.get(place(tile))?.as_ref();
        let tiles = tiles.indices();
        tiles
            .map(|tile| (self.grid.tile(tile), reference(tile)))
            .collect()
    }

    /// Notes that `tiles` have come.
    pub(super) fn receive(&mut self, tiles: TileRun) -> Result<(), Error> {
        const WHAT: &str = "tile message";
        if tiles.first < self.tiles.first || tiles.end() > self.tiles.end() {
            let why = format!("{tiles:?} was not asked for: the run is {:?}", self.tiles);
            return Err(Error::out_of_order(WHAT, why));
        }
        self.received.resize(self.tiles.count as usize, false);
        let start = (tiles.first - self.tiles.first) as usize;
        let received = &mut self.received[start..][..tiles.count as usize];
        if received.contains(&true) {
            let why = format!("some of {tiles:?} have come before");
            return Err(Error::out_of_order(WHAT, why));
        }
        received.fill(true);
        self.missing -= tiles.count;
        Ok(())
    }
}

impl RefusedRuns {
    pub(super) fn insert(&mut self, run: RunId) {
        self.kept.push_back(run);
        if self.kept.len() > RUNS_REFUSED_KEPT {
            self.forgotten = self.forgotten.max(self.kept.pop_front());
        }
    }

    /// Whether the run was refused, or is so old that it may have been.
    pub(super) fn may_hold(&self, run: RunId) -> bool {
        Some(run) <= self.forgotten || self.kept.contains(&run)
    }
}
