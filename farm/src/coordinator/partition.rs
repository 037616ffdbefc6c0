//! Partition of tiles among nodes by the predicted work of each tile.

use carom_tracer::TileRange;

use super::sample_passes::SamplePasses;
use crate::balancer::{CostModel, water_fill};

/// Predicted work of each unit of a picture, as prefix sums. With one pass, the units are the tiles.
///
/// One unit of work is one pixel sample of average cost.
#[derive(Clone, Debug)]
pub(super) struct WorkMap {
    before: Vec<f64>,
}

/// An assignment of tiles, and when the last of them should be finished.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Partition {
    /// The tiles of each node, in the order of the nodes.
    pub(super) tiles: Vec<Vec<TileRange>>,
    /// Finish in seconds, on the clock of the cost models' `fixed_secs`.
    pub(super) finish_secs: f64,
}

impl WorkMap {
    /// Sums the work of all units. `costs` is the cost of a pixel sample of each tile, relative to the
    /// average.
    pub(super) fn new(passes: SamplePasses, costs: &[f64]) -> Self {
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

    /// The work of a range of tiles.
    pub(super) fn of(&self, run: TileRange) -> f64 {
        self.before[run.end() as usize] - self.before[run.first as usize]
    }

    /// The work of several ranges.
    pub(super) fn of_all(&self, tiles: &[TileRange]) -> f64 {
        tiles.iter().map(|range| self.of(*range)).sum()
    }

    /// The work of each tile.
    pub(super) fn tiles(&self) -> impl Iterator<Item = f32> {
        self.before
            .windows(2)
            .map(|pair| (pair[1] - pair[0]) as f32)
    }

    /// The mean work of a unit.
    pub(super) fn mean_tile(&self) -> f64 {
        let tiles = (self.before.len() - 1).max(1);
        self.before[self.before.len() - 1] / tiles as f64
    }

    /// Assigns the tiles of `pieces` in order so that the last finishes as early as whole tiles allow: at
    /// the least T at which the nodes, each taking as many tiles as fit before T, take all.
    ///
    /// Rounding the optimum for divisible work instead would give tiles to nodes that need far longer than
    /// T for one.
    pub(super) fn partition(&self, pieces: &[TileRange], models: &[CostModel]) -> Partition {
        let queue = TileQueue::new(self, pieces);
        let allocation = water_fill(queue.work(), models);
        let Some(finish_secs) = queue.finish(models, allocation.finish_secs) else {
            return Partition {
                tiles: self.split(pieces, &allocation.shares),
                finish_secs: allocation.finish_secs,
            };
        };
        let mut tiles = vec![Vec::new(); models.len()];
        queue.serve(models, finish_secs, |node, taken| {
            let ranges = &mut tiles[node];
            taken.iter().for_each(|tile| push_tile(ranges, *tile));
        });
        Partition { tiles, finish_secs }
    }

    /// Assigns the tiles of `pieces` in order, as near to `shares` as whole tiles allow. All are assigned;
    /// nodes without a share get none.
    pub(super) fn split(&self, pieces: &[TileRange], shares: &[f64]) -> Vec<Vec<TileRange>> {
        let last = shares.iter().rposition(|share| *share > 0.0);
        let mut waiting = pieces.iter().flat_map(|range| range.indices()).peekable();
        let (mut dealt, mut target) = (0.0, 0.0);
        let mut deal = |(index, share): (usize, &f64)| {
            target += share;
            let mut tiles = Vec::new();
            let all = Some(index) == last;
            while *share > 0.0
                && let Some(&tile) = waiting.peek()
            {
                let work = self.of(TileRange {
                    first: tile,
                    count: 1,
                });
                // A tile goes to the node that gets the larger part of it, and the rest to the last one.
                // Compared with the running sum of shares, so that rounding does not accumulate over many
                // nodes.
                if !all && dealt + 0.5 * work > target {
                    break;
                }
                push_tile(&mut tiles, tile);
                dealt += work;
                waiting.next();
            }
            tiles
        };
        shares.iter().enumerate().map(&mut deal).collect()
    }
}

/// Tiles to be assigned, in order, with prefix sums of their work.
struct TileQueue {
    tiles: Vec<u32>,
    before: Vec<f64>,
}

impl TileQueue {
    fn new(work: &WorkMap, pieces: &[TileRange]) -> Self {
        let tiles: Vec<u32> = pieces.iter().flat_map(|range| range.indices()).collect();
        let mut before = Vec::with_capacity(tiles.len() + 1);
        let mut sum = 0.0;
        before.push(sum);
        for &first in &tiles {
            sum += work.of(TileRange { first, count: 1 });
            before.push(sum);
        }
        Self { tiles, before }
    }

    fn work(&self) -> f64 {
        self.before[self.tiles.len()]
    }

    /// Lets each node take the tiles that it finishes by `finish_secs`: at each step the one of the next
    /// [`TileQueue::window`] nodes that the next tiles fit best. Returns whether all tiles are taken.
    fn serve(
        &self,
        models: &[CostModel],
        finish_secs: f64,
        mut taken: impl FnMut(usize, &[u32]),
    ) -> bool {
        let rooms = models
            .iter()
            .map(|model| model.room(finish_secs))
            .enumerate();
        let mut rooms = rooms.filter(|(_, room)| *room > 0.0);
        let mut waiting: Vec<(usize, f64)> =
            rooms.by_ref().take(self.window(models.len())).collect();
        let mut start = 0;
        while start < self.tiles.len() {
            let left_over = |place: usize| {
                let room = waiting[place].1;
                let end = self.end(start, room);
                (room - (self.before[end] - self.before[start]), place, end)
            };
            // Best fit within a small window; over all nodes it would be quadratic in their number.
            let fits = (0..waiting.len()).map(left_over);
            let Some((_, place, end)) = fits.min_by(|a, b| a.0.total_cmp(&b.0)) else {
                return false;
            };
            taken(waiting[place].0, &self.tiles[start..end]);
            start = end;
            match rooms.next() {
                Some(next) => waiting[place] = next,
                None => drop(waiting.swap_remove(place)),
            }
        }
        true
    }

    /// How many nodes compete for the next tiles: where each takes only a few, what their capacities leave
    /// over for want of half a tile would add up to a tenth of all tiles.
    fn window(&self, models: usize) -> usize {
        if self.tiles.len() < FEW_TILES * models {
            WINDOW
        } else {
            1
        }
    }

    /// End of the longest run of tiles from `start` that fits into `room`.
    fn end(&self, start: usize, room: f64) -> usize {
        // `room` is computed from a finish that itself came from sums of work: rounding must not cost its
        // last tile.
        let until = self.before[start] + room * (1.0 + ROUNDING);
        let mut step = 1;
        while self
            .before
            .get(start + step)
            .is_some_and(|work| *work <= until)
        {
            // Galloping search: the cost is logarithmic in the tiles taken, not in the queue's length.
            step *= 2;
        }
        let (low, high) = (start + step / 2, self.before.len().min(start + step));
        low + self.before[low + 1..high].partition_point(|work| *work <= until)
    }

    /// The least time at which all tiles are taken, to a relative [`FINISH_PRECISION`]; `lowest` is a lower
    /// bound. `None` if the models' work bounds leave whole tiles over.
    fn finish(&self, models: &[CostModel], lowest: f64) -> Option<f64> {
        let takes_all = |finish: f64| self.serve(models, finish, |_, _| {});
        let least_b = models
            .iter()
            .map(|model| model.secs_per_work)
            .fold(f64::MAX, f64::min);
        let mut step = least_b * self.work() / self.tiles.len().max(1) as f64;
        let (mut low, mut high) = (lowest, lowest);
        // Bracketing by doubling steps, from about a tile's duration, as the optimum for divisible work is
        // mostly close; then bisection.
        while !takes_all(high) {
            if step > STEP_SECS_MAX {
                return None;
            }
            low = high;
            high += step;
            step *= 2.0;
        }
        // `fixed_secs` may be moments of the client's clock: the precision is relative to the partition's
        // duration, not to the absolute time.
        while high - low > FINISH_PRECISION * (high - models[0].fixed_secs.min(lowest)).abs() {
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

/// Number of competing nodes where there are fewer than `FEW_TILES` tiles per node.
const WINDOW: usize = 4;
const FEW_TILES: usize = 16;
/// Relative rounding error allowed for in sums of work.
const ROUNDING: f64 = 1e-9;
/// Precision of a partition's finish, as a share of its duration.
const FINISH_PRECISION: f64 = 2e-3;
/// Step of the bracketing, in seconds, above which the tiles are taken not to fit at all.
const STEP_SECS_MAX: f64 = 1e4;

/// Appends a tile to a list of ranges, merging it with the last one if adjacent.
pub(super) fn push_tile(ranges: &mut Vec<TileRange>, tile: u32) {
    match ranges.last_mut() {
        Some(range) if range.end() == tile => range.count += 1,
        _ => ranges.push(TileRange {
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
        fn shares_are_met_within_a_tile(
            weights in prop::collection::vec(0.0..1.0f64, 1..12),
            holes in prop::collection::vec(any::<bool>(), 48),
        ) {
            let grid = TileGrid::new(ImageSize::new(80, 60), 10);
            let map = WorkMap::new(SamplePasses::one(grid, 1), &[1.0; 48]);
            let mut pieces = Vec::new();
            for tile in (0..grid.len()).filter(|tile| !holes[*tile as usize]) {
                push_tile(&mut pieces, tile);
            }
            let work = map.of_all(&pieces);
            let sum: f64 = weights.iter().sum();
            prop_assume!(sum > 0.0);
            let shares: Vec<f64> = weights.iter().map(|weight| weight / sum * work).collect();
            let dealt = map.split(&pieces, &shares);
            let tiles = |ranges: &[TileRange]| -> Vec<u32> {
                ranges.iter().flat_map(|range| range.indices()).collect()
            };
            prop_assert_eq!(tiles(&dealt.concat()), tiles(&pieces));
            for (tiles, share) in dealt.iter().zip(&shares) {
                prop_assert!((map.of_all(tiles) - share).abs() <= 1.001 * map.mean_tile());
                prop_assert!(*share > 0.0 || tiles.is_empty());
            }
        }

        #[test]
        fn partition_assigns_each_tile_once_and_in_time(
            models in prop::collection::vec((0.0..0.02f64, 1e-6..1e-3f64, 0.0..0.01f64), 1..24),
            costs in prop::collection::vec(0.3..3.0f64, 48),
        ) {
            let grid = TileGrid::new(ImageSize::new(80, 60), 10);
            let map = WorkMap::new(SamplePasses::one(grid, 1), &costs);
            let model = |&(fixed_secs, secs_per_work, margin_secs): &(f64, f64, f64)| CostModel {
                unmonitored_work: 150.0,
                margin_secs,
                ..CostModel::new(fixed_secs, secs_per_work)
            };
            let models: Vec<CostModel> = models.iter().map(model).collect();
            let partition = map.partition(&[grid.all()], &models);
            let mut dealt: Vec<TileRange> = partition.tiles.concat();
            dealt.sort_by_key(|range| range.first);
            let tiles: Vec<u32> = dealt.iter().flat_map(|range| range.indices()).collect();
            prop_assert_eq!(tiles, grid.all().indices().collect::<Vec<_>>());
            for (model, tiles) in models.iter().zip(&partition.tiles) {
                prop_assert!(tiles.len() <= 1, "a node's tiles are in a row");
                let work = map.of_all(tiles);
                let finish = model.fixed_secs + model.secs_per_work * work;
                prop_assert!(work == 0.0 || finish <= partition.finish_secs * (1.0 + 1e-6));
            }
            // No single node, up to whole tiles, is much faster than all together.
            let alone = models.iter().map(|model| model.fixed_secs + model.margin_secs + model.secs_per_work * map.of(grid.all()));
            prop_assert!(partition.finish_secs <= alone.fold(f64::INFINITY, f64::min) * 1.01 + 1e-9);
        }
    }
}
