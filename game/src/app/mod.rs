//! Application: window and event loop, the shell around the game, the session.

pub mod app_shell;
mod autosave;
mod event_loop;
mod frame;
#[cfg(feature = "gamepad")]
mod gamepads;
pub mod mode;
pub mod mode_controller;
mod pointer_travel;
pub mod session;
mod window;
mod window_events;

pub use event_loop::run;
