//! Units of a frame's work: each tile once per pass over its samples.
//!
//! ```text
//! one pass:   tile 0, tile 1, …            each with all samples
//! two passes: tile 0, tile 1, … with the first half, tile 0, tile 1, … with the second half
//! ```
//!
//! Balancers and recovery work on ranges of units and do not depend on the number of passes. With as many
//! passes as the fastest node's share of the farm's speed requires, each node traces different samples of
//! the whole picture.

use std::ops::Range;

use carom_protocol::PixelFormat;
use carom_tracer::{TileGrid, TileRange};

use crate::balancer::Candidate;
use crate::balancing::Distribution;
use crate::frame::FrameSpec;

/// Numbering of a frame's units: pass by pass, and within a pass tile by tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SamplePasses {
    pub(super) grid: TileGrid,
    count: u32,
    samples: u32,
}

impl SamplePasses {
    /// A single pass with all samples of each tile.
    pub(super) fn one(grid: TileGrid, samples: u32) -> Self {
        Self::several(grid, samples, 1)
    }

    /// `count` passes, from 1 to `samples`, whose sample counts differ by at most one.
    pub(super) fn several(grid: TileGrid, samples: u32, count: u32) -> Self {
        Self {
            grid,
            count,
            samples,
        }
    }

    pub(super) fn count(self) -> u32 {
        self.count
    }

    /// All units.
    pub(super) fn all(self) -> TileRange {
        TileRange {
            first: 0,
            count: self.grid.len() * self.count,
        }
    }

    /// The range of a frame's samples that a unit holds.
    pub(super) fn samples(self, unit: u32) -> Range<u32> {
        let pass = u64::from(unit / self.grid.len());
        // Cut at rounded multiples: the passes adjoin, cover all samples, and differ by one at most.
        let before = |pass: u64| (u64::from(self.samples) * pass / u64::from(self.count)) as u32;
        before(pass)..before(pass + 1)
    }

    /// The tile of a unit.
    pub(super) fn tile(self, unit: u32) -> u32 {
        unit % self.grid.len()
    }

    /// The tiles of units of one pass.
    pub(super) fn tiles(self, units: TileRange) -> TileRange {
        TileRange {
            first: self.tile(units.first),
            ..units
        }
    }

    /// The units of `tiles` in the pass of `unit`.
    pub(super) fn units(self, unit: u32, tiles: TileRange) -> TileRange {
        TileRange {
            first: unit - self.tile(unit) + tiles.first,
            ..tiles
        }
    }

    /// Splits a range of units into its ranges within single passes.
    pub(super) fn split(self, units: TileRange) -> impl Iterator<Item = TileRange> {
        let mut first = units.first;
        std::iter::from_fn(move || {
            let left = units.end() - first;
            let count = left.min(self.grid.len() - self.tile(first));
            let run = TileRange { first, count };
            first += count;
            (count > 0).then_some(run)
        })
    }
}

/// The number of passes for a frame on `candidates`: the fewest with which no node has much more than one
/// pass, so that as few pixels as possible cross the network repeatedly.
pub(super) fn passes_for(
    distribution: Distribution,
    spec: &FrameSpec,
    candidates: &[Candidate],
) -> u32 {
    let is_linear = !matches!(spec.format, PixelFormat::Srgb8 { .. });
    // Means of quantised, nonlinear sRGB levels would be wrong, and a denoiser works better on all samples
    // together.
    if distribution == Distribution::Tiles || !is_linear || spec.settings.denoise {
        return 1;
    }
    let estimates = candidates.iter().filter_map(|candidate| candidate.estimate);
    let speeds: Vec<f64> = estimates.map(|line| 1.0 / line.secs_per_work).collect();
    let fastest = speeds.iter().copied().fold(0.0, f64::max);
    // Nodes without an estimate count as equal to the fastest.
    let unknown = (candidates.len() - speeds.len()) as f64;
    // The farm's speed in units of its fastest node: with that many passes, its share is one pass.
    let parts = if fastest > 0.0 {
        speeds.iter().sum::<f64>() / fastest + unknown
    } else {
        unknown
    };
    let passes = (parts - ROUNDING).ceil() as u32;
    passes.min(PASSES_MAX).min(spec.settings.samples).max(1)
}

/// Maximum number of passes, as each sends the whole picture. With more nodes, several share a pass.
const PASSES_MAX: u32 = 16;
/// Tolerance so that n equal nodes get n passes however their sum is rounded.
const ROUNDING: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use carom_tracer::ImageSize;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn passes_hold_each_sample_of_each_tile_once(
            samples in 1..70_000u32,
            count in 1..=PASSES_MAX,
            cuts in prop::collection::vec(0.0..1.0f64, 0..6),
        ) {
            let grid = TileGrid::new(ImageSize::new(35, 20), 10);
            let passes = SamplePasses::several(grid, samples, count.min(samples));
            let all = passes.all().count;
            let mut ends: Vec<u32> = cuts.iter().map(|cut| (cut * f64::from(all)) as u32).collect();
            ends.push(all);
            ends.sort_unstable();
            let mut next = vec![0; grid.len() as usize];
            let mut first = 0;
            for end in ends {
                for run in passes.split(TileRange { first, count: end - first }) {
                    let tiles = passes.tiles(run);
                    prop_assert_eq!(passes.units(run.first, tiles), run);
                    let range = passes.samples(run.first);
                    prop_assert!(!range.is_empty());
                    for tile in tiles.indices() {
                        prop_assert_eq!(next[tile as usize], range.start);
                        next[tile as usize] = range.end;
                    }
                }
                first = end;
            }
            prop_assert!(next.iter().all(|next| *next == samples));
        }
    }
}
