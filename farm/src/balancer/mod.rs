//! Balancers, which divide a frame's work among nodes: pure arithmetic, one algorithm per file.
//!
//! ```text
//! outcomes of runs ──learn──▶ Balancer ──divide──▶ work per node ──▶ contiguous runs of tiles
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
//! Work is a number: predicted pixel samples, so that a tile that is known to be dear may count
//! for more. Every algorithm learns from every run, whichever of them divides, so that a switch
//! takes effect with what is known already.

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
    /// Which node.
    pub node: NodeIndex,
    /// What has been learned of it; absent for a node that has not delivered yet.
    pub estimate: Option<Estimate>,
    /// Seconds that a request waits there for earlier ones.
    pub wait_secs: f64,
    /// The most work that the client has seen it deliver for one frame; 0 if none.
    pub proven_work: f64,
    /// See [`CostModel::unmonitored_work`].
    pub unmonitored_work: f64,
    /// See [`CostModel::margin_secs`].
    pub margin_secs: f64,
}

/// A frame to divide.
#[derive(Clone, Copy, Debug)]
pub struct Division<'a> {
    /// The frame's work.
    pub work: f64,
    /// The work of a tile, on average.
    pub tile_work: f64,
    /// Seconds between frames while several are in flight; infinite while they come one by one.
    pub period_secs: f64,
    /// Who may take part, at least one.
    pub candidates: &'a [Candidate],
}

/// How a run went, by the client's clock but for `busy_secs`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RequestOutcome {
    /// Who traced.
    pub node: NodeIndex,
    /// Tiles that came, of which there is at least one.
    pub tiles: u32,
    /// Their work.
    pub work: f64,
    /// Seconds from the request to the last of them: y.
    pub response_secs: f64,
    /// Seconds that the node says it worked for them, at most `response_secs`.
    pub busy_secs: f64,
}

/// How a frame is to be divided.
#[derive(Clone, Debug, PartialEq)]
pub enum Shares {
    /// The work of each candidate, in their order: nothing negative, and the sum is the frame's.
    /// Whole tiles are dealt as near to it as may be.
    Work(Vec<f64>),
    /// The vessel that each candidate is, in their order: whole tiles are dealt so that the last
    /// one is through as early as may be.
    ByCostModel(Vec<CostModel>),
    /// Candidates take tiles as they can: see [`Pull`].
    Pool,
}

/// An algorithm that divides frames: [`crate::Farm::set_balancer`] takes one of an application's own.
pub trait Balancer {
    /// Divides a frame.
    fn divide(&mut self, division: &Division<'_>) -> Shares;

    /// Takes note of a run, if the algorithm learns from them.
    fn learn(&mut self, _outcome: &RequestOutcome) {}
}

/// All algorithms, side by side.
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
    /// The one that `algorithm` names.
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

    /// Takes in the one that [`Algorithm::Own`] names.
    pub fn set_own(&mut self, balancer: Box<dyn Balancer + Send>) {
        self.own = own::OwnBalancer::new(balancer);
    }

    /// Lets all of them take note of a run.
    pub fn learn(&mut self, outcome: &RequestOutcome) {
        for algorithm in Algorithm::ALL {
            self.get_mut(algorithm).learn(outcome);
        }
        self.own.learn(outcome);
    }
}

/// `work` in proportion to `weights`; in equal parts if none is above 0.
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
