//! Cameras of the game, and the projection of the table's points to the window.
//!
//! ```text
//! ViewSelection (the player's choice) ─▶ Viewpoint ─▶ Camera
//!        ▲ FollowCamera (a moving ball)
//! ```

mod follow_camera;
mod framing;
mod projection;
mod view_selection;
mod viewpoint;

pub use follow_camera::FollowCamera;
pub use framing::Framing;
pub use projection::Projection;
pub use view_selection::{CameraIntent, CameraView, SAVED_MAX, ViewContext, ViewSelection};
pub use viewpoint::{APERTURE_RADIUS_M, EYE_Z_M_MAX, EYE_Z_M_MIN, Orbit, Viewpoint};

/// An angle wrapped to −π..π.
pub fn wrap_rad(angle_rad: f64) -> f64 {
    let turns = (angle_rad / std::f64::consts::TAU).round();
    angle_rad - turns * std::f64::consts::TAU
}

/// Cubic Hermite interpolation from 0 to 1 with zero slope at both ends; `s` is clamped to 0..=1.
pub fn smoothstep(s: f64) -> f64 {
    let s = s.clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}
