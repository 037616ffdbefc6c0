//! Contacts of several balls at the same instant.
//!
//! Taken one after the other they would break the symmetry of a rack: the first would leave the
//! second less to do. Together they are Moreau's law of impact: the velocities nearest to those
//! before, in the metric of kinetic energy, at which no pair approaches, are where the balls would
//! stay if nothing bounced; restitution goes on beyond them by e times as much again (Moreau,
//! "Unilateral contact and dry friction in finite freedom dynamics", 1988). It is Newton's law for
//! one contact, keeps momentum, and gains no energy for e ≤ 1. Which contact is first decides
//! nothing but round-off.

use glam::DVec3;

use super::{
    ball::BallBody,
    ball_ball::{BallBallLaw, Twist},
};
use crate::deterministic_math::exp;

/// Two balls in touch, by their place in a list of twists.
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
                    // Friction is bounded by the whole impulse along the normal: of compression, and e
                    // times as much.
                    (1.0 + self.restitution) * push,
                    count,
                )
            })
            .collect();
        for (touch, drag) in touches.iter().zip(drags) {
            // A solid ball's moment of inertia is ⅖ m r². The spins of both change alike, as the arm and
            // the impulse have opposite signs at either.
            let turn = 2.5 * touch.normal.cross(drag);
            for (ball, way) in [(touch.first, 1.0), (touch.second, -1.0)] {
                let BallBody { mass_kg, radius_m } = bodies[ball];
                twists[ball].velocity += way / mass_kg * drag;
                twists[ball].spin += turn / (mass_kg * radius_m);
            }
        }
    }

    /// Impulse of friction on the first ball of a touch. Each of `count` touches takes at most its
    /// share of what would stop its slip, so that all of them together gain no energy: they are the
    /// mean of changes that gain none.
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
        // An impulse changes a ball's slip by 1/m through its centre and by 5/2 · 1/m through its turn.
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
            // The impulse so far is kept from being a pull, not the step: a sweep may take back what one
            // before it gave too much, without which the result would depend on the order.
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

/// 1/m of the first ball and of the second.
fn lightness(bodies: &[BallBody], touch: &ClusterContact) -> f64 {
    1.0 / bodies[touch.first].mass_kg + 1.0 / bodies[touch.second].mass_kg
}

/// A rack of fifteen converges in a few hundred.
const SWEEPS_MAX: u32 = 5_000;
/// Relative change of every impulse in a sweep.
const CONVERGED: f64 = 1e-14;
