//! Ball against cushion: a compliant contact with restitution and Coulomb friction.
//!
//! The model of Stronge, "Impact Mechanics" (2000), chapter 5, for a sphere on a half-space: the
//! normal contact is a spring that gives back e² of its energy, the tangential contact a spring
//! that holds while its force stays within Coulomb's limit μN and slips where it does not. Within
//! the contact the ball's surface sticks, slips, or slips and sticks and slips again; a spinning
//! ball can leave with more tangential speed than a rigid law allows.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::DVec3;

use crate::deterministic_math::{acos, cos, sin_cos};
use crate::physics::{ball::BallBody, ball_ball::Twist};

/// A compliant cushion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stronge {
    /// Restitution along the tilted normal (e); default 0.85, which is 0.72–0.75 seen from above.
    pub restitution: f64,
    /// Coulomb friction of ball on cushion (μ); default 0.2.
    pub friction: f64,
    /// Frequency of the tangential over the normal spring, 1 to 2; default 1.8.
    pub frequency_ratio: f64,
}

impl Default for Stronge {
    fn default() -> Self {
        Self {
            restitution: 0.85,
            friction: 0.2,
            frequency_ratio: 1.8,
        }
    }
}

impl Stronge {
    /// Twist after contact with the unit `normal` from the nose to the centre.
    pub(crate) fn resolve(&self, body: &BallBody, normal: DVec3, twist: Twist) -> Twist {
        let contact = twist.velocity + twist.spin.cross(-body.radius_m * normal);
        let approach = -contact.dot(normal);
        let slip = contact + approach * normal;
        let speed = slip.length();
        if approach <= 0.0 {
            return twist;
        }
        let mut velocity = twist.velocity + (1.0 + self.restitution) * approach * normal;
        let mut spin = twist.spin;
        if speed > 0.0 {
            let change = (self.slip_after(speed, approach) - speed) / MASS_RATIO;
            let kick = change / speed * slip;
            velocity += kick;
            spin -= 2.5 / body.radius_m * normal.cross(kick);
        }
        Twist { velocity, spin }
    }

    /// Tangential speed of the ball's surface after the contact, positive along the speed before;
    /// `slip` and `approach` are the tangential and normal speeds before, both positive.
    ///
    /// Time is counted in the normal spring's: compression lasts π/2, restitution e·π/2 more.
    fn slip_after(&self, slip: f64, approach: f64) -> f64 {
        let e = self.restitution;
        let limit = self.friction * approach;
        // Deflection of the tangential spring at Coulomb's limit, per sin(phase).
        let stretch = limit * MASS_RATIO / self.frequency_ratio.powi(2);
        let pull = limit * MASS_RATIO;
        if slip >= pull * (1.0 + e) - stretch / e {
            return slip - pull * (1.0 + e);
        }
        let stick = if slip < stretch {
            StickPhase {
                from: 0.0,
                deflection: 0.0,
                speed: slip,
                frequency: self.frequency_ratio,
            }
        } else {
            self.slip_until_stick(slip, stretch, pull)
        };
        let release = self.slip_again(&stick, stretch);
        stick.speed_at(release) + pull * e * (1.0 + cos(phase(release, e)))
    }

    /// The surface slips until its speed is that at which Coulomb's limit lets the spring move.
    fn slip_until_stick(&self, slip: f64, stretch: f64, pull: f64) -> StickPhase {
        let e = self.restitution;
        let from = if slip <= pull {
            acos(((slip - pull) / (stretch - pull)).clamp(-1.0, 1.0))
        } else {
            let angle = acos(((slip - pull) / (stretch / e - e * pull)).clamp(-1.0, 1.0));
            e * (angle - FRAC_PI_2 * (1.0 - 1.0 / e))
        };
        let (sin, cos) = sin_cos(phase(from, e));
        let given_back = if from <= FRAC_PI_2 { cos } else { e * cos };
        StickPhase {
            from,
            deflection: stretch * sin,
            speed: slip - pull * (1.0 - given_back),
            frequency: self.frequency_ratio,
        }
    }

    /// When the spring, swung back, reaches Coulomb's limit on the other side. The limit falls to
    /// zero at the end of the contact, so that it happens by then.
    fn slip_again(&self, stick: &StickPhase, stretch: f64) -> f64 {
        let e = self.restitution;
        let mut holds = stick.from.max(FRAC_PI_2);
        let mut slips = FRAC_PI_2 * (1.0 + e);
        for _ in 0..BISECTIONS {
            let t = 0.5 * (holds + slips);
            if -stick.deflection_at(t) < stretch * sin_cos(phase(t, e)).0 {
                holds = t;
            } else {
                slips = t;
            }
        }
        slips
    }
}

/// The tangential spring while the surface sticks.
#[derive(Clone, Copy, Debug)]
struct StickPhase {
    from: f64,
    deflection: f64,
    speed: f64,
    frequency: f64,
}

impl StickPhase {
    fn deflection_at(&self, t: f64) -> f64 {
        let (sin, cos) = sin_cos(self.frequency * (t - self.from));
        self.deflection * cos + self.speed / self.frequency * sin
    }

    fn speed_at(&self, t: f64) -> f64 {
        let (sin, cos) = sin_cos(self.frequency * (t - self.from));
        self.speed * cos - self.frequency * self.deflection * sin
    }
}

/// Phase of the normal spring, 0 at first touch, π/2 at full compression, π at parting.
fn phase(t: f64, restitution: f64) -> f64 {
    if t <= FRAC_PI_2 {
        t
    } else {
        (t / restitution + FRAC_PI_2 * (1.0 - 1.0 / restitution)).min(PI)
    }
}

/// Change of a solid sphere's surface speed over that of its centre, for one tangential impulse:
/// 1 + m R²/I.
const MASS_RATIO: f64 = 3.5;
/// Halves π to below its last bit.
const BISECTIONS: u32 = 56;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slip_law_is_continuous_and_loses_energy() {
        let law = Stronge::default();
        let mut last = 0.0;
        for step in 1..4000 {
            let slip = f64::from(step) * 1e-3;
            let after = law.slip_after(slip, 1.0);
            assert!(
                (after - last).abs() < 5e-3,
                "jumps at {slip}: {last} to {after}"
            );
            assert!(after.abs() <= slip, "gains at {slip}: {after}");
            last = after;
        }
        assert!((law.slip_after(4.0, 1.0) - (4.0 - 0.2 * 3.5 * 1.85)).abs() < 1e-12);
    }

    #[test]
    fn frictionless_full_hits_return_the_restitution() {
        let law = Stronge {
            restitution: 0.85,
            friction: 0.0,
            frequency_ratio: 1.8,
        };
        let body = BallBody::default();
        let before = Twist {
            velocity: DVec3::new(2.0, 0.3, 0.0),
            spin: DVec3::ZERO,
        };
        let after = law.resolve(&body, -DVec3::X, before);
        assert!((after.velocity - DVec3::new(-1.7, 0.3, 0.0)).length() < 1e-15);
        assert_eq!(after.spin, DVec3::ZERO);
    }
}
