//! Algorithms that [`super::WaterFilling`] is compared with: those of the 2016 distributed ray
//! tracer, the rule of Blender Cycles, and guided self-scheduling.

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

    /// A frame of so much work, whose time does not count.
    pub(super) fn division(work: f64, tile_work: f64, candidates: &[Candidate]) -> Division<'_> {
        Division {
            work,
            tile_work,
            period_secs: f64::INFINITY,
            candidates,
        }
    }
}
