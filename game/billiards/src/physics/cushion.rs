//! Ball against cushion: a compliant contact with restitution and Coulomb friction.
//!
//! The model of Stronge, "Impact Mechanics" (2000), chapter 5, for a sphere on a half-space: the normal
//! contact is a spring that returns e² of its energy, the tangential contact a spring that sticks while
//! its force stays within Coulomb's limit μN and slips beyond. Within a contact the ball's surface
//! sticks, slips, or slips, sticks and slips again; a spinning ball can leave with more tangential
//! speed than a rigid law allows.
//!
//! The nose is above the centre of a ball on the cloth, so that the normal, from the nose to the
//! centre, points down into the slate, which absorbs that part of the impulse: on the cloth the
//! vertical velocity is dropped. In the air the normal is that of the point of contact, and nothing is
//! dropped.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::DVec3;

use crate::deterministic_math::{acos, cos, sin_cos};

use super::{ball::BallBody, ball_ball::Twist, rebound::kept_apart};

/// The law of ball–cushion contacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CushionLaw {
    /// Restitution along the tilted normal (e); default 0.85, which is 0.72–0.75 seen from above.
    pub restitution: f64,
    /// Coulomb friction of ball on cushion (μ); default 0.2.
    pub friction: f64,
    /// Frequency of the tangential over the normal spring, 1 to 2; default 1.8.
    pub frequency_ratio: f64,
}

impl Default for CushionLaw {
    fn default() -> Self {
        Self {
            restitution: 0.85,
            friction: 0.2,
            frequency_ratio: 1.8,
        }
    }
}

impl CushionLaw {
    /// Twist of a ball on the cloth after contact with a cushion whose nose is at `nose_height_m`;
    /// `away` is the horizontal unit vector from the cushion to the ball.
    pub(crate) fn rebound(
        &self,
        body: &BallBody,
        (away, nose_height_m): (DVec3, f64),
        twist: Twist,
    ) -> Twist {
        let above = nose_height_m / body.radius_m - 1.0;
        let normal = (away - above * DVec3::Z).normalize();
        let mut after = self.resolve(body, normal, twist);
        // The slate absorbs what the tilted normal has pushed down.
        after.velocity.z = 0.0;
        after.velocity = kept_apart(away, twist.velocity, after.velocity);
        after
    }

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
            // The centre takes 2/7 of the change of the surface's speed, the spin the rest.
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
    /// The unit of time is that of the normal spring: compression lasts π/2, restitution e·π/2 more.
    fn slip_after(&self, slip: f64, approach: f64) -> f64 {
        let e = self.restitution;
        let limit = self.friction * approach;
        // Deflection of the tangential spring at Coulomb's limit, per sin(phase).
        let stretch = limit * MASS_RATIO / self.frequency_ratio.powi(2);
        let pull = limit * MASS_RATIO;
        // Slip throughout: the surface still slips at the end of the contact. Coulomb's impulse of the
        // whole contact per mass is μ(1 + e) times the approach, and changes the slip by 7/2 of that.
        // The last term is the slip that the spring could still hold as the limit falls to 0.
        if slip >= pull * (1.0 + e) - stretch / e {
            return slip - pull * (1.0 + e);
        }
        // At first touch the spring's force and Coulomb's limit grow from 0 together: a surface slower
        // than `stretch` sticks at once.
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
        // From `release` to the end Coulomb's friction acts in the opposite direction.
        stick.speed_at(release) + pull * e * (1.0 + cos(phase(release, e)))
    }

    /// State at the end of the first slip, when the slip speed has fallen to the rate at which
    /// Coulomb's limit lets the spring deflect.
    fn slip_until_stick(&self, slip: f64, stretch: f64, pull: f64) -> StickPhase {
        let e = self.restitution;
        // It sticks when the slip speed has fallen to the rate of the spring's deflection at the limit,
        // stretch · d sin(phase)/dt. In compression slip − pull (1 − cos t) = stretch cos t; in
        // restitution the two cosines have factors e and 1/e.
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

    /// Time at which the spring, having reversed, reaches Coulomb's limit on the other side. The limit
    /// falls to zero at the end of the contact, so that it is reached by then.
    fn slip_again(&self, stick: &StickPhase, stretch: f64) -> f64 {
        let e = self.restitution;
        let mut holds = stick.from.max(FRAC_PI_2);
        let mut slips = FRAC_PI_2 * (1.0 + e);
        for _ in 0..BISECTIONS {
            let t = 0.5 * (holds + slips);
            // By bisection: the spring's frequency and the normal one's differ, and no closed form is
            // left.
            if -stick.deflection_at(t) < stretch * sin_cos(phase(t, e)).0 {
                holds = t;
            } else {
                slips = t;
            }
        }
        slips
    }
}

/// State of the tangential spring while the surface sticks.
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

/// Phase of the normal spring: 0 at first touch, π/2 at full compression, π at separation.
fn phase(t: f64, restitution: f64) -> f64 {
    if t <= FRAC_PI_2 {
        t
    } else {
        (t / restitution + FRAC_PI_2 * (1.0 - 1.0 / restitution)).min(PI)
    }
}

/// Ratio of a solid sphere's change of surface speed to that of its centre, for one tangential impulse:
/// 1 + m R²/I.
const MASS_RATIO: f64 = 3.5;
/// Bisections that narrow an interval of π to below its last bit.
const BISECTIONS: u32 = 56;

#[cfg(test)]
mod tests {
    use super::super::REBOUND_ENERGY_J;
    use super::*;

    fn twists() -> impl Iterator<Item = Twist> {
        (0..2000u32).map(|i| {
            let [a, b, c, d, e] =
                [1.0, 0.618, 0.414, 0.732, 0.236].map(|k| 2.0 * (f64::from(i) * k).fract() - 1.0);
            let scale = 10.0f64.powf(3.0 * e);
            Twist {
                velocity: DVec3::new(1e-9 - 6.0 * a.abs(), 6.0 * b, 0.0),
                spin: scale * DVec3::new(c, d, a * b),
            }
        })
    }

    #[test]
    fn no_contact_gains_energy_or_lets_a_ball_through() {
        let body = BallBody::default();
        let energy = |twist: Twist| body.kinetic_energy_j(twist.velocity, twist.spin);
        let law = CushionLaw::default();
        for twist in twists() {
            let away = DVec3::X;
            let flat = law.rebound(&body, (away, 0.0363), twist);
            let tilted = (away + 0.4 * DVec3::Z).normalize();
            let free = law.resolve(&body, tilted, twist);
            let allowed = energy(twist) * (1.0 + 1e-12) + REBOUND_ENERGY_J;
            for (after, out) in [(flat, away), (free, tilted)] {
                assert!(energy(after) <= allowed, "{twist:?} {after:?}");
                assert!(after.velocity.dot(out) >= 0.0, "{twist:?} {after:?}");
            }
            assert_eq!(flat.velocity.z, 0.0);
        }
    }

    #[test]
    fn straight_shots_come_back_straight_and_english_turns_them() {
        let body = BallBody::default();
        let stun = Twist {
            velocity: DVec3::new(-2.0, 0.0, 0.0),
            spin: DVec3::ZERO,
        };
        let law = CushionLaw::default();
        let after = law.rebound(&body, (DVec3::X, 0.0363), stun);
        assert!((1.2..1.8).contains(&after.velocity.x), "{after:?}");
        assert!(after.velocity.y.abs() < 1e-12, "{after:?}");
        let english = Twist {
            spin: 50.0 * DVec3::Z,
            ..stun
        };
        let turned = law.rebound(&body, (DVec3::X, 0.0363), english);
        assert!(turned.velocity.y > 0.1, "{turned:?}");
        assert!(turned.spin.z < 50.0, "{turned:?}");
    }

    /// pooltool 0.6.0 takes the normal of a jaw from the middle of its circle (`get_normal_3d` of
    /// `CircularCushionSegment`), not from the nose that the ball touches: with that normal ours is its
    /// answer. A straight cushion, the limit of a wide circle, would then push level.
    #[test]
    fn pooltools_side_jaws_differ_by_the_place_of_contact_alone() {
        let (radius_m, nose_m, jaw_m) = (0.028_575, 0.036_576, 0.007_95);
        let body = BallBody {
            radius_m,
            ..BallBody::default()
        };
        let law = CushionLaw {
            restitution: 0.85,
            friction: 0.2,
            frequency_ratio: 1.8,
        };
        let center = DVec3::new(-0.007_95, 1.066_116_269_231_249_8, radius_m);
        let ball = DVec3::new(0.017_030_557_557_600_82, 1.039_468_184_494_980_5, radius_m);
        let away = (ball - center).normalize();
        let before = Twist {
            velocity: DVec3::new(-0.786_295_995_866_865_8, 0.386_421_532_553_603_9, 0.0),
            spin: DVec3::new(-13.523_063_256_469_08, -27.516_920_240_310_267, 0.0),
        };
        let theirs = Twist {
            velocity: DVec3::new(0.320_189_270_346_265_1, -0.640_960_423_536_664_7, 0.0),
            spin: DVec3::new(
                2.829_040_343_301_447,
                -9.503_673_154_987_236,
                -8.940_616_115_876_232,
            ),
        };
        // The nose's height at which a ball would touch it along the line from the circle's middle.
        let from_middle_m = radius_m + (nose_m - radius_m) * radius_m / (radius_m + jaw_m);
        let so = law.rebound(&body, (away, from_middle_m), before);
        assert!((so.velocity - theirs.velocity).length() < 1e-5, "{so:?}");
        assert!((so.spin - theirs.spin).length() < 1e-3, "{so:?}");
        let ours = law.rebound(&body, (away, nose_m), before);
        assert!(
            (ours.velocity - theirs.velocity).length() > 0.02,
            "{ours:?}"
        );
    }

    #[test]
    fn a_mirrored_contact_is_the_mirror_image() {
        let body = BallBody::default();
        let flip = |v: DVec3| DVec3::new(v.x, -v.y, v.z);
        let law = CushionLaw::default();
        for twist in twists().take(200) {
            let twin = Twist {
                velocity: flip(twist.velocity),
                spin: -flip(twist.spin),
            };
            let one = law.rebound(&body, (DVec3::X, 0.0363), twist);
            let two = law.rebound(&body, (DVec3::X, 0.0363), twin);
            assert!(
                (flip(one.velocity) - two.velocity).length() < 1e-9,
                "{twist:?}"
            );
            assert!((-flip(one.spin) - two.spin).length() < 1e-6, "{twist:?}");
        }
    }

    #[test]
    fn the_slip_law_is_continuous_and_loses_energy() {
        let law = CushionLaw::default();
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
        let law = CushionLaw {
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
