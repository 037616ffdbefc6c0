//! A tile that is traced again elsewhere: all that a request for it needs.

use std::sync::Arc;

use carom_protocol::{EncodedScene, FrameId};
use carom_tracer::{Tile, TileRange};

use super::sample_passes::SamplePasses;
use crate::frame::FrameSpec;

/// A tile of a frame that may have been delivered meanwhile, as it is asked for.
#[derive(Debug)]
pub(super) struct CheckedTile {
    pub(super) frame: FrameId,
    pub(super) spec: FrameSpec,
    pub(super) scene: Arc<EncodedScene>,
    pub(super) passes: SamplePasses,
    /// One unit.
    pub(super) unit: TileRange,
    pub(super) work: f64,
}

impl CheckedTile {
    /// Its place in the picture.
    pub(super) fn tile(&self) -> Tile {
        self.passes.grid.tile(self.passes.tile(self.unit.first))
    }
}
