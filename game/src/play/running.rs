//! A shot that is on: its clock and its camera.

use crate::camera::{Orbit, Viewpoint, smoothstep};
use crate::sim::{Shot, Stroke};

use super::cue::CueView;

/// A shot that is on.
#[derive(Debug)]
pub(super) struct Running {
    /// What it was struck with.
    pub(super) stroke: Stroke,
    /// What happens.
    pub(super) shot: Shot,
    /// When the tip meets the ball.
    pub(super) contact_secs: f64,
    /// The cue as it was drawn back.
    pub(super) cue: Option<CueView>,
    /// The view at the stroke.
    pub(super) from: Viewpoint,
    /// The cue's direction.
    pub(super) bearing_rad: f64,
    /// Whether the camera cuts to the whole table instead of rising.
    pub(super) cuts: bool,
}

impl Running {
    /// The moment on show at `now_secs`, in seconds since the blow; negative before it.
    pub(super) fn clock_secs(&self, now_secs: f64) -> f64 {
        now_secs - self.contact_secs
    }

    /// From behind the cue ball up and back to the whole table, as a function of the shot's own
    /// time: pictures of the future know where the camera will be.
    pub(super) fn viewpoint(&self, moment_secs: f64, orbit: Orbit) -> Viewpoint {
        let s = (moment_secs - RISE_SECS.start) / (RISE_SECS.end - RISE_SECS.start);
        let s = if self.cuts { s.signum() } else { s };
        let s = smoothstep(s);
        let overview = Viewpoint::overview(self.bearing_rad + orbit.yaw_rad);
        self.from.lerp(overview, s)
    }
}

/// When the camera rises after the blow.
const RISE_SECS: std::ops::Range<f64> = 0.1..1.7;
