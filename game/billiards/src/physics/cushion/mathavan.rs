//! A rigid cushion and the slate under the ball, both with friction, integrated over the impulse.
//!
//! Mathavan, Jackson and Parkin, "A theoretical analysis of billiard ball dynamics under cushion
//! impacts", Proc. IMechE C 224 (2010): a ball that meets the nose, which is higher than its
//! centre, is pressed onto the cloth, and slips there and at the nose in directions that change
//! during the contact. The impulse is applied in small parts; each is opposed by Coulomb friction
//! along the slip of that moment, at both places. Compression ends when the ball no longer
//! approaches, the rest when e² of the work of compression has been given back (Stronge's energetic
//! restitution). Friction of a part stops the slip at most, so that it never turns it round.

use glam::DVec3;

use crate::physics::{ball::BallBody, ball_ball::Twist};

/// A rigid cushion, with the cloth's friction during the contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mathavan {
    /// Restitution (e): the root of the energy given back; default 0.98 as measured by its authors.
    pub restitution: f64,
    /// Friction of ball and cushion; default 0.14, as measured by its authors.
    pub friction: f64,
    /// Friction of ball and cloth during the contact; default 0.212, as measured by its authors.
    pub cloth_friction: f64,
}

impl Default for Mathavan {
    fn default() -> Self {
        Self {
            restitution: 0.98,
            friction: 0.14,
            cloth_friction: 0.212,
        }
    }
}

impl Mathavan {
    /// Twist after contact with the unit `normal` from the nose to the centre; with the cloth's
    /// friction if the ball lies on it.
    pub(crate) fn resolve(
        &self,
        body: &BallBody,
        normal: DVec3,
        cloth: Option<f64>,
        before: Twist,
    ) -> Twist {
        let contact = ContactIntegrator {
            friction: self.friction,
            radius_m: body.radius_m,
            normal,
            cloth,
        };
        let approach = -before.velocity.dot(normal);
        if approach <= 0.0 {
            return before;
        }
        let part = approach / f64::from(PARTS);
        let (mut twist, work) = contact.compress(before, part);
        let mut left = self.restitution * self.restitution * work;
        for _ in 0..PARTS_MAX {
            let next = contact.midpoint(twist, part);
            let speeds = (twist.velocity.dot(normal), next.velocity.dot(normal));
            let given = 0.5 * part * (speeds.0 + speeds.1);
            if given >= left {
                let share = last_share(speeds, part, left);
                return contact.midpoint(twist, share * part);
            }
            left -= given;
            twist = next;
        }
        twist
    }
}

/// The share of a part over which the ball, whose speed grows linearly, takes the work that is
/// left.
fn last_share((from, to): (f64, f64), part: f64, left: f64) -> f64 {
    let gain = to - from;
    let root = (from * from + 2.0 * gain * left / part).max(0.0).sqrt();
    (2.0 * left / part / (from + root).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
}

/// How a part of the impulse acts. Impulses are per mass.
struct ContactIntegrator {
    friction: f64,
    radius_m: f64,
    normal: DVec3,
    cloth: Option<f64>,
}

impl ContactIntegrator {
    /// The twist when the ball no longer approaches, and the work done until then.
    fn compress(&self, before: Twist, part: f64) -> (Twist, f64) {
        let (mut twist, mut work) = (before, 0.0);
        for _ in 0..PARTS_MAX {
            let next = self.midpoint(twist, part);
            let from = twist.velocity.dot(self.normal);
            let to = next.velocity.dot(self.normal);
            if to >= 0.0 {
                let share = from / (from - to);
                work -= 0.5 * share * part * from;
                return (self.midpoint(twist, share * part), work);
            }
            work -= 0.5 * part * (from + to);
            twist = next;
        }
        (twist, 0.0)
    }

    /// A part, with the directions of slip at its middle.
    fn midpoint(&self, twist: Twist, part: f64) -> Twist {
        let half = self.apply(twist, twist, 0.5 * part);
        self.apply(twist, half, part)
    }

    /// A part applied to a twist with the directions of slip of another.
    fn apply(&self, twist: Twist, slipping: Twist, part: f64) -> Twist {
        let at_nose = -self.radius_m * self.normal;
        let nose = self.drag(slipping, at_nose, self.normal, self.friction * part);
        let mut after = self.pushed(twist, at_nose, part * self.normal + nose);
        if let Some(friction) = self.cloth {
            let down = -(part * self.normal.z + nose.z);
            if down > 0.0 {
                let under = -self.radius_m * DVec3::Z;
                let cloth = self.drag(slipping, under, DVec3::Z, friction * down);
                after = self.pushed(after, under, down * DVec3::Z + cloth);
            }
        }
        after
    }

    /// Coulomb friction of at most `most` against the slip at a point of the surface.
    fn drag(&self, twist: Twist, arm: DVec3, normal: DVec3, most: f64) -> DVec3 {
        let speed = twist.velocity + twist.spin.cross(arm);
        let slip = speed - speed.dot(normal) * normal;
        let length = slip.length();
        if length > 0.0 {
            -most.min(length / 3.5) / length * slip
        } else {
            DVec3::ZERO
        }
    }

    fn pushed(&self, twist: Twist, arm: DVec3, impulse: DVec3) -> Twist {
        Twist {
            velocity: twist.velocity + impulse,
            spin: twist.spin + 2.5 / (self.radius_m * self.radius_m) * arm.cross(impulse),
        }
    }
}

/// Compression takes about so many parts.
const PARTS: u32 = 200;
/// Absurd friction could hold the ball in the cushion: then it is given up, and parts slowly.
const PARTS_MAX: u32 = 20 * PARTS;
