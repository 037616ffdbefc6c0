//! How much work tiles are, and how they are cut into shares.

use carom_tracer::TileRun;

use super::balancer::{Line, fill};
use super::passes::Passes;

/// Predicted work of each unit of a picture, as sums over those before it. Of a picture of one pass
/// the units are its tiles.
///
/// A unit is a pixel sample of average cost.
#[derive(Clone, Debug)]
pub(super) struct WorkMap {
    before: Vec<f64>,
}

/// Tiles as they are dealt, and when the last of them should be through.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Deal {
    /// The tiles of each line, in the order of the lines.
    pub(super) runs: Vec<Vec<TileRun>>,
    /// On the clock that the lines are on.
    pub(super) finish_secs: f64,
}

impl WorkMap {
    /// `costs` says how many times the average a pixel of each tile costs.
    pub(super) fn new(passes: Passes, costs: &[f64]) -> Self {
        let units = passes.all();
        let mut sum = 0.0;
        let mut before = Vec::with_capacity(units.count as usize + 1);
        before.push(0.0);
        for unit in units.indices() {
            let tile = passes.tile(unit);
            let pixels = passes.grid.tile(tile).pixels() as f64;
            sum += pixels * passes.samples(unit).len() as f64 * costs[tile as usize];
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

    /// The work of each tile.
    pub(super) fn tiles(&self) -> impl Iterator<Item = f32> {
        self.before
            .windows(2)
            .map(|pair| (pair[1] - pair[0]) as f32)
    }

    /// The work of a tile, on average.
    pub(super) fn mean_tile(&self) -> f64 {
        let tiles = (self.before.len() - 1).max(1);
        self.before[self.before.len() - 1] / tiles as f64
    }

    /// Deals the tiles of `pieces` out in their order so that the last is through as early as whole
    /// tiles allow: the least T at which the lines, each taking as many as fit below T, take all.
    ///
    /// Rounding the optimum in real numbers instead would give a tile to nodes that need far
    /// longer than T for one.
    pub(super) fn deal(&self, pieces: &[TileRun], lines: &[Line]) -> Deal {
        let queue = Queue::new(self, pieces);
        let filling = fill(queue.work(), lines);
        let Some(finish_secs) = queue.finish(lines, filling.finish_secs) else {
            return Deal {
                runs: self.cut(pieces, &filling.shares),
                finish_secs: filling.finish_secs,
            };
        };
        let mut start = 0;
        let take = |line: &Line| {
            let end = queue.take(start, line, finish_secs);
            let mut runs = Vec::new();
            queue.tiles[start..end]
                .iter()
                .for_each(|tile| push_tile(&mut runs, *tile));
            start = end;
            runs
        };
        Deal {
            runs: lines.iter().map(take).collect(),
            finish_secs,
        }
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

/// Tiles that wait to be dealt, with the work before each.
struct Queue {
    tiles: Vec<u32>,
    before: Vec<f64>,
}

impl Queue {
    fn new(work: &WorkMap, pieces: &[TileRun]) -> Self {
        let tiles: Vec<u32> = pieces.iter().flat_map(|run| run.indices()).collect();
        let mut before = Vec::with_capacity(tiles.len() + 1);
        let mut sum = 0.0;
        before.push(sum);
        for &first in &tiles {
            sum += work.of(TileRun { first, count: 1 });
            before.push(sum);
        }
        Self { tiles, before }
    }

    fn work(&self) -> f64 {
        self.before[self.tiles.len()]
    }

    /// The end of what a line takes from `start` on if it must be through at `finish_secs`.
    fn take(&self, start: usize, line: &Line, finish_secs: f64) -> usize {
        let room = line.room(finish_secs);
        if room <= 0.0 {
            return start;
        }
        let until = self.before[start] + room * (1.0 + ROUNDING);
        start + self.before[start + 1..].partition_point(|work| *work <= until)
    }

    /// The least time at which all are taken, to [`FINISH_PRECISION`]; `lowest` is no more than it.
    /// `None` if the lines' caps leave whole tiles over.
    fn finish(&self, lines: &[Line], lowest: f64) -> Option<f64> {
        let takes_all = |finish: f64| {
            let start = lines
                .iter()
                .fold(0, |start, line| self.take(start, line, finish));
            start == self.tiles.len()
        };
        let least_b = lines
            .iter()
            .map(|line| line.b_secs)
            .fold(f64::MAX, f64::min);
        let mut step = least_b * self.work() / self.tiles.len().max(1) as f64;
        let (mut low, mut high) = (lowest, lowest);
        while !takes_all(high) {
            if step > STEP_SECS_MAX {
                return None;
            }
            low = high;
            high += step;
            step *= 2.0;
        }
        while high - low > FINISH_PRECISION * (high - lines[0].a_secs.min(lowest)).abs() {
            let middle = 0.5 * (low + high);
            if !(low < middle && middle < high) {
                break;
            }
            if takes_all(middle) {
                high = middle;
            } else {
                low = middle;
            }
        }
        Some(high)
    }
}

/// Relative error that sums of work may have.
const ROUNDING: f64 = 1e-9;
/// Of a deal's finish, as a share of it.
const FINISH_PRECISION: f64 = 2e-3;
/// A deal that takes longer than this is none.
const STEP_SECS_MAX: f64 = 1e4;

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
    use carom_tracer::{ImageSize, TileGrid};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn each_tile_is_dealt_once_and_shares_are_met_within_a_tile(
            weights in prop::collection::vec(0.0..1.0f64, 1..12),
            holes in prop::collection::vec(any::<bool>(), 48),
        ) {
            let grid = TileGrid::new(ImageSize::new(80, 60), 10);
            let map = WorkMap::new(Passes::one(grid, 1), &[1.0; 48]);
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
