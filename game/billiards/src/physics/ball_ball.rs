//! Ball against ball: an instantaneous impulse with restitution and Coulomb friction.
//!
//! The friction falls with the slip speed, μ = a + b·exp(−c·v), fitted by Alciatore (TP A-14) to
//! measured throw. The tangential impulse is the smaller of Coulomb's μ·J and what stops the slip,
//! 2/7 of the reduced mass times the slip for two solid spheres of any masses and radii (for equal
//! ones m·v/7, as in TP ).

use glam::DVec3;

use super::ball::BallBody;
use crate::deterministic_math::exp;

/// The law of ball–ball contacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallBallLaw {
    /// Separation speed over approach speed; default 0.95, measured 0.92–0.98.
    pub restitution: f64,
    /// Friction at high slip speed (a); default 0.009951.
    pub friction_fast: f64,
    /// Additional friction at no slip (b); default 0.108.
    pub friction_slow_extra: f64,
    /// Decay constant of that with slip speed (c), in s/m; default 1.088.
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

/// Velocity and spin of one ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Twist {
    pub(crate) velocity: DVec3,
    pub(crate) spin: DVec3,
}

/// Speed in m/s at which balls separate that approach more slowly than it: without it the balls of a
/// frozen cluster exchange ever smaller impulses without end. It adds at most ½ of the reduced mass
/// times its square to a contact: about 1 µJ for two pool balls ([`CLUSTER_ENERGY_J`]).
pub const CLUSTER_SPEED_M_S: f64 = 5e-3;

/// The most energy that [`CLUSTER_SPEED_M_S`] can add to one contact between two pool balls.
pub const CLUSTER_ENERGY_J: f64 = 0.170_097 * 2.5e-3 * 2.5e-3;

impl BallBallLaw {
    /// The ideal law of textbooks: elastic and without friction.
    pub const IDEAL: Self = Self {
        restitution: 1.0,
        friction_fast: 0.0,
        friction_slow_extra: 0.0,
        friction_fade_s_m: 0.0,
    };

    /// Twists after the contact of two balls; `normal` is the unit vector from the first centre
    /// to the second.
    pub(crate) fn resolve(
        &self,
        normal: DVec3,
        (first_body, first): (&BallBody, Twist),
        (second_body, second): (&BallBody, Twist),
    ) -> (Twist, Twist) {
        let approach = (first.velocity - second.velocity).dot(normal);
        let separation = if approach < CLUSTER_SPEED_M_S {
            CLUSTER_SPEED_M_S
        } else {
            self.restitution * approach
        };
        let reduced_kg =
            first_body.mass_kg / (first_body.mass_kg + second_body.mass_kg) * second_body.mass_kg;
        // Newton's law of restitution: the relative normal velocity goes from −approach to +separation.
        let push = reduced_kg * (approach + separation);
        let surface_speed = first_body.radius_m * first.spin + second_body.radius_m * second.spin;
        let contact = first.velocity - second.velocity + surface_speed.cross(normal);
        let slip = contact - contact.dot(normal) * normal;
        let speed = slip.length();
        let friction =
            self.friction_fast + self.friction_slow_extra * exp(-self.friction_fade_s_m * speed);
        let drag = if speed > 0.0 {
            // 7/2 = 1 + 5/2: a tangential impulse changes the surface velocity of a solid sphere by 7/2
            // of impulse over mass, one part from translation and 5/2 from spin.
            -(friction * push.abs()).min(reduced_kg * speed / 3.5) / speed * slip
        } else {
            DVec3::ZERO
        };
        let kick = drag - push * normal;
        let after = |body: &BallBody, before: Twist, impulse: DVec3| Twist {
            velocity: before.velocity + impulse / body.mass_kg,
            // The same for both balls: the second has the opposite impulse on the opposite arm.
            spin: before.spin + 2.5 / (body.mass_kg * body.radius_m) * normal.cross(drag),
        };
        (
            after(first_body, first, kick),
            after(second_body, second, -kick),
        )
    }
}
