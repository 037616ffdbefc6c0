//! Relative costs of tiles, learned from earlier frames.

use carom_tracer::{TileGrid, TileRange};

/// Cost of each tile relative to the average. Successive frames cost nearly the same in the same place, so
/// that a division that knows the expensive places finishes more evenly: in simulation with 64 nodes at
/// 1.17 instead of 1.34 times the optimum.
#[derive(Clone, Debug, Default)]
pub(super) struct CostMap {
    grid: Option<TileGrid>,
    costs: Vec<f64>,
}

impl CostMap {
    /// The costs of a grid's tiles, scaled to a mean of 1. A different grid resets the map.
    pub(super) fn normalized(&mut self, grid: TileGrid) -> &[f64] {
        if self.grid != Some(grid) {
            self.grid = Some(grid);
            self.costs = vec![1.0; grid.len() as usize];
        }
        let mean = self.costs.iter().sum::<f64>() / self.costs.len().max(1) as f64;
        self.costs.iter_mut().for_each(|cost| *cost /= mean);
        &self.costs
    }

    /// Learns that tiles took `ratio` times their predicted time.
    pub(super) fn learn(&mut self, grid: TileGrid, tiles: TileRange, ratio: f64) {
        if self.grid != Some(grid) || ratio.is_nan() {
            return;
        }
        // A step in the logarithm, so that twice and half the prediction weigh the same and costs stay
        // positive.
        let factor = ratio.clamp(1.0 / RATIO_MAX, RATIO_MAX).powf(GAIN);
        for cost in &mut self.costs[tiles.first as usize..tiles.end() as usize] {
            *cost = (*cost * factor).clamp(1.0 / COST_MAX, COST_MAX);
        }
    }
}

/// Gain of the logarithmic update.
const GAIN: f64 = 0.3;
/// Ratio at which an observation is clipped.
const RATIO_MAX: f64 = 4.0;
/// Bounds of a tile's cost relative to the average: from 1 / [`COST_MAX`] to it.
const COST_MAX: f64 = 64.0;

#[cfg(test)]
mod tests {
    use carom_tracer::ImageSize;

    use super::*;

    #[test]
    fn costs_approach_those_of_tiles_with_a_mean_of_one() {
        let grid = TileGrid::new(ImageSize::new(40, 10), 10);
        let truth = [0.4, 0.4, 1.6, 1.6];
        let mut map = CostMap::default();
        for _ in 0..40 {
            let costs = map.normalized(grid).to_vec();
            for first in [0, 2] {
                let ratio = truth[first] / costs[first];
                let first = first as u32;
                map.learn(grid, TileRange { first, count: 2 }, ratio);
            }
        }
        for (cost, truth) in map.normalized(grid).iter().zip(truth) {
            assert!((cost - truth).abs() < 0.01, "{cost} for {truth}");
        }
    }

    #[test]
    fn no_report_makes_a_tile_free_or_endless() {
        let grid = TileGrid::new(ImageSize::new(40, 10), 10);
        let mut map = CostMap::default();
        map.normalized(grid);
        for ratio in [0.0, f64::INFINITY, f64::NAN, -1.0] {
            for _ in 0..100 {
                map.learn(grid, TileRange { first: 1, count: 1 }, ratio);
            }
            let costs = map.normalized(grid);
            assert!(
                costs.iter().all(|cost| cost.is_finite() && *cost > 1e-3),
                "{costs:?}"
            );
        }
    }
}
