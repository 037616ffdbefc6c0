//! Carom: a pool game whose every frame is path-traced by a [`carom_farm::Farm`].
//!
//! ```text
//! app (winit) ─▶ desk (settings, pages, keys, sound)
//!                  │ intents
//!                  ▼
//!                session ─▶ play (aim, stroke, shot) ─▶ sim (physics)
//!                           │ poses, camera
//!                           ▼
//!                         stage ─▶ director ─▶ Farm ─▶ director ─▶ display ─▶ window
//!                                  what to ask         what to show   ▲
//!                                                              ui ────┘
//! ```
//!
//! Only [`app`] and [`display`] know winit and wgpu; everything else takes time and events as
//! arguments. [`headless`] renders a shot to files through the same farm, [`video`] makes films of them.

pub mod ai;
pub mod app;
pub mod args;
pub mod ball_set;
pub mod bench;
pub mod booth;
pub mod camera;
pub mod contest;
pub mod darkroom;
pub mod desk;
pub mod director;
pub mod display;
pub mod headless;
pub mod input;
pub mod lookout;
pub mod play;
pub mod practice;
pub mod quality;
pub mod replay;
pub mod room;
pub mod rules;
pub mod screenshot;
pub mod session;
pub mod settings;
pub mod sim;
pub mod sound;
pub mod stage;
pub mod ui;
pub mod video;
pub mod warp;
