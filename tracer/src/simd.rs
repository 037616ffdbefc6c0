//! Instruction sets of processors, chosen at run time.

pub use fearless_simd::Level;
