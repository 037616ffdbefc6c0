//! Ball against ball: an instantaneous impulse with restitution and Coulomb friction.
//!
//! The friction falls with the slip speed, μ = a + b·exp(−c·v), fitted by Alciatore (TP A-14) to
//! measured throw. The tangential impulse is the smaller of Coulomb's μ·J and what stops the slip
//! (m·v/7 for two solid spheres), as in TP. Equal masses and radii.

use glam::DVec3;

use super::ball::BallBody;

/// The law of ball–ball contacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallBallLaw {
    /// Separation speed over approach speed; default 0.95, measured 0.92–0.98.
    pub restitution: f64,
    /// Friction at high slip speed (a); default 0.009951.
    pub friction_fast: f64,
    /// What is added to it at no slip (b); default 0.108.
    pub friction_slow_extra: f64,
    /// How fast that fades (c), in s/m; default 1.088.
    pub friction_fade_s_m: f64,
}

impl Default for BallBallLaw {
    fn default() -> Self {
        Self {
            restitution: 0.95,
            friction_fast: 0.009_951,
            friction_slow_extra: 0.108,
            friction_fade_s_m: 1.088,
        }
    }
}

impl BallBallLaw {
    /// The ideal law of textbooks: elastic and without friction.
    pub const IDEAL: Self = Self {
        restitution: 1.0,
        friction_fast: 0.0,
        friction_slow_extra: 0.0,
        friction_fade_s_m: 0.0,
    };
}

/// Velocity and spin of one ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Twist {
    pub(crate) velocity: DVec3,
    pub(crate) spin: DVec3,
}

/// Approach below this speed ends in separation at this speed: without it the balls of a frozen
/// cluster exchange ever smaller contacts without end. It adds at most m·(2.5 mm/s)², about 1 µJ,
/// to a contact ([`CLUSTER_ENERGY_J`]).
pub const CLUSTER_SPEED_M_S: f64 = 5e-3;

/// The most energy that [`CLUSTER_SPEED_M_S`] can add to one contact between two pool balls.
pub const CLUSTER_ENERGY_J: f64 = 0.170_097 * 2.5e-3 * 2.5e-3;

impl BallBallLaw {
    /// Twists after the contact of two balls; `normal` is the unit vector from the first centre
    /// to the second. Vertical velocity is dropped: the balls stay on the cloth.
    pub(crate) fn resolve(
        &self,
        body: &BallBody,
        normal: DVec3,
        first: Twist,
        second: Twist,
    ) -> (Twist, Twist) {
        let approach = (first.velocity - second.velocity).dot(normal);
        let separation = if approach < CLUSTER_SPEED_M_S {
            CLUSTER_SPEED_M_S
        } else {
            self.restitution * approach
        };
        let push = 0.5 * (approach + separation);
        let arm = body.radius_m * normal;
        let contact =
            first.velocity + first.spin.cross(arm) - (second.velocity - second.spin.cross(arm));
        let slip = contact - contact.dot(normal) * normal;
        let speed = slip.length();
        let friction =
            self.friction_fast + self.friction_slow_extra * (-self.friction_fade_s_m * speed).exp();
        let drag = if speed > 0.0 {
            -(friction * push).min(speed / 7.0) / speed * slip
        } else {
            DVec3::ZERO
        };
        let kick = drag - push * normal;
        let turn = 2.5 / body.radius_m * normal.cross(drag);
        (
            Twist {
                velocity: on_cloth(first.velocity + kick),
                spin: first.spin + turn,
            },
            Twist {
                velocity: on_cloth(second.velocity - kick),
                spin: second.spin + turn,
            },
        )
    }
}

fn on_cloth(velocity: DVec3) -> DVec3 {
    DVec3::new(velocity.x, velocity.y, 0.0)
}
