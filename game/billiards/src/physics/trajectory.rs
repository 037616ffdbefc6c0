//! The trajectory of one ball over a shot: its consecutive motions.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::{
    ball::{BallBody, BallPose, BallState, Phase},
    motion::Motion,
    orientation::RotationIntegral,
};

/// Trajectory of one ball over a shot, exact between events.
#[derive(Clone, Debug)]
pub(crate) struct Trajectory {
    number: u8,
    body: BallBody,
    /// By ascending start; the last extends to `end_secs`.
    segments: Vec<OrientedSegment>,
    /// End of the last segment, in s.
    end_secs: f64,
    gone: Option<(f64, Phase)>,
}

/// Constant accelerations from one instant on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Segment {
    pub(crate) start_secs: f64,
    pub(crate) phase: Phase,
    pub(crate) position: DVec3,
    pub(crate) velocity: DVec3,
    pub(crate) acceleration: DVec3,
    pub(crate) spin: DVec3,
    pub(crate) spin_acceleration: DVec3,
}

impl Segment {
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

    /// All numbers except the time.
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

    pub(crate) fn position_after(&self, t: f64) -> DVec3 {
        self.position + t * (self.velocity + 0.5 * t * self.acceleration)
    }

    fn velocity_after(&self, t: f64) -> DVec3 {
        self.velocity + t * self.acceleration
    }

    fn spin_after(&self, t: f64) -> DVec3 {
        self.spin + t * self.spin_acceleration
    }

    fn rotation(&self, start: DQuat, duration_secs: f64) -> RotationIntegral {
        RotationIntegral::new(start, self.spin, self.spin_acceleration, duration_secs)
    }
}

#[derive(Clone, Debug)]
struct OrientedSegment {
    segment: Segment,
    rotation: RotationIntegral,
}

impl OrientedSegment {
    /// A segment whose end is not known yet; [`OrientedSegment::close`] computes its rotation.
    fn open(segment: Segment, orientation: DQuat) -> Self {
        Self {
            segment,
            rotation: segment.rotation(orientation, 0.0),
        }
    }

    fn close(&mut self, end_secs: f64) -> DQuat {
        let duration = end_secs - self.segment.start_secs;
        self.rotation = self.segment.rotation(self.rotation.start(), duration);
        self.rotation.at(duration)
    }
}

impl Trajectory {
    pub(crate) fn new(ball: &BallState, segment: Segment) -> Self {
        Self {
            number: ball.number,
            body: ball.body,
            segments: vec![OrientedSegment::open(segment, ball.orientation)],
            end_secs: segment.start_secs,
            gone: None,
        }
    }

    /// Ends the current segment and begins the next.
    pub(crate) fn push(&mut self, segment: Segment) {
        // The rotation is integrated once the segment's length is known, and carried over to the next.
        let orientation = match self.segments.last_mut() {
            Some(last) => last.close(segment.start_secs),
            None => DQuat::IDENTITY,
        };
        let is_same_instant =
            |last: &mut OrientedSegment| last.segment.start_secs == segment.start_secs;
        // Several events at one instant leave segments of no duration; only the last of them is
        // visible.
        self.segments.pop_if(is_same_instant);
        self.segments
            .push(OrientedSegment::open(segment, orientation));
    }

    /// Marks the ball as no longer on the table from `now` on.
    pub(crate) fn leave(&mut self, now: f64, phase: Phase) {
        self.gone = Some((now, phase));
    }

    pub(crate) fn finish(mut self, end_secs: f64) -> Self {
        let end = self.gone.map_or(end_secs, |(at, _)| at);
        self.end_secs = end;
        if let Some(last) = self.segments.last_mut() {
            last.close(end);
        }
        self
    }

    /// Segments, with the orientation at the start of each.
    pub(crate) fn segments(&self) -> impl Iterator<Item = (Segment, DQuat)> {
        self.segments
            .iter()
            .map(|piece| (piece.segment, piece.rotation.start()))
    }

    /// End of the last segment, in s.
    pub(crate) fn end_secs(&self) -> f64 {
        self.end_secs
    }

    /// Number of the ball.
    pub(crate) fn number(&self) -> u8 {
        self.number
    }

    /// Body of the ball.
    pub(crate) fn body(&self) -> BallBody {
        self.body
    }

    /// Time in s and phase in which the ball went out of play.
    pub(crate) fn gone(&self) -> Option<(f64, Phase)> {
        self.gone
    }

    /// Rebuilds a trajectory from what [`Trajectory::segments`] gave: at least one segment, in the
    /// order of time.
    pub(crate) fn from_segments(
        (number, body): (u8, BallBody),
        segments: &[(Segment, DQuat)],
        end_secs: f64,
        gone: Option<(f64, Phase)>,
    ) -> Self {
        let ends = segments
            .iter()
            .skip(1)
            .map(|(segment, _)| segment.start_secs);
        let piece = |(&(segment, orientation), end): (&(Segment, DQuat), f64)| OrientedSegment {
            segment,
            rotation: segment.rotation(orientation, end - segment.start_secs),
        };
        Self {
            number,
            body,
            segments: segments
                .iter()
                .zip(ends.chain([end_secs]))
                .map(piece)
                .collect(),
            end_secs,
            gone,
        }
    }

    pub(crate) fn pose_at(&self, t: f64) -> BallPose {
        let (piece, since) = self.segment_at(t);
        BallPose {
            number: self.number,
            position: piece.segment.position_after(since),
            rotation: piece.rotation.at(since),
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
        let (piece, since) = self.segment_at(t);
        let mut state = BallState {
            number,
            body: self.body,
            position,
            velocity: piece.segment.velocity_after(since),
            spin: piece.segment.spin_after(since),
            orientation: rotation,
            phase: piece.segment.phase,
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

    fn segment_at(&self, t: f64) -> (&OrientedSegment, f64) {
        // A ball that is gone keeps its last position.
        let t = self.gone.map_or(t, |(at, _)| t.min(at)).max(0.0);
        let next = self
            .segments
            .partition_point(|piece| piece.segment.start_secs <= t);
        let piece = &self.segments[next.saturating_sub(1)];
        (piece, t - piece.segment.start_secs)
    }
}
