//! Balancers, which divide a frame's work among nodes: pure arithmetic, one algorithm per file.
//!
//! ```text
//! outcomes of requests ─learn─▶ Balancer ──divide──▶ work per node ──▶ contiguous runs of tiles
//! ```
//!
//! ```
//! use carom_farm::balancer::{Balancer, Division, RequestOutcome, Shares};
//!
//! /// The same work for each node.
//! struct Even;
//!
//! impl Balancer for Even {
//!     fn divide(&mut self, division: &Division<'_>) -> Shares {
//!         let nodes = division.candidates.len();
//!         Shares::Work(vec![division.work / nodes as f64; nodes])
//!     }
//! }
//!
//! # fn main() -> carom_farm::Result<()> {
//! # use carom_farm::{Farm, FarmConfig, LocalNode};
//! let mut farm = Farm::new(FarmConfig { local: LocalNode::Cpu, ..FarmConfig::default() })?;
//! farm.set_balancer(Even);
//! # Ok(())
//! # }
//! ```
//!
//! Work is measured in predicted pixel samples of average cost, so that an expensive tile counts for more.
//! Every algorithm learns from every request, whichever of them divides, so that a switch takes effect with
//! what is already known.

mod baselines;
mod estimator;
mod own;
mod water_filling;

pub use baselines::{Ab, Cycles, Equal, Naive, Pull};
pub use estimator::{Estimate, EstimateError, Estimator, Observation};
pub use own::ShareFault;
pub use water_filling::{Allocation, CostModel, WaterFilling, water_fill};

use crate::balancing::Algorithm;
use crate::node_status::NodeIndex;

/// A node that can take part in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Index of the node.
    pub node: NodeIndex,
    /// Learned cost; absent for a node that has not delivered yet.
    pub estimate: Option<Estimate>,
    /// Seconds that a request waits there behind earlier ones.
    pub wait_secs: f64,
    /// Maximum work that it has delivered for one frame, as seen by the client; 0 if none.
    pub proven_work: f64,
    /// See [`CostModel::unmonitored_work`].
    pub unmonitored_work: f64,
    /// See [`CostModel::margin_secs`].
    pub margin_secs: f64,
}

/// A frame to divide.
#[derive(Clone, Copy, Debug)]
pub struct Division<'a> {
    /// Work of the whole frame.
    pub work: f64,
    /// Mean work of a tile.
    pub tile_work: f64,
    /// Seconds between frames while several are in flight; infinite while they do not overlap.
    pub period_secs: f64,
    /// Nodes that may take part, at least one.
    pub candidates: &'a [Candidate],
}

/// Outcome of a request, timed by the client's clock except for `busy_secs`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RequestOutcome {
    /// Node that traced it.
    pub node: NodeIndex,
    /// Number of tiles that arrived, at least 1.
    pub tiles: u32,
    /// Work of these tiles.
    pub work: f64,
    /// y: seconds from the request to the last tile.
    pub response_secs: f64,
    /// Seconds that the node reports to have been busy, at most `response_secs`.
    pub busy_secs: f64,
}

/// Division of a frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Shares {
    /// Work of each candidate, in their order: non-negative, with the frame's work as the sum. It is
    /// approximated with whole tiles.
    Work(Vec<f64>),
    /// Cost model of each candidate, in their order: whole tiles are assigned so that the last finishes as
    /// early as possible.
    ByCostModel(Vec<CostModel>),
    /// Candidates pull tiles from a pool: see [`Pull`].
    Pool,
}

/// Algorithm that divides frames. [`crate::Farm::set_balancer`] takes an application's own.
pub trait Balancer {
    /// Divides a frame.
    fn divide(&mut self, division: &Division<'_>) -> Shares;

    /// Learns from a request's outcome; by default nothing.
    fn learn(&mut self, _outcome: &RequestOutcome) {}
}

/// All algorithms, each with its own state.
#[derive(Debug)]
pub struct Balancers {
    equal: Equal,
    naive: [Naive; 3],
    ab: [Ab; 2],
    cycles: Cycles,
    pull: Pull,
    water_filling: WaterFilling,
    own: own::OwnBalancer,
}

impl Default for Balancers {
    fn default() -> Self {
        Self {
            equal: Equal,
            naive: [Naive::last(), Naive::mean(), Naive::frozen()],
            ab: [Ab::averages(), Ab::exponential()],
            cycles: Cycles::default(),
            pull: Pull,
            water_filling: WaterFilling,
            own: own::OwnBalancer::default(),
        }
    }
}

impl Balancers {
    /// The balancer of `algorithm`.
    pub fn get_mut(&mut self, algorithm: Algorithm) -> &mut dyn Balancer {
        match algorithm {
            Algorithm::Equal => &mut self.equal,
            Algorithm::Naive => &mut self.naive[0],
            Algorithm::NaiveMean => &mut self.naive[1],
            Algorithm::NaiveFrozen => &mut self.naive[2],
            Algorithm::Ab => &mut self.ab[0],
            Algorithm::AbExponential => &mut self.ab[1],
            Algorithm::Cycles => &mut self.cycles,
            Algorithm::Pull => &mut self.pull,
            Algorithm::WaterFilling => &mut self.water_filling,
            Algorithm::Own => &mut self.own,
        }
    }

    /// Sets the balancer of [`Algorithm::Own`].
    pub fn set_own(&mut self, balancer: Box<dyn Balancer + Send>) {
        self.own = own::OwnBalancer::new(balancer);
    }

    /// Lets all of them learn from a request's outcome.
    pub fn learn(&mut self, outcome: &RequestOutcome) {
        for algorithm in Algorithm::ALL {
            self.get_mut(algorithm).learn(outcome);
        }
        self.own.learn(outcome);
    }
}

/// Divides `work` in proportion to `weights`; into equal parts if their sum is not positive and finite.
fn in_proportion(work: f64, weights: &[f64]) -> Vec<f64> {
    let sum: f64 = weights.iter().sum();
    if sum > 0.0 && sum.is_finite() {
        weights.iter().map(|weight| work * weight / sum).collect()
    } else {
        vec![work / weights.len() as f64; weights.len()]
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn candidates() -> impl Strategy<Value = Vec<Candidate>> {
        let estimate = proptest::option::of((0.0..0.1f64, 1e-9..1e-2f64));
        prop::collection::vec((estimate, 0.0..0.5f64, 0.0..1e6f64), 1..20).prop_map(|nodes| {
            let candidate = |(index, (estimate, wait_secs, proven_work))| Candidate {
                node: NodeIndex(index),
                estimate: Option::map(estimate, |(fixed_secs, secs_per_work)| Estimate {
                    fixed_secs,
                    secs_per_work,
                }),
                wait_secs,
                proven_work,
                unmonitored_work: 0.0,
                margin_secs: 0.0,
            };
            nodes.into_iter().enumerate().map(candidate).collect()
        })
    }

    proptest! {
        #[test]
        fn shares_are_finite_and_make_up_the_frame(
            candidates in candidates(),
            work in 1.0..1e8f64,
            period_secs in prop_oneof![Just(f64::INFINITY), 1e-3..1.0f64],
            outcomes in prop::collection::vec((0..20usize, 1..100u32, 0.0..2.0f64, 0.0..1.0f64), 0..40),
            warm_up in 0..70,
        ) {
            let mut balancers = Balancers::default();
            for (node, tiles, response_secs, busy_share) in outcomes {
                balancers.learn(&RequestOutcome {
                    node: NodeIndex(node),
                    tiles,
                    work: f64::from(tiles) * 1024.0,
                    response_secs,
                    busy_secs: busy_share * response_secs,
                });
            }
            let tile_work = work / 100.0;
            let candidates = &candidates[..];
            let division = Division { work, tile_work, period_secs, candidates };
            for algorithm in Algorithm::ALL {
                for _ in 0..warm_up {
                    balancers.get_mut(algorithm).divide(&division);
                }
                let shares = match balancers.get_mut(algorithm).divide(&division) {
                    Shares::Work(shares) => shares,
                    Shares::ByCostModel(models) => water_fill(work, &models).shares,
                    Shares::Pool => continue,
                };
                prop_assert_eq!(shares.len(), candidates.len());
                prop_assert!(shares.iter().all(|x| x.is_finite() && *x >= 0.0), "{:?}", shares);
                let sum: f64 = shares.iter().sum();
                prop_assert!((sum - work).abs() <= 1e-9 * work, "{algorithm:?}: {sum} of {work}");
            }
        }
    }
}
