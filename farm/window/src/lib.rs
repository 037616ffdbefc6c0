//! Window for pictures of a [`carom_farm::Farm`], shared by the applications that show them.
//!
//! ```text
//! picture ─▶ display ─▶ window (Vulkan, OpenGL or the processor)
//! egui ──────────┘▲
//! Farm ─▶ stats ──┘ panels over the picture, in the look of theme
//! ```
//!
//! ```
//! use carom_window::stats::{Stats, StatsLevel};
//!
//! let mut stats = Stats::new(std::env::temp_dir());
//! stats.set_level(StatsLevel::Line);
//! // With each picture of the farm `stats.take(…)`, in each frame of the window `stats.draw(…)`.
//! assert!(stats.is_shown());
//! ```
//!
//! [`connection`] and [`screen`] open the window; only [`display`] knows wgpu and softbuffer.

pub mod args;
pub mod connection;
pub mod display;
pub mod input_batches;
pub mod notifications;
pub mod screen;
mod speed_history;
pub mod stats;
pub mod theme;
pub mod toasts;
