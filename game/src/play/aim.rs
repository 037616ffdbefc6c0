//! The aim of the cue, and its speed at each power.

use carom_billiards::physics::Stroke;
use glam::DVec2;

use crate::camera::wrap_rad;

/// The cue's speed at full power, m/s: a hard break.
pub const CUE_SPEED_M_S_MAX: f64 = 10.0;

/// Where the cue points, and the power that is set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aim {
    /// Direction of the cue, radians from +x towards +y.
    pub bearing_rad: f64,
    /// The tip's place on the cue ball, in ball radii to the right and up.
    pub tip: DVec2,
    /// How far the butt is raised, radians, up to [`Stroke::ELEVATION_MAX_RAD`]: at least so far
    /// that the cue passes over rails and balls.
    pub elevation_rad: f64,
    /// The power of the next stroke, 0 to 1, unless the hand says otherwise.
    pub power: f64,
    /// How far the player wants the butt raised, radians.
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

    /// Turns the cue to the left.
    pub fn turn(&mut self, by_rad: f64) {
        self.bearing_rad = wrap_rad(self.bearing_rad + by_rad);
    }

    /// Sets the tip, in ball radii to the right and up.
    pub fn set_tip(&mut self, tip: DVec2) {
        self.tip = tip.clamp_length_max(TIP_RADII_MAX);
    }

    /// Sets the power; below 0 and above 1 as those.
    pub fn set_power(&mut self, power: f64) {
        self.power = power.clamp(0.0, 1.0);
    }

    /// Raises the butt by so many radians, from where it is.
    pub fn elevate(&mut self, by_rad: f64) {
        self.wanted_rad = (self.elevation_rad + by_rad).clamp(0.0, Stroke::ELEVATION_MAX_RAD);
    }

    /// Puts the tip in the middle and lays the cue as level as it can lie.
    pub fn level(&mut self) {
        (self.tip, self.wanted_rad) = (DVec2::ZERO, 0.0);
    }
}

/// The cue's speed at `power` from 0 to 1: quadratic, so that soft shots have room.
pub fn cue_speed_m_s(power: f64) -> f64 {
    CUE_SPEED_M_S_MIN + (CUE_SPEED_M_S_MAX - CUE_SPEED_M_S_MIN) * power * power
}

/// The power of a cue of that speed: the inverse of [`cue_speed_m_s`], within 0 to 1.
pub fn power_of_speed(speed_m_s: f64) -> f64 {
    let share = (speed_m_s - CUE_SPEED_M_S_MIN) / (CUE_SPEED_M_S_MAX - CUE_SPEED_M_S_MIN);
    share.clamp(0.0, 1.0).sqrt()
}

const CUE_SPEED_M_S_MIN: f64 = 0.15;
/// The tip can be set beyond where it slips off the ball, about 0.51: that is the player's risk.
const TIP_RADII_MAX: f64 = 0.6;
