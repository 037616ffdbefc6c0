//! Contacts of several balls at the same instant.
//!
//! Resolved one after the other they would break the symmetry of a rack, as the first would change the
//! approach of the second. Resolved together they follow Moreau's law of impact: the velocities nearest
//! to those before, in the metric of kinetic energy, at which no pair approaches, are the inelastic
//! result; restitution goes beyond it by e times the same change (Moreau, "Unilateral contact and dry
//! friction in finite freedom dynamics", 1988). It is Newton's law for one contact, conserves momentum,
//! and gains no energy for e ≤ 1. The order of the contacts decides nothing but round-off.

use glam::DVec3;

use super::{
    ball::BallBody,
    ball_ball::{BallBallLaw, Twist},
};
use crate::deterministic_math::exp;

/// A contact of two balls, by their indices in a list of twists.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ClusterContact {
    pub(crate) first: usize,
    pub(crate) second: usize,
    /// Unit vector from the first centre to the second.
    pub(crate) normal: DVec3,
}

impl BallBallLaw {
    /// Sets the twists of balls to those after all `touches`, which all approach.
    pub(crate) fn resolve_together(
        &self,
        bodies: &[BallBody],
        touches: &[ClusterContact],
        twists: &mut [Twist],
    ) {
        let before: Vec<_> = twists.iter().map(|twist| twist.velocity).collect();
        let pushes = inelastic(bodies, touches, twists);
        for (twist, before) in twists.iter_mut().zip(before) {
            twist.velocity += self.restitution * (twist.velocity - before);
        }
        let count = touches.len() as f64;
        let drags: Vec<_> = touches
            .iter()
            .zip(pushes)
            .map(|(touch, push)| {
                self.drag(
                    bodies,
                    touch,
                    twists,
                    // Coulomb's limit is that of the whole normal impulse: of compression, and e times
                    // as much.
                    (1.0 + self.restitution) * push,
                    count,
                )
            })
            .collect();
        for (touch, drag) in touches.iter().zip(drags) {
            // A solid ball's moment of inertia is ⅖ m r². The spins of both change in the same sense,
            // as arm and impulse both have opposite signs.
            let turn = 2.5 * touch.normal.cross(drag);
            for (ball, way) in [(touch.first, 1.0), (touch.second, -1.0)] {
                let BallBody { mass_kg, radius_m } = bodies[ball];
                twists[ball].velocity += way / mass_kg * drag;
                twists[ball].spin += turn / (mass_kg * radius_m);
            }
        }
    }

    /// Impulse of friction on the first ball of a contact. Each of `count` contacts takes at most its
    /// share of what would stop its slip. All of them together are then the mean of changes that gain
    /// no energy, and so gain none (kinetic energy is convex).
    fn drag(
        &self,
        bodies: &[BallBody],
        touch: &ClusterContact,
        twists: &[Twist],
        push: f64,
        count: f64,
    ) -> DVec3 {
        let surface = |ball: usize, way: f64| {
            let arm = way * bodies[ball].radius_m * touch.normal;
            twists[ball].velocity + twists[ball].spin.cross(arm)
        };
        let contact = surface(touch.first, 1.0) - surface(touch.second, -1.0);
        let slip = contact.reject_from_normalized(touch.normal);
        let speed = slip.length();
        if speed == 0.0 {
            return DVec3::ZERO;
        }
        let friction =
            self.friction_fast + self.friction_slow_extra * exp(-self.friction_fade_s_m * speed);
        // An impulse changes a ball's slip by 1/m through its centre and by 5/2 · 1/m through its spin.
        let stops = speed / (3.5 * lightness(bodies, touch) * count);
        -(friction * push).min(stops) / speed * slip
    }
}

/// Moves the velocities to those at which no pair approaches and returns the impulses, by
/// projected Gauss–Seidel: the velocities that it converges to do not depend on the order.
fn inelastic(bodies: &[BallBody], touches: &[ClusterContact], twists: &mut [Twist]) -> Vec<f64> {
    let mut pushes = vec![0.0f64; touches.len()];
    for _ in 0..SWEEPS_MAX {
        let mut change = 0.0f64;
        for (touch, push) in touches.iter().zip(&mut pushes) {
            let ClusterContact {
                first,
                second,
                normal,
            } = *touch;
            let approach = (twists[first].velocity - twists[second].velocity).dot(normal);
            // The accumulated impulse is clamped, not the increment: a sweep may take back what an
            // earlier one gave in excess, otherwise the result would depend on the order.
            let next = (*push + approach / lightness(bodies, touch)).max(0.0);
            let by = next - *push;
            *push = next;
            twists[first].velocity -= by / bodies[first].mass_kg * normal;
            twists[second].velocity += by / bodies[second].mass_kg * normal;
            change = change.max(by.abs() / next.max(f64::MIN_POSITIVE));
        }
        if change < CONVERGED {
            break;
        }
    }
    pushes
}

/// Sum of 1/m of the two balls.
fn lightness(bodies: &[BallBody], touch: &ClusterContact) -> f64 {
    1.0 / bodies[touch.first].mass_kg + 1.0 / bodies[touch.second].mass_kg
}

/// Maximum sweeps: a rack of fifteen converges in a few hundred.
const SWEEPS_MAX: u32 = 5_000;
/// Largest relative change of an impulse in a sweep at convergence.
const CONVERGED: f64 = 1e-14;
