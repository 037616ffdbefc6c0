//! Benches of the cost of Carom's parts, and of their correctness.
//!
//! One module per bench, whose `--help` says what it measures; [`physics`] is public for the tests that
//! compare the simulation with its references.

mod assets;
mod balance;
mod bvh;
mod case_filter;
mod chart;
mod cli;
mod cluster;
mod codec;
mod error;
mod faults;
mod first_frames;
mod kernel_specialization;
mod latency;
mod latency_hiding;
pub mod mitsuba_scene;
mod motion;
mod node;
mod output;
mod overlay;
mod particles;
pub mod physics;
mod play;
mod proxy;
mod quality;
mod scenes;
mod served_node;
mod timing;
mod tradeoff_chart;
mod transport;
mod wait;

pub use cli::run;
pub(crate) use error::{BenchError, ValueError};
pub(crate) use output::{met, print_json};
