//! The application: window and event loop, the shell around the game, the session.

pub mod app_shell;
mod event_loop;
pub mod farm_notifications;
pub mod screen_mode;
pub mod session;

pub use event_loop::run;
