//! The same work for each node: what balancing is measured against.

use super::{Balancer, Division, Outcome};

/// See [`crate::Algorithm::Equal`].
#[derive(Debug, Default)]
pub struct Equal;

impl Balancer for Equal {
    fn divide(&mut self, division: &Division<'_>) -> Vec<f64> {
        let nodes = division.candidates.len();
        vec![division.work / nodes as f64; nodes]
    }

    fn learn(&mut self, _outcome: &Outcome) {}
}
