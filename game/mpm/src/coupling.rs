//! Two-way coupling of balls and particles: impulses between a ball and the nodes whose particles touch it.
//!
//! Projected Gauss–Seidel on sequential impulses (Catto 2005, "Iterative dynamics with temporal
//! coherence"): each contact in turn stops its node from moving into the ball by equal and opposite
//! impulses on both, so light balls under heavy nodes stay stable.

use glam::{DVec3, Vec3};

use crate::body::{Ball, Bodies};
use crate::grid::{place, stop};
use crate::storage::NodeBlock;

/// Contact of a ball with a node whose particles touch it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact {
    node: usize,
    ball: usize,
    /// From the ball's centre to the node, in m.
    arm: DVec3,
    /// Unit normal, away from the ball.
    normal: DVec3,
    /// Normal speed at which an overlap is separated.
    parting_m_s: f64,
    mass_kg: f64,
    friction: f64,
    /// Accumulated normal impulse on the node, in kg·m/s.
    push: f64,
    /// Accumulated tangential impulse on the node, in kg·m/s.
    drag: DVec3,
}

/// Gauss–Seidel iterations over all contacts; the last changes impulses by less than 1 %.
const ROUNDS: usize = 8;

impl Contact {
    pub(crate) fn new(
        node: usize,
        ball: usize,
        (arm, normal, parting_m_s): (DVec3, DVec3, f64),
        mass_kg: f32,
        friction: f32,
    ) -> Self {
        Self {
            node,
            ball,
            arm,
            normal,
            parting_m_s,
            mass_kg: mass_kg.into(),
            friction: friction.into(),
            push: 0.0,
            drag: DVec3::ZERO,
        }
    }

    /// Updates the accumulated impulses so that the node neither moves into the ball nor violates Coulomb's
    /// law, applies their changes to the ball, and returns the node's new velocity in m/s.
    fn resolve(&mut self, ball: &mut Ball, velocity: DVec3) -> DVec3 {
        let normal = self.normal;
        let surface = ball.velocity + ball.angular_velocity.cross(self.arm);
        let relative = velocity - surface;
        let inverse_masses = 1.0 / self.mass_kg + 1.0 / ball.mass_kg;
        let lever = self.arm.cross(normal).length_squared() / ball.moment_of_inertia();
        let approach = relative.dot(normal) - self.parting_m_s;
        // The accumulated impulse is clamped, not its change: an iteration may take back what an earlier
        // one gave.
        let push = (self.push - approach / (inverse_masses + lever)).max(0.0);
        let slip = relative - normal * relative.dot(normal);
        // |r|²/I bounds |r × t|²/I over all tangents t: the correction never overshoots.
        let inverse_inertia = self.arm.length_squared() / ball.moment_of_inertia();
        let drag = self.drag - slip / (inverse_masses + inverse_inertia);
        // Coulomb's bound holds for the accumulated impulses of the substep, not for one iteration's.
        let drag = drag.clamp_length_max(self.friction * push);
        let impulse = normal * (push - self.push) + (drag - self.drag);
        self.push = push;
        self.drag = drag;
        ball.kick(-impulse, -self.arm.cross(impulse));
        velocity + impulse / self.mass_kg
    }
}

/// Resolves the contacts of all nodes with balls, and updates the velocities of both.
pub(crate) fn resolve_contacts(nodes: &mut [NodeBlock], bodies: &mut Bodies, cell_size_m: f64) {
    let mut touched: Vec<_> = nodes
        .iter_mut()
        .filter(|node| !node.contacts.is_empty())
        .collect();
    for _ in 0..ROUNDS {
        for node in &mut touched {
            for index in 0..node.contacts.len() {
                let mut contact = node.contacts[index];
                let [x, y, z, _] = node.values[contact.node];
                let velocity = Vec3::new(x, y, z).as_dvec3();
                let ball = &mut bodies.balls[contact.ball];
                let velocity = contact.resolve(ball, velocity).as_vec3();
                node.values[contact.node] = velocity.extend(0.0).into();
                node.contacts[index] = contact;
            }
        }
    }
    // Obstacles have the last word: a ball must not push particles through them.
    for node in touched {
        for index in 0..node.contacts.len() {
            let contact = node.contacts[index];
            let at = place(node, contact.node, cell_size_m);
            let [x, y, z, _] = node.values[contact.node];
            let mut velocity = Vec3::new(x, y, z);
            for obstacle in &bodies.obstacles {
                let friction = contact.friction as f32;
                velocity = stop(obstacle, at, velocity, friction, cell_size_m);
            }
            node.values[contact.node] = velocity.extend(0.0).into();
        }
    }
}
