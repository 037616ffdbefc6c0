//! Division in proportion to each node's speed x / y. Response times become equal, but a distant node and a
//! slow one are not distinguished. The speed is that of the last request, the mean of all, or the mean of
//! the first ones for good, as in the 2016 distributed ray tracer.

use std::collections::BTreeMap;

use super::{RESPONSE_SECS_MIN, at_least_a_tile, known_or_mean};
use crate::balancer::{Balancer, Division, RequestOutcome, Shares};
use crate::node_status::NodeIndex;

/// See [`crate::Algorithm::Naive`], [`crate::Algorithm::NaiveMean`] and
/// [`crate::Algorithm::NaiveFrozen`].
#[derive(Debug)]
pub struct Naive {
    memory: Memory,
    nodes: BTreeMap<NodeIndex, Speed>,
}

#[derive(Clone, Copy, Debug)]
enum Memory {
    Last,
    Mean,
    Frozen,
}

/// Mean speed over requests, in tiles per second.
#[derive(Clone, Copy, Debug, Default)]
struct Speed {
    mean: f64,
    runs: u32,
}

impl Naive {
    /// With the speed of the last request.
    pub fn last() -> Self {
        Self::remembering(Memory::Last)
    }

    /// With the mean over all requests.
    pub fn mean() -> Self {
        Self::remembering(Memory::Mean)
    }

    /// With the mean over the first 60 requests.
    pub fn frozen() -> Self {
        Self::remembering(Memory::Frozen)
    }

    fn remembering(memory: Memory) -> Self {
        let nodes = BTreeMap::new();
        Self { memory, nodes }
    }
}

impl Balancer for Naive {
    /// A node that has not delivered yet counts as the mean of the others. No node gets less than one tile,
    /// or it would never be measured again.
    fn divide(&mut self, division: &Division<'_>) -> Shares {
        let speeds = division.candidates.iter();
        let speeds = speeds.map(|candidate| Some(self.nodes.get(&candidate.node)?.mean));
        at_least_a_tile(division, &known_or_mean(speeds))
    }

    fn learn(&mut self, outcome: &RequestOutcome) {
        let seen = f64::from(outcome.tiles) / outcome.response_secs.max(RESPONSE_SECS_MIN);
        let speed = self.nodes.entry(outcome.node).or_default();
        speed.runs = speed.runs.saturating_add(1);
        let gain = match self.memory {
            Memory::Last => 1.0,
            Memory::Frozen if speed.runs > FROZEN_RUNS => 0.0,
            Memory::Mean | Memory::Frozen => 1.0 / f64::from(speed.runs),
        };
        speed.mean += gain * (seen - speed.mean);
    }
}

/// Requests that enter the frozen mean.
const FROZEN_RUNS: u32 = 60;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::balancer::baselines::tests::{division, new_nodes};

    #[test]
    fn work_follows_the_last_speed() {
        let mut naive = Naive::last();
        for (node, tiles, response_secs) in [(0, 10, 10.0), (0, 30, 0.3), (1, 20, 0.1)] {
            naive.learn(&RequestOutcome {
                node: NodeIndex(node),
                tiles,
                work: f64::from(tiles),
                response_secs,
                busy_secs: 0.0,
            });
        }
        let candidates = new_nodes::<3>();
        let Shares::Work(shares) = naive.divide(&division(450.0, 1.0, &candidates)) else {
            unreachable!("Naive names shares");
        };
        // Speeds 100 and 200 tiles a second, and their mean for the node that is new.
        for (share, expected) in shares.iter().zip([100.0, 200.0, 150.0]) {
            assert!((share - expected).abs() < 1e-9, "{shares:?}");
        }
    }
    #[test]
    fn a_frozen_mean_stays_and_a_running_one_follows() {
        let speed = |mut naive: Naive| {
            for run in 0..240 {
                let response_secs = if run < 60 { 1.0 } else { 0.1 };
                naive.learn(&RequestOutcome {
                    node: NodeIndex(0),
                    tiles: 10,
                    work: 10.0,
                    response_secs,
                    busy_secs: 0.0,
                });
            }
            naive.nodes[&NodeIndex(0)].mean
        };
        assert!((speed(Naive::frozen()) - 10.0).abs() < 1e-9);
        assert!((speed(Naive::mean()) - 77.5).abs() < 1e-9);
        assert!((speed(Naive::last()) - 100.0).abs() < 1e-9);
    }
}
