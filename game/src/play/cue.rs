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
    /// Power, 0 to 1, while the cue is drawn back.
    pub power: Option<f64>,
    /// From the cue ball to the tip, metres.
    pub gap_m: f64,
}

impl CueView {
    /// The cue at rest, or drawn back as far as `power` says.
    pub fn drawn(cue_ball: DVec3, aim: &Aim, power: Option<f64>) -> Self {
        Self {
            cue_ball,
            bearing_rad: aim.bearing_rad,
            tip: aim.tip,
            elevation_rad: aim.elevation_rad,
            power,
            gap_m: GAP_M + power.unwrap_or(0.0) * DRAW_M,
        }
    }

    /// The cue at `clock_secs` of a shot, negative before the blow; nothing once it is taken away.
    pub fn swung(cue_ball: DVec3, aim: &Aim, power: f64, clock_secs: f64) -> Option<Self> {
        let drawn = Self::drawn(cue_ball, aim, Some(power));
        // Faster and faster towards the ball, as a real stroke is.
        let s = (1.0 + clock_secs / SWING_SECS.start).clamp(0.0, 1.0);
        (clock_secs < FOLLOW_SECS).then_some(Self {
            gap_m: drawn.gap_m * (1.0 - s * s),
            ..drawn
        })
    }
}

/// From letting go to the blow. With a display's period of 17 ms it stays under the 100 ms within
/// which people take an answer for immediate (Miller, "Response Time in Man-Computer Conversational
/// Transactions", 1968).
pub(super) const SWING_SECS: std::ops::Range<f64> = 0.06..0.08;
/// The cue stays this long after the blow.
const FOLLOW_SECS: f64 = 0.35;
const GAP_M: f64 = 0.012;
const DRAW_M: f64 = 0.2;
