//! Where one ball was at each instant of a shot: its motions one after the other.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::{
    ball::{BallBody, BallPose, BallState, Phase},
    motion::Motion,
    orientation::Turning,
};

/// The course of one ball over a shot, exact between events.
#[derive(Clone, Debug)]
pub(crate) struct Track {
    number: u8,
    body: BallBody,
    /// Ascending starts; the last lasts to the end.
    pieces: Vec<Piece>,
    /// When the last leg ends.
    end_secs: f64,
    gone: Option<(f64, Phase)>,
}

/// Constant accelerations from one instant on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Leg {
    pub(crate) start_secs: f64,
    pub(crate) phase: Phase,
    pub(crate) position: DVec3,
    pub(crate) velocity: DVec3,
    pub(crate) acceleration: DVec3,
    pub(crate) spin: DVec3,
    pub(crate) spin_acceleration: DVec3,
}

impl Leg {
    pub(crate) fn of(start_secs: f64, motion: &Motion) -> Self {
        let Motion {
            phase,
            position,
            velocity,
            spin,
            acceleration,
            spin_acceleration,
            ..
        } = *motion;
        Self {
            start_secs,
            phase,
            position,
            velocity,
            acceleration,
            spin,
            spin_acceleration,
        }
    }

    pub(crate) fn at_rest(start_secs: f64, position: DVec3) -> Self {
        Self {
            start_secs,
            phase: Phase::Resting,
            position,
            velocity: DVec3::ZERO,
            acceleration: DVec3::ZERO,
            spin: DVec3::ZERO,
            spin_acceleration: DVec3::ZERO,
        }
    }

    /// All its numbers but the time.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = f64> {
        let vectors = [
            self.position,
            self.velocity,
            self.acceleration,
            self.spin,
            self.spin_acceleration,
        ];
        vectors.into_iter().flat_map(|vector| vector.to_array())
    }

    fn position_after(&self, t: f64) -> DVec3 {
        self.position + t * (self.velocity + 0.5 * t * self.acceleration)
    }

    fn velocity_after(&self, t: f64) -> DVec3 {
        self.velocity + t * self.acceleration
    }

    fn spin_after(&self, t: f64) -> DVec3 {
        self.spin + t * self.spin_acceleration
    }

    fn turning(&self, start: DQuat, duration_secs: f64) -> Turning {
        Turning::new(start, self.spin, self.spin_acceleration, duration_secs)
    }
}

#[derive(Clone, Debug)]
struct Piece {
    leg: Leg,
    turning: Turning,
}

impl Piece {
    /// A piece whose end is not known yet: how the ball turns is filled in when it is.
    fn open(leg: Leg, orientation: DQuat) -> Self {
        Self {
            leg,
            turning: leg.turning(orientation, 0.0),
        }
    }

    fn close(&mut self, end_secs: f64) -> DQuat {
        let duration = end_secs - self.leg.start_secs;
        self.turning = self.leg.turning(self.turning.start(), duration);
        self.turning.at(duration)
    }
}

impl Track {
    pub(crate) fn new(ball: &BallState, leg: Leg) -> Self {
        Self {
            number: ball.number,
            body: ball.body,
            pieces: vec![Piece::open(leg, ball.orientation)],
            end_secs: leg.start_secs,
            gone: None,
        }
    }

    /// Ends the current leg and begins the next; returns how the ball is turned there.
    pub(crate) fn push(&mut self, leg: Leg) -> DQuat {
        let orientation = match self.pieces.last_mut() {
            Some(last) => last.close(leg.start_secs),
            None => DQuat::IDENTITY,
        };
        if self
            .pieces
            .last()
            .is_some_and(|last| last.leg.start_secs == leg.start_secs)
        {
            self.pieces.pop();
        }
        self.pieces.push(Piece::open(leg, orientation));
        orientation
    }

    /// The ball is no longer on the table from now on.
    pub(crate) fn leave(&mut self, now: f64, phase: Phase) {
        self.gone = Some((now, phase));
    }

    pub(crate) fn finish(mut self, end_secs: f64) -> Self {
        let end = self.gone.map_or(end_secs, |(at, _)| at);
        self.end_secs = end;
        if let Some(last) = self.pieces.last_mut() {
            last.close(end);
        }
        self
    }

    /// Its legs, and how the ball is turned at the start of each.
    pub(crate) fn legs(&self) -> impl Iterator<Item = (Leg, DQuat)> {
        self.pieces
            .iter()
            .map(|piece| (piece.leg, piece.turning.start()))
    }

    /// When its last leg ends.
    pub(crate) fn end_secs(&self) -> f64 {
        self.end_secs
    }

    /// Of the ball.
    pub(crate) fn number(&self) -> u8 {
        self.number
    }

    /// Of the ball.
    pub(crate) fn body(&self) -> BallBody {
        self.body
    }

    /// When and how the ball went out of play.
    pub(crate) fn gone(&self) -> Option<(f64, Phase)> {
        self.gone
    }

    /// A track of what [`Track::legs`] gave: one leg at least, in the order of time.
    pub(crate) fn from_legs(
        (number, body): (u8, BallBody),
        legs: &[(Leg, DQuat)],
        end_secs: f64,
        gone: Option<(f64, Phase)>,
    ) -> Self {
        let ends = legs.iter().skip(1).map(|(leg, _)| leg.start_secs);
        let piece = |(&(leg, orientation), end): (&(Leg, DQuat), f64)| Piece {
            leg,
            turning: leg.turning(orientation, end - leg.start_secs),
        };
        Self {
            number,
            body,
            pieces: legs.iter().zip(ends.chain([end_secs])).map(piece).collect(),
            end_secs,
            gone,
        }
    }

    pub(crate) fn pose_at(&self, t: f64) -> BallPose {
        let (piece, since) = self.piece_at(t);
        BallPose {
            number: self.number,
            position: piece.leg.position_after(since),
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
            body: self.body,
            position,
            velocity: piece.leg.velocity_after(since),
            spin: piece.leg.spin_after(since),
            orientation: rotation,
            phase: piece.leg.phase,
        };
        if let Some((_, phase)) = self.gone.filter(|_| !on_table) {
            state = BallState {
                velocity: DVec3::ZERO,
                spin: DVec3::ZERO,
                phase,
                ..state
            };
        }
        state
    }

    fn piece_at(&self, t: f64) -> (&Piece, f64) {
        let t = self.gone.map_or(t, |(at, _)| t.min(at)).max(0.0);
        let next = self
            .pieces
            .partition_point(|piece| piece.leg.start_secs <= t);
        let piece = &self.pieces[next.saturating_sub(1)];
        (piece, t - piece.leg.start_secs)
    }
}
