//! Two-way coupling of balls: impulses between a ball and the nodes whose particles touch it.
//!
//! Projected Gauss–Seidel on sequential impulses (Catto 2005, "Iterative dynamics with temporal
//! coherence"): each contact in turn makes its node stop moving into the ball, and what the node gains
//! the ball loses, to the last bit of the sums. So light balls under heavy nodes stay stable.

use glam::{DVec3, Vec3};

use crate::body::{Ball, Bodies};
use crate::grid::{place, stop};
use crate::storage::NodeBlock;

/// A node whose particles touch a ball.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact {
    node: usize,
    ball: usize,
    /// From the ball's centre to the node, in m.
    arm: DVec3,
    /// Away from the ball.
    normal: DVec3,
    /// At which they part if they overlap.
    parting_m_s: f64,
    mass_kg: f64,
    friction: f64,
    /// Impulse on the node along the normal so far, in kg·m/s.
    push: f64,
    /// Impulse on the node along the surface so far, in kg·m/s.
    drag: DVec3,
}

/// Rounds over all contacts; the last changes impulses by less than a hundredth.
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

    /// Changes the impulses so that the node neither moves into the ball nor slides on it against
    /// Coulomb's law, and returns the node's velocity then.
    fn resolve(&mut self, ball: &mut Ball, velocity: DVec3) -> DVec3 {
        let normal = self.normal;
        let surface = ball.velocity + ball.angular_velocity.cross(self.arm);
        let relative = velocity - surface;
        let inverse_masses = 1.0 / self.mass_kg + 1.0 / ball.mass_kg;
        let lever = self.arm.cross(normal).length_squared() / ball.moment_of_inertia();
        let approach = relative.dot(normal) - self.parting_m_s;
        let push = (self.push - approach / (inverse_masses + lever)).max(0.0);
        let slip = relative - normal * relative.dot(normal);
        // The longest lever that there can be: the step is never too large.
        let inverse_inertia = self.arm.length_squared() / ball.moment_of_inertia();
        let drag = self.drag - slip / (inverse_masses + inverse_inertia);
        // By the push of all rounds: Coulomb's bound holds for the substep, not for a round.
        let drag = drag.clamp_length_max(self.friction * push);
        let impulse = normal * (push - self.push) + (drag - self.drag);
        self.push = push;
        self.drag = drag;
        ball.kick(-impulse, -self.arm.cross(impulse));
        velocity + impulse / self.mass_kg
    }
}

/// Resolves the contacts of all nodes with balls.
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
    // A ball must not push particles through an obstacle.
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
