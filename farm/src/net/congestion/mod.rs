//! Congestion control of the connections that carry tiles: a delay-based window similar to FAST TCP, and
//! its adapter to quinn.

mod controller;
mod delay_based;
mod rtt;

pub(crate) use controller::{ControllerConfig, validated_bytes};
pub use delay_based::DelayBasedController;
