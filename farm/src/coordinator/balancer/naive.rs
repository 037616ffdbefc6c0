//! In proportion to each node's last speed, x / y: response times become equal, but a far node
//! and a slow one look the same.

use std::collections::BTreeMap;

use super::{Balancer, Division, Outcome, in_proportion};
use crate::coordinator::NodeIndex;

/// See [`crate::Algorithm::Naive`].
#[derive(Debug, Default)]
pub struct Naive {
    /// Tiles per second of the last run.
    speeds: BTreeMap<NodeIndex, f64>,
}

impl Balancer for Naive {
    /// A node that has not delivered yet counts as the mean of the others. Nobody gets less than
    /// one tile, or it would never be measured again.
    fn divide(&mut self, division: &Division<'_>) -> Vec<f64> {
        let speeds = division.candidates.iter();
        let speeds: Vec<_> = speeds
            .map(|candidate| self.speeds.get(&candidate.node))
            .collect();
        let known: Vec<f64> = speeds.iter().flatten().copied().copied().collect();
        let mean = if known.is_empty() {
            1.0
        } else {
            known.iter().sum::<f64>() / known.len() as f64
        };
        let weights: Vec<f64> = speeds.iter().map(|speed| *speed.unwrap_or(&mean)).collect();
        let shares = in_proportion(division.work, &weights);
        let at_least_a_tile: Vec<f64> = shares
            .iter()
            .map(|share| share.max(division.tile_work))
            .collect();
        in_proportion(division.work, &at_least_a_tile)
    }

    fn learn(&mut self, outcome: &Outcome) {
        let speed = f64::from(outcome.tiles) / outcome.response_secs.max(RESPONSE_SECS_MIN);
        self.speeds.insert(outcome.node, speed);
    }
}

/// Shorter responses are below the resolution that durations are measured with.
const RESPONSE_SECS_MIN: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coordinator::balancer::Candidate;

    #[test]
    fn work_follows_the_last_speed() {
        let mut naive = Naive::default();
        for (node, tiles, response_secs) in [(0, 10, 10.0), (0, 30, 0.3), (1, 20, 0.1)] {
            naive.learn(&Outcome {
                node: NodeIndex(node),
                tiles,
                work: f64::from(tiles),
                response_secs,
                busy_secs: 0.0,
            });
        }
        let candidates = [0, 1, 2].map(|node| Candidate {
            node: NodeIndex(node),
            estimate: None,
            wait_secs: 0.0,
            proven_work: 0.0,
        });
        let shares = naive.divide(&Division {
            work: 450.0,
            tile_work: 1.0,
            period_secs: f64::INFINITY,
            candidates: &candidates,
        });
        // Speeds 100 and 200 tiles a second, and their mean for the node that is new.
        for (share, expected) in shares.iter().zip([100.0, 200.0, 150.0]) {
            assert!((share - expected).abs() < 1e-9, "{shares:?}");
        }
    }
}
