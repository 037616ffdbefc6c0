//! Aim of the cue, and the mapping from power to speed.

use carom_billiards::physics::Stroke;
use glam::DVec2;

use crate::camera::wrap_rad;

/// Speed of the cue at full power, m/s: a hard break.
pub const CUE_SPEED_M_S_MAX: f64 = 10.0;

/// Direction of the cue, contact point, and power.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Direction of the cue, radians from +x towards +y.
    pub bearing_rad: f64,
    /// Contact point of the tip on the cue ball, in ball radii to the right and up.
    pub tip: DVec2,
    /// Elevation of the cue in radians, up to [`Stroke::ELEVATION_MAX_RAD`] and at least such
    /// that the cue passes over rails and balls.
    pub elevation_rad: f64,
    /// Power of the next stroke, 0 to 1, if the stroke itself does not determine it.
    pub power: f64,
    /// Elevation set by the player, radians.
    pub(super) wanted_rad: f64,
}

impl Aim {
    /// A level cue through the middle of the ball, along +x.
    pub const LEVEL: Self = Self {
        bearing_rad: 0.0,
        tip: DVec2::ZERO,
        elevation_rad: 0.0,
        power: 0.4,
        wanted_rad: 0.0,
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

    /// The aim of a stroke.
    pub fn of(stroke: &Stroke) -> Self {
        Self {
            bearing_rad: stroke.direction_rad,
            tip: DVec2::new(stroke.side, stroke.vertical),
            elevation_rad: stroke.elevation_rad,
            power: power_of_speed(stroke.speed_m_s),
            wanted_rad: stroke.elevation_rad,
        }
    }

    /// Turns the cue to the left by an angle.
    pub fn turn(&mut self, by_rad: f64) {
        self.bearing_rad = wrap_rad(self.bearing_rad + by_rad);
    }

    /// Sets the contact point, in ball radii to the right and up, at most `TIP_RADII_MAX` from the centre.
    pub fn set_tip(&mut self, tip: DVec2) {
        self.tip = tip.clamp_length_max(TIP_RADII_MAX);
    }

    /// Sets the power, clamped to 0..=1.
    pub fn set_power(&mut self, power: f64) {
        self.power = power.clamp(0.0, 1.0);
    }

    /// Raises the butt by an angle in radians from its present elevation.
    pub fn elevate(&mut self, by_rad: f64) {
        self.wanted_rad = (self.elevation_rad + by_rad).clamp(0.0, Stroke::ELEVATION_MAX_RAD);
    }

    /// Sets the contact point to the centre and the wanted elevation to 0.
    pub fn level(&mut self) {
        (self.tip, self.wanted_rad) = (DVec2::ZERO, 0.0);
    }
}

/// Speed of the cue at `power` from 0 to 1: quadratic, for finer control of soft shots.
pub fn cue_speed_m_s(power: f64) -> f64 {
    CUE_SPEED_M_S_MIN + (CUE_SPEED_M_S_MAX - CUE_SPEED_M_S_MIN) * power * power
}

/// Power of a speed of the cue: the inverse of [`cue_speed_m_s`], clamped to 0..=1.
pub fn power_of_speed(speed_m_s: f64) -> f64 {
    let share = (speed_m_s - CUE_SPEED_M_S_MIN) / (CUE_SPEED_M_S_MAX - CUE_SPEED_M_S_MIN);
    share.clamp(0.0, 1.0).sqrt()
}

const CUE_SPEED_M_S_MIN: f64 = 0.15;
/// Largest distance of the contact point from the centre, in ball radii. Beyond about 0.51 the tip slips
/// off the ball, which is the player's risk.
const TIP_RADII_MAX: f64 = 0.6;
