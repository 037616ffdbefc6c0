//! Test kit: farms on virtual time, emulated links, tracers of known output and a throttle, for tests
//! and benches.
//!
//! Never part of the product: `tests/tests/architecture.rs` checks that.

pub mod error;
pub mod link_emulator;
pub mod noise_tracer;
pub mod pattern_tracer;
pub mod random;
pub mod simulator;
pub mod throttle;
pub mod udp_proxy;

pub use error::Error;
