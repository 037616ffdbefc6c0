//! Where the cue points, and how fast it is at which power.

use glam::DVec2;

use crate::sim::Stroke;

/// The cue's speed at full power, m/s: a hard break.
pub const CUE_SPEED_M_S_MAX: f64 = 10.0;

/// Where the cue points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Direction of the cue, radians from +x towards +y.
    pub bearing_rad: f64,
    /// The tip's place on the cue ball, in ball radii to the right and up.
    pub tip: DVec2,
    /// How far the butt is raised, radians, 0 to [`Stroke::ELEVATION_MAX_RAD`].
    pub elevation_rad: f64,
}

impl Aim {
    /// A level cue through the middle of the ball, along +x.
    pub const LEVEL: Self = Self {
        bearing_rad: 0.0,
        tip: DVec2::ZERO,
        elevation_rad: 0.0,
    };

    /// The stroke with `power` from 0 to 1.
    pub fn stroke(&self, power: f64) -> Stroke {
        Stroke {
            direction_rad: self.bearing_rad,
            speed_m_s: cue_speed_m_s(power),
            side: self.tip.x,
            vertical: self.tip.y,
            elevation_rad: self.elevation_rad,
        }
    }

    /// Moves the tip by so many ball radii to the right and up.
    pub fn move_tip(&mut self, by: DVec2) {
        self.tip = (self.tip + by).clamp_length_max(TIP_RADII_MAX);
    }

    /// Raises the butt by so many radians.
    pub fn elevate(&mut self, by_rad: f64) {
        let raised = self.elevation_rad + by_rad;
        self.elevation_rad = raised.clamp(0.0, Stroke::ELEVATION_MAX_RAD);
    }

    /// Puts the tip in the middle and lays the cue level.
    pub fn level(&mut self) {
        *self = Self {
            bearing_rad: self.bearing_rad,
            ..Self::LEVEL
        };
    }
}

/// The cue's speed at `power` from 0 to 1: quadratic, so that soft shots have room.
pub fn cue_speed_m_s(power: f64) -> f64 {
    CUE_SPEED_M_S_MIN + (CUE_SPEED_M_S_MAX - CUE_SPEED_M_S_MIN) * power * power
}

const CUE_SPEED_M_S_MIN: f64 = 0.15;
/// The tip can be set beyond where it slips off the ball, about 0.51: that is the player's risk.
const TIP_RADII_MAX: f64 = 0.6;
