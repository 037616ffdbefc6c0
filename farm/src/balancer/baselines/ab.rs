//! The AB division of the 2016 distributed ray tracer: y = A + B·x with x in tiles, A and B as averages
//! over all requests so far, and the common finish T from Σ (T − A) / B = W.
//!
//! As published, and in a variant with exponential averages. Plain averages follow a change of a node
//! slowly, and nodes with A ≥ T are clamped to zero without computing T again;
//! [`crate::balancer::WaterFilling`] improves on both, and the comparison shows by how much.

use std::collections::BTreeMap;

use super::Equal;
use crate::balancer::{Balancer, Division, RequestOutcome, Shares, in_proportion};
use crate::node_status::NodeIndex;

/// See [`crate::Algorithm::Ab`] and [`crate::Algorithm::AbExponential`].
#[derive(Debug)]
pub struct Ab {
    frames: u32,
    /// Decay of an observation's weight with each further one.
    kept: f64,
    nodes: BTreeMap<NodeIndex, Averages>,
}

/// Weighted sums over all requests of a node.
#[derive(Clone, Copy, Debug, Default)]
struct Averages {
    runs: f64,
    tiles: f64,
    busy_secs: f64,
    fixed_secs: f64,
}

/// A in seconds, B in seconds per tile.
type AbCost = (f64, f64);

impl Ab {
    /// Frames that are divided equally before the averages are used.
    pub const WARM_UP_FRAMES: u32 = 60;

    /// With plain averages over all requests.
    pub fn averages() -> Self {
        Self::keeping(1.0)
    }

    /// With exponential averages.
    pub fn exponential() -> Self {
        Self::keeping(EXPONENTIAL_KEPT)
    }

    fn keeping(kept: f64) -> Self {
        Self {
            frames: 0,
            kept,
            nodes: BTreeMap::new(),
        }
    }

    fn cost_models(&self, division: &Division<'_>) -> Option<Vec<AbCost>> {
        let nodes = division.candidates.iter().map(|candidate| candidate.node);
        let costs: Vec<_> = nodes
            .map(|node| self.nodes.get(&node).map(Averages::cost))
            .collect();
        let known: Vec<AbCost> = costs.iter().flatten().copied().collect();
        if known.is_empty() {
            return None;
        }
        let mean = |of: fn(&AbCost) -> f64| known.iter().map(of).sum::<f64>() / known.len() as f64;
        let newcomer = (mean(|cost| cost.0), mean(|cost| cost.1));
        Some(
            costs
                .into_iter()
                .map(|cost| cost.unwrap_or(newcomer))
                .collect(),
        )
    }
}

impl Balancer for Ab {
    fn divide(&mut self, division: &Division<'_>) -> Shares {
        self.frames += 1;
        let costs = match self.cost_models(division) {
            Some(costs) if self.frames > Self::WARM_UP_FRAMES => costs,
            _ => return Equal.divide(division),
        };
        let tiles = division.work / division.tile_work;
        // T solves Σ (T − A) / B = W over all nodes, also those with A ≥ T, whose negative shares are cut
        // off afterwards.
        let speed: f64 = costs.iter().map(|(_, b)| 1.0 / b).sum();
        let head_start: f64 = costs.iter().map(|(a, b)| a / b).sum();
        let finish = (tiles + head_start) / speed;
        let shares: Vec<f64> = costs
            .iter()
            .map(|(a, b)| ((finish - a) / b).max(0.0))
            .collect();
        Shares::Work(in_proportion(division.work, &shares))
    }

    fn learn(&mut self, outcome: &RequestOutcome) {
        let averages = self.nodes.entry(outcome.node).or_default();
        let add = |sum: &mut f64, value: f64| *sum = *sum * self.kept + value;
        add(&mut averages.runs, 1.0);
        add(&mut averages.tiles, f64::from(outcome.tiles));
        add(&mut averages.busy_secs, outcome.busy_secs);
        let fixed_secs = outcome.response_secs - outcome.busy_secs;
        add(&mut averages.fixed_secs, fixed_secs);
    }
}

impl Averages {
    fn cost(&self) -> AbCost {
        let a = self.fixed_secs / self.runs;
        let b = (self.busy_secs / self.tiles).max(SECS_PER_TILE_MIN);
        (a, b)
    }
}

/// Decay per request: after four of them a weight is 0.32.
const EXPONENTIAL_KEPT: f64 = 0.75;
/// Lower limit of B: below it, the node's clock is too coarse.
const SECS_PER_TILE_MIN: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::balancer::baselines::tests::{division, new_nodes};

    #[test]
    fn all_finish_together_after_sixty_equal_frames() {
        let mut ab = Ab::averages();
        let candidates = new_nodes::<2>();
        let division = division(1000.0, 10.0, &candidates);
        let (a, b) = ([0.02, 0.001], [0.001, 0.004]);
        for _ in 0..Ab::WARM_UP_FRAMES {
            assert_eq!(ab.divide(&division), Shares::Work(vec![500.0, 500.0]));
            for node in [0, 1] {
                ab.learn(&RequestOutcome {
                    node: NodeIndex(node),
                    tiles: 50,
                    work: 500.0,
                    response_secs: a[node] + 50.0 * b[node],
                    busy_secs: 50.0 * b[node],
                });
            }
        }
        let Shares::Work(shares) = ab.divide(&division) else {
            unreachable!("AB names shares");
        };
        let tiles: Vec<f64> = shares.iter().map(|share| share / 10.0).collect();
        let finish = |node: usize| a[node] + b[node] * tiles[node];
        assert!((finish(0) - finish(1)).abs() < 1e-9, "{tiles:?}");
        assert!((tiles[0] + tiles[1] - 100.0).abs() < 1e-9);
    }
}
