//! The simulation of one shot by rapier alone, at a fixed step: cloth, cushions and balls are rigid
//! bodies with restitution and Coulomb friction, and rapier's solver resolves the contacts.
//!
//! It is the other end of the trade between speed and accuracy, and what a game gets from a general
//! engine. What such an engine cannot do is left wrong (the contact normal of a fast cut, throw, frozen
//! racks). Two forces that it lacks are added, as no shot would end without them: rolling resistance
//! and the friction against spin about the vertical.

use std::collections::BTreeSet;

use glam::{DVec2, DVec3};
use rapier3d::prelude::{
    CoefficientCombineRule, ColliderBuilder, IntegrationParameters, PhysicsWorld, RigidBodyBuilder,
    RigidBodyHandle, SharedShape,
};

use crate::{Error, Result};

use super::{
    ball::{BallBody, BallState, Phase},
    ball_in_motion::ON_RAIL_RADII,
    cloth::Cloth,
    engine::Rapier,
    event::{Event, EventKind},
    event_engine::{OnProgress, SHOT_SECS_MAX, SimulatedShot, Until},
    laws::Laws,
    table::{Pocket, Table},
    trajectory::{Segment, Trajectory},
};
use crate::deterministic_math::{angle_of, exp};

pub(crate) struct RapierEngine<'a> {
    table: &'a Table,
    laws: &'a Laws,
    world: PhysicsWorld,
    balls: Vec<RigidBall>,
    step_secs: f64,
    steps: u64,
    steps_max: u64,
    /// Steps per segment of a trajectory.
    stride: u64,
    /// Pairs in contact: balls by index, cushions by [`CUSHION`].
    touching: BTreeSet<(usize, usize)>,
    events: Vec<Event>,
    cue_ball_touched: bool,
}

struct RigidBall {
    number: u8,
    body: BallBody,
    handle: RigidBodyHandle,
    on_table: bool,
    trajectory: Trajectory,
    /// Start time and position of the segment that is not recorded yet.
    segment_start: (f64, DVec3),
    /// Whether the last recorded segment is one of rest.
    still: bool,
    /// Position and velocity before the step.
    before: (DVec3, DVec3),
}

impl<'a> RapierEngine<'a> {
    pub(crate) fn new(
        table: &'a Table,
        laws: &'a Laws,
        rapier: Rapier,
        states: &[BallState],
    ) -> Self {
        let step_secs = 1.0 / f64::from(rapier.steps_per_sec);
        let mut world = PhysicsWorld {
            gravity: -laws.cloth.gravity_m_s2 * DVec3::Z,
            integration_parameters: IntegrationParameters {
                dt: step_secs,
                num_solver_iterations: rapier.solver_iterations as usize,
                contact_recycling: rapier.recycle_contacts,
                ..Default::default()
            },
            ..Default::default()
        };
        insert_table(&mut world, table, laws);
        let insert = |(index, state)| insert_ball(&mut world, laws, rapier, index, state);
        let balls = states.iter().enumerate().map(insert).collect();
        Self {
            table,
            laws,
            world,
            balls,
            step_secs,
            steps: 0,
            steps_max: (SHOT_SECS_MAX / step_secs) as u64,
            stride: ((SEGMENT_SECS / step_secs) as u64).max(1),
            touching: BTreeSet::new(),
            events: Vec::new(),
            cue_ball_touched: false,
        }
    }

    /// Simulates until the end that `until` names.
    ///
    /// # Errors
    /// [`Error::Endless`] beyond [`SHOT_SECS_MAX`].
    pub(crate) fn run(
        mut self,
        until: Until,
        on_progress: OnProgress<'_>,
    ) -> Result<SimulatedShot> {
        while self.step()? {
            on_progress(self.now());
            if until == Until::CueBallContact && self.cue_ball_touched {
                break;
            }
        }
        Ok(self.finish())
    }

    /// Simulated time in s.
    pub(crate) fn now(&self) -> f64 {
        self.steps as f64 * self.step_secs
    }

    /// Takes one step; false if all balls are at rest.
    pub(crate) fn step(&mut self) -> Result<bool> {
        if !self.resist() {
            return Ok(false);
        }
        if self.steps >= self.steps_max {
            return Err(Error::Endless {
                time_secs: self.now(),
                events: self.events.len() as u32,
            });
        }
        self.world.step();
        self.steps += 1;
        self.report_contacts();
        self.take_away_lost();
        if self.steps.is_multiple_of(self.stride) {
            self.record();
        }
        Ok(true)
    }

    pub(crate) fn finish(mut self) -> SimulatedShot {
        self.record();
        let end_secs = self.now();
        SimulatedShot {
            trajectories: self
                .balls
                .into_iter()
                .map(|ball| ball.trajectory.finish(end_secs))
                .collect(),
            events: self.events,
            end_secs,
        }
    }

    /// Applies rolling resistance and spin friction of the coming step, and stops balls that are slower
    /// than what a step takes away. Returns whether any ball moves.
    fn resist(&mut self) -> bool {
        let Laws { cloth, .. } = self.laws;
        let slower = cloth.rolling_friction * cloth.gravity_m_s2 * self.step_secs;
        // Slip that one step of sliding friction removes: the solver leaves a residue below this.
        let rolls =
            (3.5 * cloth.sliding_friction * cloth.gravity_m_s2 * self.step_secs).max(ROLLS_M_S);
        let upright = LIES_M_S + 2.0 * cloth.gravity_m_s2 * self.step_secs;
        let mut moves = false;
        for ball in self.balls.iter_mut().filter(|ball| ball.on_table) {
            let body = &ball.body;
            let spin_slower = 2.5 * cloth.spin_friction_m * cloth.gravity_m_s2
                / body.radius_m.powi(2)
                * self.step_secs;
            let rigid = &mut self.world.bodies[ball.handle];
            let (position, velocity, spin) = (rigid.translation(), rigid.linvel(), rigid.angvel());
            ball.before = (position, velocity);
            let rolling = DVec2::new(spin.x, spin.y).length() * body.radius_m;
            let lies = position.z < body.radius_m + LIES_M && velocity.z.abs() < upright;
            if lies && velocity.truncate().length().max(rolling) < slower.max(REST_M_S) {
                let turning = toward_zero(spin.z, spin_slower);
                moves |= turning != 0.0;
                rigid.set_linvel(DVec3::new(0.0, 0.0, velocity.z), false);
                rigid.set_angvel(DVec3::new(0.0, 0.0, turning), turning != 0.0);
                continue;
            }
            moves = true;
            let speed = velocity.truncate().length();
            let slip = Cloth::slip(body, velocity, spin).truncate().length();
            if lies && slip < rolls + SUNK * speed {
                let left = toward_zero(speed, slower) / speed.max(f64::MIN_POSITIVE);
                rigid.set_linvel(velocity * DVec3::new(left, left, 1.0), true);
                let spin = DVec3::new(left * spin.x, left * spin.y, spin.z);
                rigid.set_angvel(spin, true);
            }
            if lies {
                let spin = rigid.angvel();
                rigid.set_angvel(spin.with_z(toward_zero(spin.z, spin_slower)), true);
            }
        }
        moves
    }

    /// Reports events of pairs that the solver pushed apart in this step and not in the one before.
    fn report_contacts(&mut self) {
        let mut touching = BTreeSet::new();
        for pair in self.world.narrow_phase.contact_pairs() {
            let [a, b] = [pair.collider1, pair.collider2]
                .map(|handle| self.world.colliders[handle].user_data as usize);
            let key = (a.min(b), a.max(b));
            // `CLOTH` and `CUSHION` are greater than the index of any ball.
            if key.1 == CLOTH {
                continue;
            }
            let least = self.balls[key.0].body.mass_kg * CONTACT_M_S;
            if pair.total_impulse_magnitude() > least {
                touching.insert(key);
            }
        }
        let begun: Vec<_> = touching.difference(&self.touching).copied().collect();
        for (low, high) in begun {
            // From before the step, as the solver has changed the velocities already.
            let (position, velocity) = self.balls[low].before;
            let kind = if high == CUSHION {
                let change = self.velocity(low) - velocity;
                let away = change.normalize_or_zero();
                EventKind::Cushion {
                    ball: self.balls[low].number,
                    point: position - self.balls[low].body.radius_m * away,
                    speed_m_s: -velocity.dot(away),
                }
            } else {
                let (other, other_velocity) = self.balls[high].before;
                EventKind::BallBall {
                    first: self.balls[low].number,
                    second: self.balls[high].number,
                    point: position.midpoint(other),
                    speed_m_s: (velocity - other_velocity)
                        .dot((other - position).normalize_or_zero()),
                }
            };
            self.report(kind);
        }
        self.touching = touching;
    }

    /// Removes balls whose path over this step led into a pocket or off the table.
    fn take_away_lost(&mut self) {
        for index in 0..self.balls.len() {
            let RigidBall {
                number,
                handle,
                on_table,
                before: (from, velocity),
                ..
            } = self.balls[index];
            if !on_table {
                continue;
            }
            let to = self.world.bodies[handle].translation();
            let low = to.z < ON_RAIL_RADII * self.balls[index].body.radius_m;
            let enters = |pocket: &Pocket| {
                let (from, to) = (
                    from.truncate() - pocket.center,
                    to.truncate() - pocket.center,
                );
                low && nearest_to_origin(from, to) < pocket.radius_m
            };
            let phase = if let Some(pocket) = self.table.pockets().iter().position(enters) {
                self.report(EventKind::Pocketed {
                    ball: number,
                    pocket,
                    speed_m_s: velocity.length(),
                });
                Phase::Pocketed
            } else if !self.table.contains(to.truncate()) || to.z < 0.0 {
                self.report(EventKind::LeftTable {
                    ball: number,
                    point: to,
                    speed_m_s: velocity.length(),
                });
                Phase::OffTable
            } else {
                continue;
            };
            self.record_ball(index);
            let now = self.now();
            let ball = &mut self.balls[index];
            ball.on_table = false;
            ball.trajectory.leave(now, phase);
            self.world.bodies[handle].set_enabled(false);
        }
    }

    fn record(&mut self) {
        for index in 0..self.balls.len() {
            if self.balls[index].on_table {
                self.record_ball(index);
            }
        }
    }

    /// Records the straight segment from the end of the last one to the current position.
    fn record_ball(&mut self, index: usize) {
        let now = self.now();
        let ball = &mut self.balls[index];
        let body = &self.world.bodies[ball.handle];
        let (since, from) = ball.segment_start;
        let position = body.translation();
        let is_still = position.distance(from) < STILL_M && body.angvel() == DVec3::ZERO;
        if is_still && ball.still {
            ball.segment_start.0 = now;
        } else if now > since {
            ball.still = is_still;
            let velocity = (position - from) / (now - since);
            let spin = body.angvel();
            ball.trajectory.push(Segment {
                start_secs: since,
                phase: phase(&ball.body, velocity, spin),
                position: from,
                velocity,
                acceleration: DVec3::ZERO,
                spin,
                spin_acceleration: DVec3::ZERO,
            });
            ball.segment_start = (now, position);
        }
    }

    fn velocity(&self, ball: usize) -> DVec3 {
        self.world.bodies[self.balls[ball].handle].linvel()
    }

    fn report(&mut self, kind: EventKind) {
        self.cue_ball_touched |= kind.stops_aim_line();
        self.events.push(Event {
            time_secs: self.now(),
            kind,
        });
    }
}

fn insert_table(world: &mut PhysicsWorld, table: &Table, laws: &Laws) {
    // Maximum and minimum, so that the table's coefficients hold, not means with the balls'.
    let cloth = ColliderBuilder::new(SharedShape::halfspace(DVec3::Z))
        .friction(laws.cloth.sliding_friction)
        .friction_combine_rule(CoefficientCombineRule::Max)
        .restitution(0.0)
        .restitution_combine_rule(CoefficientCombineRule::Min)
        .user_data(CLOTH as u128);
    world.insert_collider(cloth, None);
    for shape in cushion_shapes(table) {
        let cushion = shape
            .friction(laws.cushion.friction)
            .friction_combine_rule(CoefficientCombineRule::Max)
            .restitution(LEVEL_RESTITUTION * laws.cushion.restitution)
            .restitution_combine_rule(CoefficientCombineRule::Min)
            .user_data(CUSHION as u128);
        world.insert_collider(cushion, None);
    }
}

/// Blocks behind the noses and posts in the jaws.
fn cushion_shapes(table: &Table) -> Vec<ColliderBuilder> {
    let half_height = 0.5 * table.nose_height_m();
    let blocks = table.noses().iter().map(|nose| {
        let along = nose.to() - nose.from();
        let middle = nose.from() + 0.5 * along - CUSHION_HALF_DEPTH_M * nose.normal();
        ColliderBuilder::cuboid(0.5 * along.length(), CUSHION_HALF_DEPTH_M, half_height)
            .translation(middle.extend(half_height))
            .rotation(DVec3::Z * angle_of(along))
    });
    let posts = table.jaws().iter().map(|jaw| {
        // The engine's cylinders stand along y.
        ColliderBuilder::cylinder(half_height, jaw.radius_m)
            .translation(jaw.center.extend(half_height))
            .rotation(DVec3::X * std::f64::consts::FRAC_PI_2)
    });
    blocks.chain(posts).collect()
}

fn insert_ball(
    world: &mut PhysicsWorld,
    laws: &Laws,
    rapier: Rapier,
    index: usize,
    state: &BallState,
) -> RigidBall {
    let on_table = state.phase.is_on_table();
    let rigid = RigidBodyBuilder::dynamic()
        .translation(state.position)
        .linvel(state.velocity)
        .angvel(state.spin)
        .allow_fast_rotation(rapier.fast_rotation)
        .ccd_enabled(rapier.sweep_cue_ball && state.number == 0)
        .enabled(on_table);
    let law = &laws.ball_ball;
    let sphere = ColliderBuilder::ball(state.body.radius_m)
        .mass(state.body.mass_kg)
        // As at a slip of 1 m/s: the engine knows no friction that depends on speed.
        .friction(law.friction_fast + law.friction_slow_extra * exp(-law.friction_fade_s_m))
        .restitution(law.restitution)
        .user_data(index as u128);
    let handle = world.insert(rigid, sphere).0;
    // Rapier lets bodies sleep below 0.4 m/s·size: a slow roll would stop dead.
    let sleep = world.bodies[handle].activation_mut();
    sleep.normalized_linear_threshold = SLEEP_M_S;
    sleep.angular_threshold = SLEEP_M_S / state.body.radius_m;
    let mut trajectory = Trajectory::new(state, Segment::at_rest(0.0, state.position));
    if !on_table {
        trajectory.leave(0.0, state.phase);
    }
    RigidBall {
        number: state.number,
        body: state.body,
        handle,
        on_table,
        trajectory,
        segment_start: (0.0, state.position),
        still: false,
        before: (state.position, state.velocity),
    }
}

fn phase(body: &BallBody, velocity: DVec3, spin: DVec3) -> Phase {
    if velocity.length() > REST_M_S {
        if Cloth::slip(body, velocity, spin).length() < ROLLS_M_S {
            Phase::Rolling
        } else {
            Phase::Sliding
        }
    } else if spin.length() * body.radius_m > REST_M_S {
        Phase::Spinning
    } else {
        Phase::Resting
    }
}

fn toward_zero(value: f64, by: f64) -> f64 {
    value.signum() * (value.abs() - by).max(0.0)
}

/// Distance of a segment from the origin.
fn nearest_to_origin(from: DVec2, to: DVec2) -> f64 {
    let along = to - from;
    let s = (-from.dot(along) / along.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    (from + s * along).length()
}

/// Duration of a straight segment, or one step if that is longer.
const SEGMENT_SECS: f64 = 5e-3;
/// Movement within a segment below which it counts as at rest.
const STILL_M: f64 = 1e-9;
/// Stands for cushions in place of a ball's index.
const CUSHION: usize = usize::MAX - 1;
/// Stands for the cloth in place of a ball's index.
const CLOTH: usize = usize::MAX;
/// Change of a ball's speed below which a push is no event, as between balls that lie in contact.
const CONTACT_M_S: f64 = 5e-3;
/// Share of its restitution that a cushion has seen from above, as its nose is above the ball's centre:
/// 0.72 to 0.75 of 0.85 with the default law.
const LEVEL_RESTITUTION: f64 = 0.87;
/// Minimum of the slip below which a ball rolls.
const ROLLS_M_S: f64 = 0.01;
/// Speed below which a ball is at rest.
const REST_M_S: f64 = 1e-3;
const SLEEP_M_S: f64 = 1e-4;
/// Relative slip of a ball that still rolls: at long steps a fast ball sinks into the cloth, and rolls
/// on a radius smaller by as much.
const SUNK: f64 = 0.15;
/// A ball lies on the cloth if its centre is no higher than this over its radius, ...
const LIES_M: f64 = 2e-3;
/// ... and rises or falls no faster than this and what gravity does in two steps.
const LIES_M_S: f64 = 0.05;
/// Half the depth of the block that a cushion is behind its nose.
const CUSHION_HALF_DEPTH_M: f64 = 0.005;

#[cfg(test)]
mod tests {
    use rapier3d::prelude::{ActiveHooks, PairFilterContext, PhysicsHooks, SolverFlags};

    use super::*;
    use crate::physics::{Stroke, World};

    /// Contacts are computed, but not solved.
    struct DetectOnly;

    impl PhysicsHooks for DetectOnly {
        fn filter_contact_pair(&self, _pair: &PairFilterContext) -> Option<SolverFlags> {
            Some(SolverFlags::empty())
        }
    }

    /// Distances of things near each other, by rapier's narrow phase; negative where they overlap.
    fn contact_gaps_m(table: &Table, balls: &[BallState]) -> Vec<f64> {
        let mut world = PhysicsWorld {
            gravity: DVec3::ZERO,
            ..Default::default()
        };
        world.integration_parameters.length_unit = table.ball().radius_m;
        // A step of no time only detects.
        world.integration_parameters.dt = 0.0;
        for shape in cushion_shapes(table) {
            world.insert_collider(shape, None);
        }
        for ball in balls.iter().filter(|ball| ball.phase.is_on_table()) {
            let rigid = RigidBodyBuilder::dynamic().translation(ball.position);
            let sphere = ColliderBuilder::ball(ball.body.radius_m)
                .active_hooks(ActiveHooks::FILTER_CONTACT_PAIRS);
            world.insert(rigid, sphere);
        }
        world.step_with_events(&DetectOnly, &());
        let pairs = world.contact_pairs();
        pairs
            .filter_map(|pair| Some(pair.find_deepest_contact()?.1.dist))
            .collect()
    }

    /// Contact times come from polynomials, of which the narrow phase knows nothing.
    #[test]
    fn narrow_phase_sees_contacts_of_exact_engine() {
        let table = Table::nine_foot();
        let world = World::new(table.clone(), table.rack_eight(9)).unwrap();
        let shot = world.strike(Stroke::straight(0.01, 9.0)).unwrap();
        let mut contacts = 0;
        for event in shot.events() {
            let gaps = contact_gaps_m(&table, &shot.states_at(event.time_secs));
            let deepest = gaps.into_iter().fold(f64::INFINITY, f64::min);
            assert!(deepest > -1e-9, "{event:?}: an overlap of {deepest} m");
            if matches!(event.kind, EventKind::BallBall { .. }) {
                assert!(deepest < 1e-9, "{event:?}: {deepest} m apart");
                contacts += 1;
            }
        }
        assert!(contacts > 20, "{contacts} contacts");
    }
}
