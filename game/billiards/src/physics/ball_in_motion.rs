//! State of one ball during a shot.

use glam::DVec3;

use super::{
    ball::{BallBody, BallState, Phase},
    ball_ball::Twist,
    contact_time::QuadraticPath,
    flight::Flight,
    laws::Laws,
    motion::{Motion, MotionEnd},
    static_contact::Obstacle,
    table::Table,
    trajectory::{Segment, Trajectory},
};

/// A ball during a shot.
pub(crate) struct BallInMotion {
    pub(crate) number: u8,
    pub(crate) body: BallBody,
    /// The centre now, in m.
    pub(crate) position: DVec3,
    pub(crate) motion: Motion,
    /// Start of the motion, in s.
    pub(crate) since_secs: f64,
    pub(crate) on_table: bool,
    /// Last contact with an obstacle: time in s, obstacle, and direction away from it.
    pub(crate) touched: Option<(f64, Obstacle, DVec3)>,
    trajectory: Trajectory,
}

impl BallInMotion {
    pub(crate) fn new(table: &Table, laws: &Laws, state: &BallState) -> Self {
        let BallState {
            number,
            body,
            position,
            velocity,
            spin,
            phase,
            ..
        } = *state;
        let on_table = phase.is_on_table();
        let twist = Twist { velocity, spin };
        let mut motion = if phase == Phase::Airborne {
            let flight = Flight {
                table,
                gravity_m_s2: laws.cloth.gravity_m_s2,
                radius_m: body.radius_m,
            };
            flight.motion(position, twist)
        } else {
            laws.cloth.motion(&body, position, twist)
        };
        if !on_table {
            motion.freeze();
        }
        let mut trajectory = Trajectory::new(state, Segment::of(0.0, &motion));
        if !on_table {
            trajectory.leave(0.0, phase);
        }
        Self {
            number,
            body,
            position,
            motion,
            since_secs: 0.0,
            on_table,
            touched: None,
            trajectory,
        }
    }

    /// Advances the centre by `step` from `now`.
    pub(crate) fn advance(&mut self, now: f64, step: f64) {
        if !self.is_moving() {
            return;
        }
        let t = now - self.since_secs;
        // The velocity at the middle of a step is its mean, so that the sum of steps is as exact as
        // `position_at`. The two differ in the last bit, and stored matches depend on the bits of the
        // sum: a break amplifies one bit to millimetres.
        self.position = if step < STEP_LEAST_SECS {
            self.motion.position_at(t + step)
        } else {
            self.position + self.motion.velocity_at(t + 0.5 * step) * step
        };
    }

    /// Begins the next motion, from where the ball is.
    pub(crate) fn set_off(&mut self, now: f64, motion: Motion) {
        self.motion = motion;
        self.since_secs = now;
        self.trajectory.push(Segment::of(now, &motion));
    }

    /// The ball is out of play from now on.
    pub(crate) fn take_away(&mut self, now: f64, phase: Phase) {
        self.on_table = false;
        self.motion.freeze();
        self.trajectory.leave(now, phase);
    }

    pub(crate) fn finish(self, end_secs: f64) -> Trajectory {
        self.trajectory.finish(end_secs)
    }

    /// Whether its state changes without a contact.
    pub(crate) fn is_moving(&self) -> bool {
        self.motion.is_moving()
    }

    /// Whether it can touch others: not once it is removed or falls to the floor.
    pub(crate) fn is_in_play(&self) -> bool {
        self.on_table && self.motion.end != MotionEnd::HitsFloor
    }

    /// Whether it lies on a rail.
    pub(crate) fn is_on_rail(&self) -> bool {
        self.motion.phase != Phase::Airborne
            && self.motion.position.z > ON_RAIL_RADII * self.body.radius_m
    }

    pub(crate) fn path(&self, now: f64) -> QuadraticPath {
        QuadraticPath::after(&self.motion, now - self.since_secs)
    }

    /// Remaining duration of the motion, in s.
    pub(crate) fn rest_of_motion(&self, now: f64) -> f64 {
        (self.since_secs + self.motion.duration_secs - now).max(0.0)
    }

    pub(crate) fn twist(&self, now: f64) -> Twist {
        let t = now - self.since_secs;
        Twist {
            velocity: self.motion.velocity_at(t),
            spin: self.motion.spin_at(t),
        }
    }
}

/// Height of the centre in radii above which a ball is not on the cloth: rails are about as high as a
/// ball's centre.
pub(crate) const ON_RAIL_RADII: f64 = 1.5;
/// Step in s below which the position is evaluated from the motion itself: the cue ball of the
/// strongest stroke, at 31 m/s, moves 31 nm in this time.
const STEP_LEAST_SECS: f64 = 1e-9;
