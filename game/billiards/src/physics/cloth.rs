//! Ball on cloth: Coulomb friction of a sphere on a plane, in closed form.
//!
//! A sliding ball is decelerated by a force of constant direction until its lowest point stops (for a
//! ball without spin at 5/7 of its speed), then rolls against a small constant resistance until it
//! rests; spin about the vertical decays at a constant rate independently. Each phase has constant
//! accelerations, so a [`Motion`] is exact at every instant of its duration. Laws: Marlow, "The Physics
//! of Pocket Billiards", 1995; constants: Alciatore, "Physical properties".

use glam::DVec3;

use super::{
    ball::{BallBody, Phase},
    ball_ball::Twist,
    motion::{Motion, MotionEnd, rolling_spin},
};

/// The friction between ball and cloth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cloth {
    /// Coulomb friction while sliding; default 0.2, measured 0.15–0.4.
    pub sliding_friction: f64,
    /// Deceleration while rolling, over g; default 0.01, measured 0.005–0.015.
    pub rolling_friction: f64,
    /// Friction against spin about the vertical, as the lever arm in m of the ball's weight: the spin
    /// decays by 5/2 · this · g/R². Default 0.36 mm, which is 10.9 rad/s² for a pool ball; measured
    /// 5–15.
    pub spin_friction_m: f64,
    /// Gravity in m/s²; default 9.81.
    pub gravity_m_s2: f64,
}

impl Default for Cloth {
    fn default() -> Self {
        Self {
            sliding_friction: 0.2,
            rolling_friction: 0.01,
            spin_friction_m: 4.0 / 9.0 * 0.028_575 * 0.028_575,
            gravity_m_s2: 9.81,
        }
    }
}

/// Speed of a table: how far a ball rolls on its cloth.
///
/// Rolling resistances of 0.005 to 0.015 are measured (Alciatore, "Physical properties").
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum TableSpeed {
    /// Heavy or worn cloth: a ball rolls three quarters as far
    Slow,
    /// Cloth of tournaments
    #[default]
    Standard,
    /// New and thin cloth: a ball rolls a third farther
    Fast,
}

impl TableSpeed {
    /// All, from the slowest to the fastest.
    pub const ALL: [Self; 3] = [Self::Slow, Self::Standard, Self::Fast];

    /// Rolling resistance over that of standard cloth.
    pub(crate) fn resistance_factor(self) -> f64 {
        match self {
            Self::Slow => 4.0 / 3.0,
            Self::Standard => 1.0,
            Self::Fast => 0.75,
        }
    }
}

impl Cloth {
    /// Velocity of the ball's lowest point over the cloth.
    pub(crate) fn slip(body: &BallBody, velocity: DVec3, spin: DVec3) -> DVec3 {
        velocity - body.radius_m * spin.cross(DVec3::Z)
    }

    /// The motion that follows from a state on the cloth.
    pub(crate) fn motion(&self, body: &BallBody, position: DVec3, twist: Twist) -> Motion {
        let Twist { velocity, spin } = twist;
        let slip = Self::slip(body, velocity, spin);
        let spin_decay = 2.5 * self.spin_friction_m * self.gravity_m_s2 / body.radius_m.powi(2);
        let (phase, acceleration, duration, end) = if slip.length() > SLIP_LEAST_M_S {
            let deceleration = self.sliding_friction * self.gravity_m_s2;
            // Friction decelerates the centre by μg and, through its torque, the lowest point by 5/2 μg
            // more. Both act along the slip, whose direction is therefore constant: the motion is one
            // parabola.
            let duration = slip.length() / (3.5 * deceleration);
            (
                Phase::Sliding,
                -deceleration * slip.normalize(),
                duration,
                MotionEnd::SlipStops,
            )
        } else if velocity.length() > SPEED_LEAST_M_S {
            let deceleration = self.rolling_friction * self.gravity_m_s2;
            let duration = velocity.length() / deceleration;
            (
                Phase::Rolling,
                -deceleration * velocity.normalize(),
                duration,
                MotionEnd::RollStops,
            )
        } else {
            (Phase::Resting, DVec3::ZERO, f64::INFINITY, MotionEnd::Never)
        };
        let mut motion = Motion {
            phase,
            position,
            velocity,
            spin,
            acceleration,
            spin_acceleration: torque_spin(phase, acceleration, body.radius_m),
            duration_secs: duration,
            radius_m: body.radius_m,
            end,
        };
        match phase {
            // Recomputed, so that round-off of the slide leaves no slip that would begin another one.
            Phase::Rolling => motion.spin = rolling_spin(velocity, spin.z, body.radius_m),
            Phase::Resting => {
                motion.velocity = DVec3::ZERO;
                motion.spin = DVec3::new(0.0, 0.0, spin.z);
            }
            _ => {}
        }
        motion.decay_spin(spin_decay);
        motion
    }
}

impl Motion {
    /// Adds the decay of spin about the vertical, and ends the motion where that spin ends: beyond, its
    /// acceleration would be another.
    fn decay_spin(&mut self, decay: f64) {
        if self.spin.z.abs() <= SPIN_LEAST_RAD_S {
            self.spin.z = 0.0;
            return;
        }
        self.spin_acceleration.z = -decay * self.spin.z.signum();
        let spin_lasts = self.spin.z.abs() / decay;
        if spin_lasts <= self.duration_secs {
            self.duration_secs = spin_lasts;
            self.end = MotionEnd::SpinStops;
        }
        if self.phase == Phase::Resting {
            self.phase = Phase::Spinning;
        }
    }
}

/// Angular acceleration that belongs to a horizontal acceleration: friction's own torque while sliding,
/// whatever keeps the ball rolling while rolling.
fn torque_spin(phase: Phase, acceleration: DVec3, radius_m: f64) -> DVec3 {
    match phase {
        // Torque over inertia: (−R z) × (m a) / (2/5 m R²).
        Phase::Sliding => 2.5 / radius_m * acceleration.cross(DVec3::Z),
        Phase::Rolling => DVec3::Z.cross(acceleration) / radius_m,
        _ => DVec3::ZERO,
    }
}

/// Slip below which a ball counts as rolling: far below what a millisecond of friction changes.
const SLIP_LEAST_M_S: f64 = 1e-10;
/// Speed below which a rolling ball counts as resting: it would roll another 5e-18 m.
const SPEED_LEAST_M_S: f64 = 1e-9;
/// Spin about the vertical below which a ball counts as without it.
const SPIN_LEAST_RAD_S: f64 = 1e-9;
