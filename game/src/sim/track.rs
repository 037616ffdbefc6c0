//! Where one ball was at each instant of a shot: its motions one after the other.

use glam::DQuat;

use super::{
    ball::{BallPose, BallState, Phase},
    cloth::Motion,
    orientation::Turning,
};

/// The course of one ball over a shot, exact between events.
#[derive(Clone, Debug)]
pub(crate) struct Track {
    number: u8,
    /// Ascending starts; the last lasts to the end.
    pieces: Vec<Piece>,
    gone: Option<(f64, Phase)>,
}

#[derive(Clone, Debug)]
struct Piece {
    start_secs: f64,
    motion: Motion,
    turning: Turning,
}

impl Piece {
    /// A piece whose end is not known yet: how the ball turns is filled in when it is.
    fn open(start_secs: f64, motion: Motion, orientation: DQuat) -> Self {
        let turning = Turning::new(orientation, motion.spin, motion.spin_acceleration, 0.0);
        Self {
            start_secs,
            motion,
            turning,
        }
    }

    fn close(&mut self, end_secs: f64) -> DQuat {
        let Motion {
            spin,
            spin_acceleration,
            ..
        } = self.motion;
        let duration = end_secs - self.start_secs;
        self.turning = Turning::new(self.turning.at(0.0), spin, spin_acceleration, duration);
        self.turning.at(duration)
    }
}

impl Track {
    pub(crate) fn new(number: u8, motion: Motion, orientation: DQuat) -> Self {
        Self {
            number,
            pieces: vec![Piece::open(0.0, motion, orientation)],
            gone: None,
        }
    }

    /// Ends the current motion and begins the next; returns how the ball is turned there.
    pub(crate) fn push(&mut self, now: f64, motion: Motion) -> DQuat {
        let orientation = match self.pieces.last_mut() {
            Some(last) => last.close(now),
            None => DQuat::IDENTITY,
        };
        if self
            .pieces
            .last()
            .is_some_and(|last| last.start_secs == now)
        {
            self.pieces.pop();
        }
        self.pieces.push(Piece::open(now, motion, orientation));
        orientation
    }

    /// The ball is no longer on the table from now on.
    pub(crate) fn leave(&mut self, now: f64, phase: Phase) {
        self.gone = Some((now, phase));
    }

    pub(crate) fn finish(mut self, end_secs: f64) -> Self {
        let end = self.gone.map_or(end_secs, |(at, _)| at);
        if let Some(last) = self.pieces.last_mut() {
            last.close(end);
        }
        self
    }

    pub(crate) fn pose_at(&self, t: f64) -> BallPose {
        let (piece, since) = self.piece_at(t);
        BallPose {
            number: self.number,
            position: piece.motion.position_at(since),
            rotation: piece.turning.at(since),
            on_table: self.gone.is_none_or(|(at, _)| t < at),
        }
    }

    pub(crate) fn state_at(&self, t: f64) -> BallState {
        let BallPose {
            number,
            position,
            rotation,
            on_table,
        } = self.pose_at(t);
        let (piece, since) = self.piece_at(t);
        let mut state = BallState {
            number,
            position,
            velocity: piece.motion.velocity_at(since),
            spin: piece.motion.spin_at(since),
            orientation: rotation,
            phase: piece.motion.phase,
        };
        if let Some((_, phase)) = self.gone.filter(|_| !on_table) {
            state = BallState {
                velocity: glam::DVec3::ZERO,
                spin: glam::DVec3::ZERO,
                phase,
                ..state
            };
        }
        state
    }

    fn piece_at(&self, t: f64) -> (&Piece, f64) {
        let t = self.gone.map_or(t, |(at, _)| t.min(at)).max(0.0);
        let next = self.pieces.partition_point(|piece| piece.start_secs <= t);
        let piece = &self.pieces[next.saturating_sub(1)];
        (piece, t - piece.start_secs)
    }
}
