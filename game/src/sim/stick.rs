//! Tip against ball: an instantaneous blow at a point, with squirt from the end mass of the cue.
//!
//! Speed and spin: Alciatore, TP A-30 (elastic tip, no slip up to the miscue limit). Squirt, the
//! sideways deflection by the mass of the cue's end: TP A-31.

use glam::{DMat3, DVec3};

use super::{
    ball::BallBody,
    ball_ball::Twist,
    error::{Error, Result},
};

/// The player's blow to the cue ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stroke {
    /// Direction of the cue seen from above, in rad anticlockwise from +x.
    pub direction_rad: f64,
    /// Speed of the cue at the blow, in m/s: over 0, at most [`Stroke::SPEED_MAX_M_S`].
    pub speed_m_s: f64,
    /// Sideways offset of the tip in ball radii, positive to the right of the aim (right english).
    pub side: f64,
    /// Vertical offset of the tip in ball radii, positive above the centre (follow).
    pub vertical: f64,
    /// Elevation of the cue in rad, 0 to [`Stroke::ELEVATION_MAX_RAD`]. The ball stays on the
    /// cloth: the downward part of the blow is lost, so an elevated cue curves but does not jump.
    pub elevation_rad: f64,
}

impl Stroke {
    /// Half as fast again as the strongest measured break.
    pub const SPEED_MAX_M_S: f64 = 20.0;
    /// Beyond this distance from the centre, in radii, the tip slips off the ball.
    pub const OFFSET_MAX: f64 = 0.6;
    /// 85 degrees.
    pub const ELEVATION_MAX_RAD: f64 = 85.0 * std::f64::consts::PI / 180.0;

    /// A stroke through the centre of the ball.
    pub fn straight(direction_rad: f64, speed_m_s: f64) -> Self {
        Self {
            direction_rad,
            speed_m_s,
            side: 0.0,
            vertical: 0.0,
            elevation_rad: 0.0,
        }
    }

    /// # Errors
    /// [`Error::Stroke`] with a sentence, for numbers that are not finite or out of range.
    pub fn validate(&self) -> Result<()> {
        let reject = |message: String| Err(Error::Stroke(message));
        if !self.direction_rad.is_finite() {
            return reject(format!(
                "the direction {} is not an angle",
                self.direction_rad
            ));
        }
        if !(self.speed_m_s > 0.0 && self.speed_m_s <= Self::SPEED_MAX_M_S) {
            return reject(format!(
                "the cue's speed of {} m/s is not over 0 and up to {} m/s",
                self.speed_m_s,
                Self::SPEED_MAX_M_S
            ));
        }
        let offset = self.side.hypot(self.vertical);
        if offset.is_nan() || offset > Self::OFFSET_MAX {
            return reject(format!(
                "the tip is {offset} radii from the centre, where it slips off: up to {} holds",
                Self::OFFSET_MAX
            ));
        }
        if !(0.0..=Self::ELEVATION_MAX_RAD).contains(&self.elevation_rad) {
            return reject(format!(
                "the cue's elevation of {} rad is not from 0 to {:.4} rad",
                self.elevation_rad,
                Self::ELEVATION_MAX_RAD
            ));
        }
        Ok(())
    }
}

/// The cue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cue {
    /// Its mass in kg; default 0.567 (20 oz).
    pub mass_kg: f64,
    /// The part of its end that moves sideways with the tip, in kg: more gives more squirt.
    /// Default 0.0056699 (a thirtieth of the ball: 1.9 degrees at half a radius).
    pub end_mass_kg: f64,
}

impl Default for Cue {
    fn default() -> Self {
        Self {
            mass_kg: 0.567,
            end_mass_kg: 0.005_669_9,
        }
    }
}

impl Cue {
    /// Velocity and spin of a resting ball after a valid stroke.
    pub(crate) fn strike(&self, body: &BallBody, stroke: &Stroke) -> Twist {
        let (sin_aim, cos_aim) = stroke.direction_rad.sin_cos();
        let forward = DVec3::new(cos_aim, sin_aim, 0.0);
        let right = forward.cross(DVec3::Z);
        let (sin_elevation, cos_elevation) = stroke.elevation_rad.sin_cos();
        let axis = cos_elevation * forward - sin_elevation * DVec3::Z;
        let up = sin_elevation * forward + cos_elevation * DVec3::Z;

        let offset_squared = stroke.side * stroke.side + stroke.vertical * stroke.vertical;
        let depth = (1.0 - offset_squared).sqrt();
        let tip = stroke.side * right + stroke.vertical * up - depth * axis;
        let speed =
            2.0 * stroke.speed_m_s / (1.0 + body.mass_kg / self.mass_kg + 2.5 * offset_squared);
        let velocity = speed * cos_elevation * forward;
        Twist {
            velocity: DMat3::from_rotation_z(self.squirt_rad(body, stroke.side)) * velocity,
            spin: 2.5 * speed / body.radius_m * tip.cross(axis),
        }
    }

    /// Deflection of the ball from the aim in rad, anticlockwise: right english goes left.
    fn squirt_rad(&self, body: &BallBody, side: f64) -> f64 {
        let across = 1.0 - side * side;
        let mass_ratio = body.mass_kg / self.end_mass_kg;
        (2.5 * side * across.sqrt()).atan2(1.0 + mass_ratio + 2.5 * across)
    }
}
