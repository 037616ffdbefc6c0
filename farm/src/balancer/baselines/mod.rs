//! Baselines for [`super::WaterFilling`]: the algorithms of the 2016 distributed ray tracer, the rule of
//! Blender Cycles, and guided self-scheduling.

mod ab;
mod cycles;
mod equal;
mod naive;
mod pull;

pub use ab::Ab;
pub use cycles::Cycles;
pub use equal::Equal;
pub use naive::Naive;
pub use pull::Pull;

use super::{Division, Shares, in_proportion};

/// Lower limit of response times in seconds, about the resolution of the clock.
const RESPONSE_SECS_MIN: f64 = 1e-6;

/// The weight of each node; an unknown one counts as the mean of the known ones.
fn known_or_mean(weights: impl Iterator<Item = Option<f64>>) -> Vec<f64> {
    let weights: Vec<_> = weights.collect();
    let known: Vec<f64> = weights.iter().flatten().copied().collect();
    let mean = match known.len() {
        0 => 1.0,
        count => known.iter().sum::<f64>() / count as f64,
    };
    let weights = weights.into_iter();
    weights.map(|weight| weight.unwrap_or(mean)).collect()
}

/// Shares in proportion to the weights, but at least a tile each: a node without work would not be measured
/// again.
fn at_least_a_tile(division: &Division<'_>, weights: &[f64]) -> Shares {
    let mut shares = in_proportion(division.work, weights);
    for share in &mut shares {
        *share = share.max(division.tile_work);
    }
    Shares::Work(in_proportion(division.work, &shares))
}

#[cfg(test)]
mod tests {
    use crate::balancer::{Candidate, Division};
    use crate::node_status::NodeIndex;

    /// Nodes of which nothing is known yet.
    pub(super) fn new_nodes<const N: usize>() -> [Candidate; N] {
        std::array::from_fn(|node| Candidate {
            node: NodeIndex(node),
            estimate: None,
            wait_secs: 0.0,
            proven_work: 0.0,
            unmonitored_work: 0.0,
            margin_secs: 0.0,
        })
    }

    /// A frame of `work`; its period does not matter.
    pub(super) fn division(work: f64, tile_work: f64, candidates: &[Candidate]) -> Division<'_> {
        Division {
            work,
            tile_work,
            period_secs: f64::INFINITY,
            candidates,
        }
    }
}
