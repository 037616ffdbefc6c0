//! Impact of a ball on a rigid surface that does not move: the slate, a rail's top, a pocket's rim.
//!
//! An instantaneous impulse with restitution. Coulomb friction acts on the slip of the contact point
//! and at most stops it, which exchanges translation and spin. Restitution and friction of ball and
//! slate: Alciatore, "Physical properties" (e 0.5, μ 0.2).

use glam::DVec3;

use super::{
    ball::BallBody,
    ball_ball::Twist,
    rebound::{REBOUND_SPEED_M_S, kept_apart},
};

/// The law of bounces off a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BounceLaw {
    /// Speed after over speed before, along the normal, from 0 to 1.
    pub restitution: f64,
    /// Coulomb friction, at least 0.
    pub friction: f64,
}

impl BounceLaw {
    /// Ball on cloth over slate.
    pub const SLATE: Self = Self {
        restitution: 0.5,
        friction: 0.2,
    };

    /// Ball on a pocket's leather or plastic, which absorbs most of an impact: chosen so that a hard
    /// shot into the middle of a pocket stays in it.
    pub const POCKET: Self = Self {
        restitution: 0.2,
        friction: 0.2,
    };

    /// A surface that absorbs the normal velocity and has no friction: balls never hop off it. As the
    /// slate's law it makes the table that of a flat simulator.
    pub const FLAT: Self = Self {
        restitution: 0.0,
        friction: 0.0,
    };

    /// Twist after touching a surface with the unit `normal` out of it.
    pub(crate) fn resolve(&self, body: &BallBody, normal: DVec3, twist: Twist) -> Twist {
        let approach = -twist.velocity.dot(normal);
        if approach <= 0.0 {
            return twist;
        }
        let push = (1.0 + self.restitution) * approach;
        let contact = twist.velocity - body.radius_m * twist.spin.cross(normal);
        let slip = contact + approach * normal;
        let speed = slip.length();
        let drag = if speed > 0.0 {
            // An impulse J changes the slip by 7/2 J/m, 1 from translation and 5/2 from spin: more than
            // slip/3.5 would reverse the slip.
            -(self.friction * push).min(speed / 3.5) / speed * slip
        } else {
            DVec3::ZERO
        };
        Twist {
            velocity: twist.velocity + push * normal + drag,
            spin: twist.spin - 2.5 / body.radius_m * normal.cross(drag),
        }
    }
}

/// Velocity after a contact with a curved surface, for a ball that runs along it (the wall of a pocket,
/// or its rim): it leaves along `away` at [`SKIM_SHARE`] of its speed at least, and so moves in hops of
/// about six degrees of the wall instead of ever smaller ones. The energy of a hop is taken from the
/// rest of the motion, except what [`kept_apart`] may add.
pub(crate) fn skimmed(away: DVec3, before: DVec3, after: DVec3) -> DVec3 {
    let speed = after.length();
    let least = SKIM_SHARE * speed;
    if least < REBOUND_SPEED_M_S {
        return kept_apart(away, before, after);
    }
    let hopping = after + (least - after.dot(away)).max(0.0) * away;
    (speed / hopping.length()).min(1.0) * hopping
}

/// Minimum share of its speed with which a ball leaves a curved surface.
const SKIM_SHARE: f64 = 0.05;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounces_keep_restitution_and_gain_no_energy() {
        let body = BallBody::default();
        for (spin, friction) in [(0.0, 0.2), (80.0, 0.2), (-400.0, 0.05), (1e4, 1.0)] {
            let law = BounceLaw {
                restitution: 0.5,
                friction,
            };
            let before = Twist {
                velocity: DVec3::new(1.5, -0.5, -3.0),
                spin: DVec3::new(0.3 * spin, spin, -0.5 * spin),
            };
            let after = law.resolve(&body, DVec3::Z, before);
            assert!((after.velocity.z - 1.5).abs() < 1e-15);
            assert_eq!(after.spin.z, before.spin.z, "a point has no grip on it");
            let energy = |twist: Twist| body.kinetic_energy_j(twist.velocity, twist.spin);
            assert!(energy(after) < energy(before));
        }
    }

    #[test]
    fn enough_friction_makes_the_ball_roll() {
        let body = BallBody::default();
        let law = BounceLaw {
            restitution: 0.5,
            friction: 10.0,
        };
        let before = Twist {
            velocity: DVec3::new(2.0, 0.0, -1.0),
            spin: DVec3::ZERO,
        };
        let after = law.resolve(&body, DVec3::Z, before);
        assert!((after.velocity.x - 10.0 / 7.0).abs() < 1e-15);
        assert!((after.velocity.x - body.radius_m * after.spin.y).abs() < 1e-15);
    }

    #[test]
    fn a_ball_that_runs_along_a_wall_hops_without_gaining() {
        for along in [1e-3, 0.1, 2.0, 10.0] {
            let before = DVec3::new(-1e-9, along, 0.0);
            let after = skimmed(DVec3::X, before, before.with_x(0.0));
            assert!(after.x >= (0.049 * along).min(REBOUND_SPEED_M_S));
            let gained = after.length_squared() - along * along;
            assert!(
                gained <= REBOUND_SPEED_M_S.powi(2) * (1.0 + 1e-9),
                "{gained}"
            );
        }
    }
}
