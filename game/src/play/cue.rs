//! The cue in the player's hand, while aiming and through the stroke.

use glam::{DVec2, DVec3};

use super::aim::Aim;
use crate::scene::cue_stick::{CuePose, GAP_M};

/// How the cue is held while aiming and striking.
#[derive(Clone, Debug, PartialEq)]
pub struct CueView {
    /// Centre of the cue ball, metres.
    pub cue_ball: DVec3,
    /// Direction of the cue, radians from +x towards +y.
    pub bearing_rad: f64,
    /// The tip's place on the cue ball, in ball radii to the right and up.
    pub tip: DVec2,
    /// How far the butt is raised, radians.
    pub elevation_rad: f64,
    /// The power that is set, or that the hand has drawn, 0 to 1.
    pub power: f64,
    /// Whether a stroke is on.
    pub is_drawn: bool,
    /// From the cue ball to the tip, metres.
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

    /// The cue that was drawn, at `clock_secs` of a shot, negative before the blow; nothing once it
    /// is taken away.
    pub fn swung(self, clock_secs: f64) -> Option<Self> {
        // Faster and faster towards the ball, as a real stroke is.
        let s = (1.0 + clock_secs / SWING_SECS.start).clamp(0.0, 1.0);
        (clock_secs < FOLLOW_SECS).then_some(Self {
            gap_m: self.gap_m * (1.0 - s * s),
            ..self
        })
    }

    /// Where it is, for a cue ball of `radius_m`.
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

/// How far full power draws the cue back.
pub(super) const DRAW_M: f64 = 0.2;
/// From letting go to the blow. With a display's period of 17 ms it stays under the 100 ms within
/// which people take an answer for immediate (Miller, "Response Time in Man-Computer Conversational
/// Transactions", 1968).
pub(super) const SWING_SECS: std::ops::Range<f64> = 0.06..0.08;
/// The cue stays this long after the blow.
const FOLLOW_SECS: f64 = 0.35;
