//! How much work tiles are, and how they are cut into shares.

use carom_tracer::{RenderSettings, TileGrid, TileRun};

/// Predicted work of each tile of a picture, as sums over the tiles before it.
///
/// A unit is a pixel sample of average cost. Every pixel counts the same here; a map of measured
/// costs per tile would enter in [`WorkMap::new`] and nowhere else.
#[derive(Clone, Debug)]
pub(super) struct WorkMap {
    before: Vec<f64>,
}

impl WorkMap {
    pub(super) fn new(grid: TileGrid, settings: &RenderSettings) -> Self {
        let samples = f64::from(settings.samples);
        let mut sum = 0.0;
        let mut before = Vec::with_capacity(grid.len() as usize + 1);
        before.push(0.0);
        for tile in grid.tiles(grid.all()) {
            sum += tile.pixels() as f64 * samples;
            before.push(sum);
        }
        Self { before }
    }

    /// The work of a run of tiles.
    pub(super) fn of(&self, run: TileRun) -> f64 {
        self.before[run.end() as usize] - self.before[run.first as usize]
    }

    /// The work of several runs.
    pub(super) fn of_all(&self, runs: &[TileRun]) -> f64 {
        runs.iter().map(|run| self.of(*run)).sum()
    }

    /// The work of a tile, on average.
    pub(super) fn mean_tile(&self) -> f64 {
        let tiles = (self.before.len() - 1).max(1);
        self.before[self.before.len() - 1] / tiles as f64
    }

    /// Deals the tiles of `pieces` out in their order, as near to `shares` as whole tiles allow.
    /// All are dealt; those with no share get none.
    pub(super) fn cut(&self, pieces: &[TileRun], shares: &[f64]) -> Vec<Vec<TileRun>> {
        let last = shares.iter().rposition(|share| *share > 0.0);
        let mut tiles = pieces.iter().flat_map(|run| run.indices()).peekable();
        let (mut dealt, mut target) = (0.0, 0.0);
        let mut deal = |(index, share): (usize, &f64)| {
            target += share;
            let mut runs = Vec::new();
            let all = Some(index) == last;
            while *share > 0.0
                && let Some(&tile) = tiles.peek()
            {
                let work = self.of(TileRun {
                    first: tile,
                    count: 1,
                });
                if !all && dealt + 0.5 * work > target {
                    break;
                }
                push_tile(&mut runs, tile);
                dealt += work;
                tiles.next();
            }
            runs
        };
        shares.iter().enumerate().map(&mut deal).collect()
    }
}

/// Appends a tile to runs that stay as few as can be.
pub(super) fn push_tile(runs: &mut Vec<TileRun>, tile: u32) {
    match runs.last_mut() {
        Some(run) if run.end() == tile => run.count += 1,
        _ => runs.push(TileRun {
            first: tile,
            count: 1,
        }),
    }
}

#[cfg(test)]
mod tests {
    use carom_tracer::ImageSize;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn each_tile_is_dealt_once_and_shares_are_met_within_a_tile(
            weights in prop::collection::vec(0.0..1.0f64, 1..12),
            holes in prop::collection::vec(any::<bool>(), 48),
        ) {
            let grid = TileGrid::new(ImageSize::new(80, 60), 10);
            let map = WorkMap::new(grid, &RenderSettings::default());
            let mut pieces = Vec::new();
            for tile in (0..grid.len()).filter(|tile| !holes[*tile as usize]) {
                push_tile(&mut pieces, tile);
            }
            let work = map.of_all(&pieces);
            let sum: f64 = weights.iter().sum();
            prop_assume!(sum > 0.0);
            let shares: Vec<f64> = weights.iter().map(|weight| weight / sum * work).collect();
            let dealt = map.cut(&pieces, &shares);
            let tiles = |runs: &[TileRun]| -> Vec<u32> {
                runs.iter().flat_map(|run| run.indices()).collect()
            };
            prop_assert_eq!(tiles(&dealt.concat()), tiles(&pieces));
            for (runs, share) in dealt.iter().zip(&shares) {
                prop_assert!((map.of_all(runs) - share).abs() <= 1.001 * map.mean_tile());
                prop_assert!(*share > 0.0 || runs.is_empty());
            }
        }
    }
}
