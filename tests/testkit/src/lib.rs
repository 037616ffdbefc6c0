//! What tests and benches share: farms on virtual time, networks as bad as asked for, tracers whose
//! output is known beforehand and a throttle for those that are real.
//!
//! Never part of the product: `tests/tests/architecture.rs` sees to it.

pub mod link_emulator;
pub mod noise_tracer;
pub mod pattern_tracer;
pub mod random;
pub mod simulator;
pub mod throttle;
pub mod udp_proxy;
