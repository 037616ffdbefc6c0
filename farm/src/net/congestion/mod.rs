//! Congestion control of the connections that carry tiles.

mod delay_window;

pub use delay_window::DelayWindow;
pub(crate) use delay_window::{Config, known_bytes};
