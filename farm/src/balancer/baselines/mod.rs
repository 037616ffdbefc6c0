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
