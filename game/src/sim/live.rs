//! One ball in the midst of a shot.

use glam::DQuat;

use super::{
    ball::{BallState, Phase},
    ball_ball::Twist,
    cloth::Motion,
    contact_time::Course,
    laws::Laws,
    track::{Leg, Track},
};

/// A ball in the midst of a shot.
pub(crate) struct Live {
    pub(crate) number: u8,
    pub(crate) motion: Motion,
    /// When the motion began.
    pub(crate) since_secs: f64,
    pub(crate) on_table: bool,
    track: Track,
}

impl Live {
    pub(crate) fn new(laws: &Laws, state: &BallState) -> Self {
        let BallState {
            number,
            position,
            velocity,
            spin,
            phase,
            ..
        } = *state;
        let on_table = phase.is_on_table();
        let mut motion = laws.cloth.motion(&laws.body, position, velocity, spin);
        if !on_table {
            motion.freeze();
        }
        let mut track = Track::new(state, Leg::of(0.0, &motion));
        if !on_table {
            track.leave(0.0, phase);
        }
        Self {
            number,
            motion,
            since_secs: 0.0,
            on_table,
            track,
        }
    }

    /// Begins the next motion; returns how the ball is turned there.
    pub(crate) fn set_off(&mut self, now: f64, motion: Motion) -> DQuat {
        self.motion = motion;
        self.since_secs = now;
        self.track.push(Leg::of(now, &motion))
    }

    /// The ball is out of play from now on.
    pub(crate) fn take_away(&mut self, now: f64, phase: Phase) {
        self.on_table = false;
        self.motion.freeze();
        self.track.leave(now, phase);
    }

    pub(crate) fn finish(self, end_secs: f64) -> Track {
        self.track.finish(end_secs)
    }

    /// Whether anything will happen to it if nothing touches it.
    pub(crate) fn is_moving(&self) -> bool {
        self.motion.is_moving()
    }

    pub(crate) fn course(&self, now: f64) -> Course {
        Course::after(&self.motion, now - self.since_secs)
    }

    /// How long the motion lasts from now on.
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
