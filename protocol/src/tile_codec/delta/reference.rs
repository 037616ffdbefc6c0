//! Reference tiles: the sent tiles that both ends of a connection remember.

use std::sync::Arc;

use carom_tracer::Tile;

use crate::precision::PixelPrecision;
use crate::tile_codec::transform::quantise::rounded;

/// An sRGB tile that was sent, against which later tiles are delta-coded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReferenceTile {
    /// Row-major. For a lossy tile the client keeps the decoded pixels and the node, which does not decode,
    /// the original ones: such a tile can be repeated, but nothing can be delta-coded against it.
    pub(crate) pixels: Box<[[u8; 3]]>,
    pub(crate) precision: PixelPrecision,
}

impl ReferenceTile {
    /// Number of bytes of its pixels.
    pub fn bytes(&self) -> usize {
        self.pixels.as_flattened().len()
    }

    /// The pixels against which a tile of `pixels` pixels can be delta-coded at `precision`; `None` if either
    /// precision is lossy or the sizes differ.
    pub(crate) fn base(&self, precision: PixelPrecision, pixels: usize) -> Option<&[[u8; 3]]> {
        let exact = self.precision.step().is_some() && precision.step().is_some();
        (exact && self.pixels.len() == pixels).then_some(&*self.pixels)
    }

    /// This reference requantised to `precision`, if tiles can be delta-coded against it.
    pub(crate) fn at_precision(
        self: &Arc<Self>,
        precision: PixelPrecision,
        tile: Tile,
    ) -> Option<Arc<Self>> {
        let base = self.base(precision, tile.pixels())?;
        if self.precision == precision {
            return Some(Arc::clone(self));
        }
        let pixels = rounded(precision.step()?, tile.width as usize, base);
        Some(Arc::new(Self { pixels, precision }))
    }

    /// Number of `pixels` of the same tile that differ from this one at its precision; all if the sizes
    /// differ.
    pub(crate) fn count_changed(&self, width: u32, pixels: &[[u8; 3]]) -> usize {
        if self.pixels.len() != pixels.len() {
            return pixels.len();
        }
        let count = |pixels: &[[u8; 3]]| {
            let pairs = self.pixels.iter().zip(pixels);
            pairs.filter(|(before, now)| before != now).count()
        };
        match self.precision.step() {
            Some(step) if step > 1 => count(&rounded(step, width as usize, pixels)),
            _ => count(pixels),
        }
    }
}

/// Statistics of a message's pixels against their references.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DeltaStats {
    /// Pixels of tiles with a reference.
    pub referenced: usize,
    /// Pixels of those tiles that differ from their reference.
    pub changed: usize,
    /// Pixels of tiles that cannot be delta-coded, for want of a reference or because it is lossy.
    pub intra: usize,
}

impl DeltaStats {
    /// Adds a tile; `changed` is `None` for one without a reference.
    pub(crate) fn add(&mut self, pixels: usize, is_intra: bool, changed: Option<usize>) {
        if let Some(changed) = changed {
            self.referenced += pixels;
            self.changed += changed;
        }
        if is_intra {
            self.intra += pixels;
        }
    }
}
