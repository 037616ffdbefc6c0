//! The same work for each node: the baseline of all comparisons.

use crate::balancer::{Balancer, Division, Shares};

/// See [`crate::Algorithm::Equal`].
#[derive(Debug, Default)]
pub struct Equal;

impl Balancer for Equal {
    fn divide(&mut self, division: &Division<'_>) -> Shares {
        let nodes = division.candidates.len();
        Shares::Work(vec![division.work / nodes as f64; nodes])
    }
}
