//! Position of the cue while aiming and during a stroke.

use glam::{DVec2, DVec3};

use super::aim::Aim;
use crate::scene::cue_stick::{CuePose, GAP_M};

/// State of the cue while aiming and striking.
#[derive(Clone, Debug, PartialEq)]
pub struct CueView {
    /// Centre of the cue ball, metres.
    pub cue_ball: DVec3,
    /// Horizontal direction of the cue, radians from +x towards +y.
    pub bearing_rad: f64,
    /// Contact point of the tip on the cue ball, in ball radii to the right and up.
    pub tip: DVec2,
    /// Elevation of the cue, radians.
    pub elevation_rad: f64,
    /// Power that is set, or of the stroke in progress, 0 to 1.
    pub power: f64,
    /// Whether a stroke is in progress.
    pub is_drawn: bool,
    /// Distance from the cue ball to the tip, metres.
    pub gap_m: f64,
}

impl CueView {
    /// The cue at rest.
    pub fn resting(cue_ball: DVec3, aim: &Aim) -> Self {
        Self {
            cue_ball,
            bearing_rad: aim.bearing_rad,
            tip: aim.tip,
            elevation_rad: aim.elevation_rad,
            power: aim.power,
            is_drawn: false,
            gap_m: GAP_M,
        }
    }

    /// The cue drawn back by `drawn_m` for a stroke of `power`.
    pub fn drawn(self, power: f64, drawn_m: f64) -> Self {
        Self {
            power,
            is_drawn: true,
            gap_m: GAP_M + drawn_m,
            ..self
        }
    }

    /// The drawn cue at `clock_secs` of a shot, negative before the contact; none once it is withdrawn.
    pub fn swung(self, clock_secs: f64) -> Option<Self> {
        // Uniform acceleration towards the ball.
        let s = (1.0 + clock_secs / SWING_SECS.start).clamp(0.0, 1.0);
        (clock_secs < FOLLOW_SECS).then_some(Self {
            gap_m: self.gap_m * (1.0 - s * s),
            ..self
        })
    }

    /// Position and direction of the cue, for a cue ball of `radius_m`.
    pub fn pose(&self, radius_m: f64) -> CuePose {
        let along = DVec2::from_angle(self.bearing_rad).extend(0.0);
        let across = DVec3::new(along.y, -along.x, 0.0);
        let (sin, cos) = self.elevation_rad.sin_cos();
        let back = DVec3::Z * sin - along * cos;
        let up = along * sin + DVec3::Z * cos;
        let depth = (1.0 - self.tip.length_squared()).max(0.0).sqrt();
        let offset = across * self.tip.x + up * self.tip.y + back * depth;
        CuePose {
            tip: self.cue_ball + offset * radius_m + back * self.gap_m,
            back,
        }
    }
}

/// Distance by which the cue is drawn back at full power.
pub(super) const DRAW_M: f64 = 0.2;
/// Range of the time from release to contact. With a display's period of 17 ms it stays below the 100 ms
/// within which a response is perceived as immediate (Miller, "Response Time in Man-Computer Conversational
/// Transactions", 1968).
pub(super) const SWING_SECS: std::ops::Range<f64> = 0.06..0.08;
/// Time for which the cue stays visible after the contact.
const FOLLOW_SECS: f64 = 0.35;
