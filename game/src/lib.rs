//! Carom: a pool game whose every frame is path-traced by a [`carom_farm::Farm`].
//!
//! ```text
//! app (winit) ─▶ app_shell (settings, pages, keys, sound)
//!                  │ intents
//!                  ▼
//!                session ─▶ play (aim, stroke, shot) ─▶ sim (physics)
//!                           │ poses, camera
//!                           ▼
//!                         scene ─▶ frame::scheduler ─▶ Farm ─▶ scheduler ─▶ display ─▶ window
//!                                  what to ask                 what to show   ▲
//!                                                              ui ────────────┘
//! ```
//!
//! Only [`app`] and [`display`] know winit and wgpu; everything else takes time and events as
//! arguments. [`capture`] renders shots to files through the same farm.

pub mod app;
pub mod args;
pub mod audio;
pub mod camera;
pub mod capture;
pub mod display;
pub mod frame;
pub mod input;
pub mod play;
pub mod scene;
pub mod settings;
pub mod ui;
