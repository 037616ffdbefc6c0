//! Viewer of scenes: a window with a live picture of a [`carom_farm::Farm`].
//!
//! ```text
//! app (winit) ─▶ viewer: camera, lights, exposure, panels ──Wanted──▶ render (a thread) ─▶ Farm
//!      ▲                     │                           ◀───News───
//!      └──── carom-window ◀──┘
//! ```
//!
//! ```
//! use carom_tracer::Camera;
//! use carom_view::camera::OrbitCamera;
//!
//! let home = Camera::looking_at([0.0, -4.0, 1.0], [0.0; 3]);
//! let mut camera = OrbitCamera::new(home);
//! camera.turn(0.5, 0.1);
//! camera.zoom(0.8);
//! assert_eq!(camera.camera().target, home.target);
//! ```
//!
//! The window never blocks: [`render`] owns the farm, and accesses files, on threads of its own. [`camera`]
//! is pure geometry, and [`viewer`] is independent of a window, so that tests can drive both.

pub mod app;
pub mod args;
pub mod camera;
pub mod controls;
mod file_camera;
pub mod lights;
mod playback;
pub mod render;
mod save_form;
mod saving;
mod ui;
pub mod viewer;
