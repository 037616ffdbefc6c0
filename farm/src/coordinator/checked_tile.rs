//! The tile of a spot check, with all that a request for it needs.

use std::sync::Arc;

use carom_protocol::{EncodedScene, FrameId};
use carom_tracer::{Tile, TileRange};

use super::sample_passes::SamplePasses;
use crate::frame::FrameSpec;

/// A tile to trace again; its frame may have been delivered in the meantime.
#[derive(Debug)]
pub(super) struct CheckedTile {
    pub(super) frame: FrameId,
    pub(super) spec: FrameSpec,
    pub(super) scene: Arc<EncodedScene>,
    pub(super) passes: SamplePasses,
    /// The tile, as a range of one unit.
    pub(super) unit: TileRange,
    pub(super) work: f64,
}

impl CheckedTile {
    /// Its place in the picture.
    pub(super) fn tile(&self) -> Tile {
        self.passes.grid.tile(self.passes.tile(self.unit.first))
    }
}
