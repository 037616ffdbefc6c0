//! Carom: a pool game whose every frame is path-traced by a [`carom_farm::Farm`].
//!
//! ```text
//! app::event_loop (winit) ─▶ app::frame: the steps of a frame, in their order
//!   input ─▶ app_shell (settings, pages, sound) ─▶ session ─▶ play ─▶ carom-billiards
//!   mode (game, replay, practice) ─▶ camera, poses ─▶ scene ─▶ frame::scheduler ─▶ Farm
//!   Farm ─▶ frame::pipeline (accumulate, choose, reproject) ─▶ ui on top ─▶ display ─▶ window
//! ```
//!
//! Only [`app`] uses winit; everything else takes time and events as arguments. [`capture`] renders shots
//! to files through the same farm.

pub mod app;
pub mod args;
pub mod audio;
pub mod camera;
pub mod capture;
mod error;
pub mod frame;
pub mod input;
pub mod output_file;
pub mod particles;
pub mod play;
pub mod scene;
pub mod settings;
pub mod ui;

pub use error::{Error, KeysFault, PracticeFault, Result, SettingFault};
