//! The cue as it is drawn over the picture, while aiming and through the stroke.

use glam::{DVec2, DVec3};

use super::aim::Aim;

/// What is drawn over the picture while aiming and striking.
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
}

/// The cue's radius at a way from its tip, in m.
pub fn cue_radius_m(from_tip_m: f64) -> f64 {
    TIP_RADIUS_M + (BUTT_RADIUS_M - TIP_RADIUS_M) * (from_tip_m / CUE_LENGTH_M).min(1.0)
}

/// 58 inches.
pub const CUE_LENGTH_M: f64 = 1.47;
const TIP_RADIUS_M: f64 = 0.0063;
const BUTT_RADIUS_M: f64 = 0.0145;
/// How far full power draws the cue back.
pub(super) const DRAW_M: f64 = 0.2;
/// From letting go to the blow. With a display's period of 17 ms it stays under the 100 ms within
/// which people take an answer for immediate (Miller, "Response Time in Man-Computer Conversational
/// Transactions", 1968).
pub(super) const SWING_SECS: std::ops::Range<f64> = 0.06..0.08;
/// The cue stays this long after the blow.
const FOLLOW_SECS: f64 = 0.35;
const GAP_M: f64 = 0.012;
