//! Adapter for an application's own balancer: checks its shares, and divides equally where they are
//! invalid.

use std::fmt;

use super::{Balancer, Division, Equal, RequestOutcome, Shares};

/// Fault in the shares of a balancer.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ShareFault {
    /// The numbers of shares and candidates differ.
    #[error("it returned {shares} shares for {candidates} candidates")]
    Count {
        /// Number of shares.
        shares: usize,
        /// Number of candidates.
        candidates: usize,
    },
    /// A share is negative, infinite or NaN.
    #[error("the share of candidate {candidate} is {work}: it must be a finite number from 0 up")]
    Share {
        /// Index of the candidate.
        candidate: usize,
        /// Its work; for a cost model, its seconds for one unit of work.
        work: f64,
    },
    /// The shares do not add up to the frame's work.
    #[error("the shares add up to {sum}, and the frame's work is {work}")]
    Sum {
        /// Sum of the shares.
        sum: f64,
        /// Work of the frame.
        work: f64,
    },
}

/// Adapter of the [module](self).
#[derive(Default)]
pub(super) struct OwnBalancer {
    balancer: Option<Box<dyn Balancer + Send>>,
    /// Whether a fault has been logged.
    reported: bool,
}

impl OwnBalancer {
    pub(super) fn new(balancer: Box<dyn Balancer + Send>) -> Self {
        Self {
            balancer: Some(balancer),
            reported: false,
        }
    }
}

impl fmt::Debug for OwnBalancer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("OwnBalancer").finish_non_exhaustive()
    }
}

impl Balancer for OwnBalancer {
    fn divide(&mut self, division: &Division<'_>) -> Shares {
        let Some(balancer) = &mut self.balancer else {
            return Equal.divide(division);
        };
        let shares = balancer.divide(division);
        let Err(fault) = check(division, &shares) else {
            return shares;
        };
        if !self.reported {
            tracing::error!("the balancer: {fault}; all nodes get the same instead");
            self.reported = true;
        }
        Equal.divide(division)
    }

    fn learn(&mut self, outcome: &RequestOutcome) {
        if let Some(balancer) = &mut self.balancer {
            balancer.learn(outcome);
        }
    }
}

fn check(division: &Division<'_>, shares: &Shares) -> Result<(), ShareFault> {
    let values: Vec<f64> = match shares {
        Shares::Pool => return Ok(()),
        Shares::Work(shares) => shares.clone(),
        Shares::ByCostModel(models) => {
            let costs = models
                .iter()
                .map(|model| model.fixed_secs + model.secs_per_work);
            costs.collect()
        }
    };
    let candidates = division.candidates.len();
    if values.len() != candidates {
        let shares = values.len();
        return Err(ShareFault::Count { shares, candidates });
    }
    let is_wrong = |value: &f64| !(*value >= 0.0 && value.is_finite());
    if let Some(candidate) = values.iter().position(is_wrong) {
        let work = values[candidate];
        return Err(ShareFault::Share { candidate, work });
    }
    let (sum, work) = (values.iter().sum::<f64>(), division.work);
    if matches!(shares, Shares::Work(_)) && (sum - work).abs() > SUM_ERROR_MAX * work {
        return Err(ShareFault::Sum { sum, work });
    }
    Ok(())
}

/// Relative tolerance for the sum of the shares.
const SUM_ERROR_MAX: f64 = 1e-6;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::balancer::Candidate;
    use crate::node_status::NodeIndex;

    struct Fixed(Vec<f64>);

    impl Balancer for Fixed {
        fn divide(&mut self, _division: &Division<'_>) -> Shares {
            Shares::Work(self.0.clone())
        }
    }

    fn divide(shares: &[f64]) -> Shares {
        let candidates = [0, 1].map(|index| Candidate {
            node: NodeIndex(index),
            estimate: None,
            wait_secs: 0.0,
            proven_work: 0.0,
            unmonitored_work: 0.0,
            margin_secs: 0.0,
        });
        OwnBalancer::new(Box::new(Fixed(shares.to_vec()))).divide(&Division {
            work: 10.0,
            tile_work: 1.0,
            period_secs: f64::INFINITY,
            candidates: &candidates,
        })
    }

    #[test]
    fn shares_that_make_up_the_frame_are_taken() {
        assert_eq!(divide(&[9.0, 1.0]), Shares::Work(vec![9.0, 1.0]));
    }

    #[test]
    fn shares_that_make_no_sense_become_equal_ones() {
        let equal = Shares::Work(vec![5.0, 5.0]);
        for wrong in [
            &[10.0][..],
            &[4.0, 4.0],
            &[11.0, -1.0],
            &[f64::NAN, 5.0],
            &[f64::INFINITY, 0.0],
        ] {
            assert_eq!(divide(wrong), equal, "{wrong:?}");
        }
    }
}
