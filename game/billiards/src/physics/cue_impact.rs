//! Impact of the cue's tip on the ball: an instantaneous impulse at a point, with squirt from the end
//! mass of the cue.
//!
//! Speed and spin: Alciatore, TP A-30 (elastic tip, no slip up to the miscue limit). Squirt, the
//! sideways deflection by the mass of the cue's end: TP A-31. Beyond the limit, where the impulse would
//! leave the friction cone about the normal, the tip slips off: the impulse stays on the cone's edge
//! and shrinks with the cosine between cue and inward normal, to zero at the rim.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::{Result, StrokeFault};

use super::{ball::BallBody, ball_ball::Twist};
use crate::deterministic_math::{atan2, hypot, sin_cos, turned};

/// The player's stroke on the cue ball.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stroke {
    /// Direction of the cue seen from above, in rad anticlockwise from +x.
    pub direction_rad: f64,
    /// Speed of the cue at the impact, in m/s: over 0, at most [`Stroke::SPEED_MAX_M_S`].
    pub speed_m_s: f64,
    /// Sideways offset of the tip in ball radii, positive to the right of the aim (right english).
    pub side: f64,
    /// Vertical offset of the tip in ball radii, positive above the centre (follow).
    pub vertical: f64,
    /// Elevation of the cue in rad, 0 to [`Stroke::ELEVATION_MAX_RAD`]. The downward part of the
    /// impulse drives the ball into the slate, off which it jumps; with side it curves (massé).
    pub elevation_rad: f64,
}

impl Stroke {
    /// Highest speed of the cue in m/s: 1.5 times that of the strongest measured break.
    pub const SPEED_MAX_M_S: f64 = 20.0;
    /// Largest offset from the centre, in ball radii, at which a stroke can be aimed. The tip slips off
    /// earlier: beyond [`Cue::miscue_offset`].
    pub const OFFSET_MAX: f64 = 0.9;
    /// Largest elevation in rad: 85 degrees.
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

    /// Distance of the tip from the ball's centre perpendicular to the cue, in ball radii.
    pub fn offset(&self) -> f64 {
        hypot(self.side, self.vertical)
    }

    /// Checks that all values are finite and in range.
    ///
    /// # Errors
    /// [`crate::Error::Stroke`] for numbers that are not finite or out of range.
    pub fn validate(&self) -> Result<()> {
        let offset = self.offset();
        let fault = if !self.direction_rad.is_finite() {
            StrokeFault::Direction(self.direction_rad)
        } else if !(self.speed_m_s > 0.0 && self.speed_m_s <= Self::SPEED_MAX_M_S) {
            StrokeFault::Speed {
                speed_m_s: self.speed_m_s,
                max_m_s: Self::SPEED_MAX_M_S,
            }
        } else if offset.is_nan() || offset > Self::OFFSET_MAX {
            StrokeFault::Offset {
                offset,
                max: Self::OFFSET_MAX,
            }
        } else if !(0.0..=Self::ELEVATION_MAX_RAD).contains(&self.elevation_rad) {
            StrokeFault::Elevation {
                elevation_rad: self.elevation_rad,
                max_rad: Self::ELEVATION_MAX_RAD,
            }
        } else {
            return Ok(());
        };
        Err(fault.into())
    }
}

/// The cue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cue {
    /// Mass in kg; default 0.567 (20 oz).
    pub mass_kg: f64,
    /// Effective mass in kg of the cue's end, which moves sideways with the tip: more gives more
    /// squirt. Default 0.0056699 (a thirtieth of the ball: 1.9 degrees at an offset of half a radius).
    pub end_mass_kg: f64,
    /// Friction coefficient of chalked tip and ball; default 0.6 (Alciatore, "Physical properties").
    pub tip_friction: f64,
}

impl Default for Cue {
    fn default() -> Self {
        Self {
            mass_kg: 0.567,
            end_mass_kg: 0.005_669_9,
            tip_friction: 0.6,
        }
    }
}

impl Cue {
    /// The offset in ball radii beyond which the tip slips: sin(atan μ), 0.51 for 0.6.
    pub fn miscue_offset(&self) -> f64 {
        self.tip_friction / hypot(self.tip_friction, 1.0)
    }

    /// Velocity and spin of a ball at rest after a valid stroke, before the reaction of the slate.
    pub(crate) fn strike(&self, body: &BallBody, stroke: &Stroke) -> Twist {
        let (sin_aim, cos_aim) = sin_cos(stroke.direction_rad);
        let forward = DVec3::new(cos_aim, sin_aim, 0.0);
        let right = forward.cross(DVec3::Z);
        let (sin_elevation, cos_elevation) = sin_cos(stroke.elevation_rad);
        let axis = cos_elevation * forward - sin_elevation * DVec3::Z;
        let up = sin_elevation * forward + cos_elevation * DVec3::Z;

        let offset = stroke.offset();
        // Offsets are at most 0.9 radii, where the tip still meets the ball.
        let depth = (1.0 - offset * offset).sqrt();
        let tip = stroke.side * right + stroke.vertical * up - depth * axis;
        let CueImpact {
            along,
            arm,
            strength,
        } = self.impact(axis, tip, offset);
        let reach = along.dot(axis);
        // TP A-30: an elastic collision of the cue with the ball, whose inverse effective mass at an
        // arm of b radii is (1 + 5/2 b²)/m (I = 2/5 m R²). Only the impulse component along the cue
        // slows the cue.
        let speed = 2.0 * strength * reach * stroke.speed_m_s
            / (1.0 + reach * reach * body.mass_kg / self.mass_kg + 2.5 * arm * arm);
        Twist {
            velocity: turned(speed * along, self.squirt_rad(body, stroke.side)),
            spin: 2.5 * speed / body.radius_m * tip.cross(along),
        }
    }

    fn impact(&self, axis: DVec3, tip: DVec3, offset: f64) -> CueImpact {
        let limit = self.miscue_offset();
        if offset <= limit {
            return CueImpact {
                along: axis,
                arm: offset,
                strength: 1.0,
            };
        }
        let inward = -tip;
        let squarely = axis.dot(inward);
        // On the cone's edge in the plane of the cue's axis and the normal.
        let across = (axis - squarely * inward).normalize_or_zero();
        // `limit` is sin(atan μ): `cos_limit` and `limit` are cosine and sine of the cone's half angle.
        let cos_limit = (1.0 - limit * limit).sqrt();
        CueImpact {
            along: cos_limit * inward + limit * across,
            arm: limit,
            strength: squarely / cos_limit,
        }
    }

    /// Deflection of the ball from the aim in rad, anticlockwise: right english goes left.
    fn squirt_rad(&self, body: &BallBody, side: f64) -> f64 {
        let across = 1.0 - side * side;
        let mass_ratio = body.mass_kg / self.end_mass_kg;
        // TP A-31: only the end mass is carried sideways by the turning ball.
        atan2(2.5 * side * across.sqrt(), 1.0 + mass_ratio + 2.5 * across)
    }
}

/// Impulse of the tip on a ball of radius 1.
struct CueImpact {
    /// Unit vector of the impulse.
    along: DVec3,
    /// Lever arm: distance of the impulse's line from the centre, in ball radii.
    arm: f64,
    /// Ratio of the impulse to that of an elastic impact.
    strength: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn struck(side: f64, vertical: f64) -> Twist {
        let stroke = Stroke {
            side,
            vertical,
            ..Stroke::straight(0.0, 3.0)
        };
        Cue::default().strike(&BallBody::default(), &stroke)
    }

    #[test]
    fn a_miscue_begins_gradually_and_takes_speed_and_spin() {
        let limit = Cue::default().miscue_offset();
        assert!((limit - 0.5145).abs() < 1e-4);
        let (held, slipped) = (struck(limit, 0.0), struck(limit + 1e-9, 0.0));
        assert!((held.velocity - slipped.velocity).length() < 1e-7);
        assert!((held.spin - slipped.spin).length() < 1e-5);
        let bad = struck(0.8, 0.0);
        assert!(bad.velocity.length() < 0.9 * held.velocity.length());
        assert!(bad.spin.length() < held.spin.length());
        assert!(
            bad.velocity.y > 0.3,
            "a ball struck on its right goes left: {bad:?}"
        );
    }

    #[test]
    fn a_scoop_lifts_the_ball() {
        assert_eq!(struck(0.0, -0.5).velocity.z, 0.0);
        assert!(struck(0.0, -0.7).velocity.z > 0.5);
    }

    #[test]
    fn no_stroke_gives_more_energy_than_the_cue_has() {
        let (cue, body) = (Cue::default(), BallBody::default());
        for step in 0..90 {
            let Twist { velocity, spin } = struck(0.006 * f64::from(step), 0.008 * f64::from(step));
            let energy = body.kinetic_energy_j(velocity, spin);
            assert!(energy <= 0.5 * cue.mass_kg * 9.0, "{step}: {energy}");
        }
    }
}
