//! A ball: body, pose, and state of motion at one instant.

use crate::LayoutFault;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// A ball's body: a solid sphere. The balls of one table may differ.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BallBody {
    /// Mass in kg; default 0.170097 (6 oz).
    pub mass_kg: f64,
    /// Radius in m; default 0.028575 (2¼ in across).
    pub radius_m: f64,
}

impl Default for BallBody {
    fn default() -> Self {
        Self::POOL
    }
}

impl BallBody {
    /// Pool: 6 oz, 2¼ in across (WPA equipment specifications, 16).
    pub const POOL: Self = Self {
        mass_kg: 0.170_097,
        radius_m: 0.028_575,
    };

    /// Checks mass and radius; `number` names the ball in the error.
    ///
    /// # Errors
    /// [`LayoutFault::Body`] for a mass or radius that is not positive and finite.
    pub(crate) fn validate(&self, number: u8) -> Result<(), LayoutFault> {
        for (name, value, unit) in [("mass", self.mass_kg, "kg"), ("radius", self.radius_m, "m")] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(LayoutFault::Body {
                    ball: number,
                    quantity: name,
                    value,
                    unit,
                });
            }
        }
        Ok(())
    }

    /// Kinetic energy in J of a ball of this body: translation plus rotation (I = 2/5 m R²).
    pub fn kinetic_energy_j(&self, velocity: DVec3, spin: DVec3) -> f64 {
        let inertia = 0.4 * self.mass_kg * self.radius_m * self.radius_m;
        0.5 * (self.mass_kg * velocity.length_squared() + inertia * spin.length_squared())
    }
}

/// State of contact of a ball with the cloth, or how it left the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Phase {
    /// At rest on the cloth.
    Resting,
    /// Spinning in place about the vertical.
    Spinning,
    /// Rolling: the contact point is at rest.
    Rolling,
    /// Sliding: the contact point slips.
    Sliding,
    /// Off the cloth: after a jump, over the rim of a pocket, off the table, or carried by particles,
    /// also at rest.
    Airborne,
    /// In a pocket: no longer part of the table.
    Pocketed,
    /// Left the cloth other than through a pocket.
    OffTable,
}

impl Phase {
    /// Whether the ball is still in play, on the cloth or above it.
    pub fn is_on_table(self) -> bool {
        !matches!(self, Self::Pocketed | Self::OffTable)
    }
}

/// A ball at one instant. The centre of a ball on the cloth is at z = radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallState {
    /// 0 is the cue ball.
    pub number: u8,
    /// Mass and size.
    pub body: BallBody,
    /// The centre, in m.
    pub position: DVec3,
    /// Velocity in m/s.
    pub velocity: DVec3,
    /// Angular velocity in rad/s, right-handed.
    pub spin: DVec3,
    /// `world_from_ball`: rotates the ball's own axes (its number, its stripe) into the table's.
    pub orientation: DQuat,
    /// State of contact with the cloth.
    pub phase: Phase,
}

impl BallState {
    /// A ball at rest at a place on the cloth (x along the length, y across).
    pub fn at_rest(number: u8, x: f64, y: f64, body: &BallBody) -> Self {
        Self {
            number,
            body: *body,
            position: DVec3::new(x, y, body.radius_m),
            velocity: DVec3::ZERO,
            spin: DVec3::ZERO,
            orientation: DQuat::IDENTITY,
            phase: Phase::Resting,
        }
    }

    /// The pose in which it is drawn.
    pub fn pose(&self) -> BallPose {
        BallPose {
            number: self.number,
            position: self.position,
            rotation: self.orientation,
            on_table: self.phase.is_on_table(),
        }
    }
}

/// The pose in which a ball is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallPose {
    /// 0 is the cue ball.
    pub number: u8,
    /// The centre, in m: its last position for a ball that left the table.
    pub position: DVec3,
    /// `world_from_ball`, a unit quaternion.
    pub rotation: DQuat,
    /// False once the ball is in a pocket or off the table.
    pub on_table: bool,
}
