//! Ball against cushion: three models of what rubber, ball and cloth do to each other.
//!
//! The nose is above the centre of a ball on the cloth, so that the normal, from the nose to the
//! centre, points down into the slate, which takes up that part of the impulse: on the cloth the
//! vertical velocity is dropped. In the air the normal is that of the place where the ball touches,
//! and nothing is dropped.

mod mathavan;
mod stronge;

use glam::DVec3;

pub use self::{mathavan::Mathavan, stronge::Stronge};
use super::{ball::BallBody, ball_ball::Twist, rebound::kept_apart, slate_impact::BounceLaw};

/// The law of ball–cushion contacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CushionLaw {
    /// A rigid cushion with Coulomb friction that at most stops the slip: Han, "Dynamics in carom
    /// and three cushion billiards", J. Mech. Sci. Technol. 19 (2005). The restitution and
    /// friction are constants here; its author lets them depend on speed and angle.
    Han(BounceLaw),
    /// A rigid cushion and the cloth under the ball, both with friction, integrated over the
    /// impulse: Mathavan et al. 2010.
    Mathavan(Mathavan),
    /// Springs along and across the contact: Stronge 2000. The default.
    Stronge(Stronge),
}

impl Default for CushionLaw {
    fn default() -> Self {
        Self::Stronge(Stronge::default())
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
        let mut after = match self {
            Self::Han(law) => law.resolve(body, normal, twist),
            Self::Mathavan(law) => law.resolve(body, normal, Some(law.cloth_friction), twist),
            Self::Stronge(law) => law.resolve(body, normal, twist),
        };
        after.velocity.z = 0.0;
        after.velocity = kept_apart(away, twist.velocity, after.velocity);
        after
    }

    /// Twist of a ball in the air after contact with the unit `normal` from the cushion to it.
    pub(crate) fn rebound_in_air(&self, body: &BallBody, normal: DVec3, twist: Twist) -> Twist {
        match self {
            Self::Han(law) => law.resolve(body, normal, twist),
            Self::Mathavan(law) => law.resolve(body, normal, None, twist),
            Self::Stronge(law) => law.resolve(body, normal, twist),
        }
    }

    /// Restitution and friction.
    pub(crate) fn constants(&self) -> (f64, f64) {
        match *self {
            Self::Han(law) => (law.restitution, law.friction),
            Self::Mathavan(law) => (law.restitution, law.friction),
            Self::Stronge(law) => (law.restitution, law.friction),
        }
    }

    /// Its constants with their names and ranges.
    pub(crate) fn checks(&self) -> Vec<(&'static str, f64, std::ops::Range<f64>)> {
        let ratio = f64::MIN_POSITIVE..1.0 + f64::EPSILON;
        let any = 0.0..f64::MAX;
        let (restitution, friction) = self.constants();
        let mut checks = vec![
            ("restitution of cushions", restitution, ratio),
            ("friction of cushions", friction, any.clone()),
        ];
        match *self {
            Self::Han(_) => {}
            Self::Mathavan(law) => {
                checks.push(("friction of the cloth at cushions", law.cloth_friction, any));
            }
            Self::Stronge(law) => {
                checks.push(("frequency ratio of cushions", law.frequency_ratio, 1.0..2.0));
            }
        }
        checks
    }
}

#[cfg(test)]
mod tests {
    use super::super::REBOUND_ENERGY_J;
    use super::*;

    fn laws() -> [CushionLaw; 3] {
        [
            CushionLaw::Han(BounceLaw {
                restitution: 0.85,
                friction: 0.2,
            }),
            CushionLaw::Mathavan(Mathavan::default()),
            CushionLaw::default(),
        ]
    }

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
    fn no_law_gains_energy_or_lets_a_ball_through() {
        let body = BallBody::default();
        let energy = |twist: Twist| body.kinetic_energy_j(twist.velocity, twist.spin);
        for law in laws() {
            for twist in twists() {
                let away = DVec3::X;
                let flat = law.rebound(&body, (away, 0.0363), twist);
                let tilted = (away + 0.4 * DVec3::Z).normalize();
                let free = law.rebound_in_air(&body, tilted, twist);
                let allowed = energy(twist) * (1.0 + 1e-12) + REBOUND_ENERGY_J;
                for (after, out) in [(flat, away), (free, tilted)] {
                    assert!(energy(after) <= allowed, "{law:?} {twist:?} {after:?}");
                    assert!(
                        after.velocity.dot(out) >= 0.0,
                        "{law:?} {twist:?} {after:?}"
                    );
                }
                assert_eq!(flat.velocity.z, 0.0);
            }
        }
    }

    #[test]
    fn cushion_laws_agree_on_straight_shots_and_english() {
        let body = BallBody::default();
        let stun = Twist {
            velocity: DVec3::new(-2.0, 0.0, 0.0),
            spin: DVec3::ZERO,
        };
        for law in laws() {
            let after = law.rebound(&body, (DVec3::X, 0.0363), stun);
            assert!((1.2..1.8).contains(&after.velocity.x), "{law:?} {after:?}");
            assert!(after.velocity.y.abs() < 1e-12, "{law:?} {after:?}");
            let english = Twist {
                spin: 50.0 * DVec3::Z,
                ..stun
            };
            let turned = law.rebound(&body, (DVec3::X, 0.0363), english);
            assert!(turned.velocity.y > 0.1, "{law:?} {turned:?}");
            assert!(turned.spin.z < 50.0, "{law:?} {turned:?}");
        }
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
        let law = CushionLaw::Stronge(Stronge {
            restitution: 0.85,
            friction: 0.2,
            frequency_ratio: 1.8,
        });
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
        for law in laws() {
            for twist in twists().take(200) {
                let twin = Twist {
                    velocity: flip(twist.velocity),
                    spin: -flip(twist.spin),
                };
                let one = law.rebound(&body, (DVec3::X, 0.0363), twist);
                let two = law.rebound(&body, (DVec3::X, 0.0363), twin);
                assert!(
                    (flip(one.velocity) - two.velocity).length() < 1e-9,
                    "{law:?}"
                );
                assert!((-flip(one.spin) - two.spin).length() < 1e-6, "{law:?}");
            }
        }
    }
}
