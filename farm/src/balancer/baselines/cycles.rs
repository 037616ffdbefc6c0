//! The rule of Blender Cycles' `WorkBalancer`: each weight is scaled so that its time moves 1/n of the way
//! to the mean, until all times are within two per cent of it.
//!
//! It does not model latency, and the step shrinks with the number of nodes, so that large farms converge
//! slowly.

use std::collections::BTreeMap;

use super::{RESPONSE_SECS_MIN, at_least_a_tile, known_or_mean};
use crate::balancer::{Balancer, Division, RequestOutcome, Shares};
use crate::node_status::NodeIndex;

/// See [`crate::Algorithm::Cycles`].
#[derive(Debug, Default)]
pub struct Cycles {
    weights: BTreeMap<NodeIndex, f64>,
    /// Response times since the last change of weights, in seconds.
    times: BTreeMap<NodeIndex, f64>,
}

impl Cycles {
    /// Updates the weights once all candidates have reported.
    fn rebalance(&mut self, division: &Division<'_>) {
        let nodes = || division.candidates.iter().map(|candidate| candidate.node);
        let times: Option<Vec<f64>> = nodes().map(|node| self.times.get(&node).copied()).collect();
        let Some(times) = times else {
            return;
        };
        self.times.clear();
        let count = times.len() as f64;
        let mean = times.iter().sum::<f64>() / count;
        if times
            .iter()
            .all(|time| (time - mean).abs() <= DEAD_BAND * mean)
        {
            return;
        }
        for (node, time) in nodes().zip(times) {
            let wanted = time + (mean - time) / count;
            *self.weights.entry(node).or_insert(1.0) *= wanted / time;
        }
    }
}

impl Balancer for Cycles {
    /// A node without a weight counts as the mean of the others. No node gets less than one tile, or it
    /// would never report.
    fn divide(&mut self, division: &Division<'_>) -> Shares {
        self.rebalance(division);
        let nodes = || division.candidates.iter().map(|candidate| candidate.node);
        let weights = known_or_mean(nodes().map(|node| self.weights.get(&node).copied()));
        self.weights.extend(nodes().zip(weights.iter().copied()));
        at_least_a_tile(division, &weights)
    }

    fn learn(&mut self, outcome: &RequestOutcome) {
        let time = outcome.response_secs.max(RESPONSE_SECS_MIN);
        self.times.insert(outcome.node, time);
    }
}

/// Relative deviation from the mean that is tolerated.
const DEAD_BAND: f64 = 0.02;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::balancer::baselines::tests::{division, new_nodes};

    #[test]
    fn times_of_two_nodes_come_within_the_dead_band() {
        let mut cycles = Cycles::default();
        let candidates = new_nodes::<2>();
        let division = division(1000.0, 1.0, &candidates);
        let mut times = [0.0; 2];
        for _ in 0..40 {
            let Shares::Work(shares) = cycles.divide(&division) else {
                unreachable!("the rule names shares");
            };
            times = [shares[0] * 1e-3, shares[1] * 4e-3];
            for (node, response_secs) in times.into_iter().enumerate() {
                cycles.learn(&RequestOutcome {
                    node: NodeIndex(node),
                    tiles: 1,
                    work: 1.0,
                    response_secs,
                    busy_secs: 0.0,
                });
            }
        }
        assert!((times[0] / times[1] - 1.0).abs() < 0.05, "{times:?}");
    }
}
