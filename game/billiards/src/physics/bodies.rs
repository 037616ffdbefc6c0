//! The balls as rigid bodies of rapier.
//!
//! Rapier moves the balls from event to event and reports what touches what. Its solver leaves the
//! pairs governed by a billiards law alone ([`PhysicsHooks::filter_contact_pair`]): it takes the
//! normal of a contact before the touch, which bends cut shots by degrees at any fixed step. Each
//! step lands on an event, and the velocity handed to it is the mean over the step, with which
//! rapier's explicit step is exact for constant acceleration.

use glam::{DQuat, DVec3};
use rapier3d::prelude::{
    ActiveHooks, ColliderBuilder, PairFilterContext, PhysicsHooks, PhysicsWorld, RigidBodyBuilder,
    RigidBodyHandle, SolverFlags,
};

use super::{ball::BallState, ball_ball::Twist, motion::Motion, table::Table};

pub(crate) struct Bodies {
    world: PhysicsWorld,
    balls: Vec<RigidBodyHandle>,
}

/// Contacts are computed and reported, but not solved.
struct LawGoverned;

impl PhysicsHooks for LawGoverned {
    fn filter_contact_pair(&self, _pair: &PairFilterContext) -> Option<SolverFlags> {
        Some(SolverFlags::empty())
    }
}

impl Bodies {
    pub(crate) fn new(table: &Table, balls: &[BallState]) -> Self {
        let mut world = PhysicsWorld {
            gravity: DVec3::ZERO,
            ..Default::default()
        };
        let parameters = &mut world.integration_parameters;
        parameters.num_solver_iterations = 1;
        // Steps end at contacts, so that there is nothing to sweep for.
        parameters.max_ccd_substeps = 0;
        parameters.length_unit = table.ball().radius_m;
        parameters.normalized_max_linear_velocity = f64::MAX;
        for shape in cushion_shapes(table) {
            world.insert_collider(shape, None);
        }
        let balls = balls
            .iter()
            .map(|ball| insert_ball(&mut world, ball))
            .collect();
        Self { world, balls }
    }

    /// Moves every ball by `step` seconds from time `t` of its motion.
    pub(crate) fn advance<'a>(
        &mut self,
        step: f64,
        motions: impl Iterator<Item = (&'a Motion, f64)>,
    ) {
        for (&handle, (motion, t)) in self.balls.iter().zip(motions) {
            let ball = &mut self.world.bodies[handle];
            if !motion.is_moving() {
                continue;
            }
            if step < STEP_LEAST_SECS {
                ball.set_translation(motion.position_at(t + step), true);
            } else {
                ball.set_linvel(motion.velocity_at(t + 0.5 * step), true);
            }
        }
        if step >= STEP_LEAST_SECS {
            self.world.integration_parameters.dt = step;
            self.world.step_with_events(&LawGoverned, &());
        }
    }

    /// Sets the twist with which a ball's next motion begins, and how it is turned: rapier
    /// linearises rotation, which would be off by radians over a long step.
    pub(crate) fn set_twist(&mut self, ball: usize, twist: Twist, orientation: DQuat) {
        let body = &mut self.world.bodies[self.balls[ball]];
        body.set_rotation(orientation, true);
        body.set_linvel(twist.velocity, true);
        body.set_angvel(twist.spin, true);
    }

    /// Puts the centre of a ball that has come to lie on a level surface at its exact height.
    pub(crate) fn set_height(&mut self, ball: usize, height_m: f64) {
        let body = &mut self.world.bodies[self.balls[ball]];
        let place = body.translation().with_z(height_m);
        body.set_translation(place, true);
    }

    /// Puts the centre of a ball somewhere else.
    pub(crate) fn set_place(&mut self, ball: usize, place: DVec3) {
        self.world.bodies[self.balls[ball]].set_translation(place, true);
    }

    /// Takes a ball out of play.
    pub(crate) fn remove(&mut self, ball: usize) {
        self.world.bodies[self.balls[ball]].set_enabled(false);
    }

    pub(crate) fn position(&self, ball: usize) -> DVec3 {
        self.world.bodies[self.balls[ball]].translation()
    }

    /// Distances over which rapier's narrow phase finds bodies near each other now; negative where
    /// they overlap.
    #[cfg(test)]
    pub(crate) fn contact_gaps_m(&mut self) -> Vec<f64> {
        // A step of no time only detects.
        self.world.integration_parameters.dt = 0.0;
        self.world.step_with_events(&LawGoverned, &());
        let pairs = self.world.contact_pairs();
        pairs
            .filter_map(|pair| Some(pair.find_deepest_contact()?.1.dist))
            .collect()
    }
}

fn insert_ball(world: &mut PhysicsWorld, ball: &BallState) -> RigidBodyHandle {
    let rigid = RigidBodyBuilder::dynamic()
        .translation(ball.position)
        .linvel(ball.velocity)
        .angvel(ball.spin)
        .can_sleep(false)
        .allow_fast_rotation(true)
        .enabled(ball.phase.is_on_table());
    let sphere = ColliderBuilder::ball(ball.body.radius_m)
        .mass(ball.body.mass_kg)
        .active_hooks(ActiveHooks::FILTER_CONTACT_PAIRS);
    world.insert(rigid, sphere).0
}

/// Blocks behind the noses and posts in the jaws.
pub(crate) fn cushion_shapes(table: &Table) -> Vec<ColliderBuilder> {
    let half_height = 0.5 * table.nose_height_m();
    let blocks = table.noses().iter().map(|nose| {
        let along = nose.to() - nose.from();
        let middle = nose.from() + 0.5 * along - CUSHION_HALF_DEPTH_M * nose.normal();
        ColliderBuilder::cuboid(0.5 * along.length(), CUSHION_HALF_DEPTH_M, half_height)
            .translation(middle.extend(half_height))
            .rotation(DVec3::Z * along.to_angle())
    });
    let posts = table.jaws().iter().map(|jaw| {
        ColliderBuilder::cylinder(half_height, jaw.radius_m)
            .translation(jaw.center.extend(half_height))
            .rotation(DVec3::X * std::f64::consts::FRAC_PI_2)
    });
    blocks.chain(posts).collect()
}

/// Shorter steps are taken without rapier, whose solver divides by the step. A ball moves 20 nm in
/// this time at the fastest.
const STEP_LEAST_SECS: f64 = 1e-9;
/// Behind its nose a cushion is a block of twice this depth.
const CUSHION_HALF_DEPTH_M: f64 = 0.005;
