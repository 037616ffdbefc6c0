//! The computer at the table: as a player, as an adviser, and in a person's place. It thinks beside the
//! window; what it does is seen, the cue turning to the shot before it strikes.

use carom_billiards::Result;
use carom_billiards::ai::{AiWorker, Decision, Skill};
use carom_billiards::game_match::Match;
use carom_billiards::physics::{Shot, Stroke};

use crate::camera::{smoothstep, wrap_rad};

use super::aim::Aim;

/// A decision in the making.
#[derive(Debug)]
pub(super) struct AiTurn {
    thinking: AiWorker,
    /// What it is for.
    pub(super) purpose: AiTask,
    skill: Skill,
}

/// What the computer thinks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AiTask {
    /// To play its own shot, or a person's who asked for it.
    Play,
    /// To tell a person.
    Advise,
}

impl AiTurn {
    /// The computer's own shot.
    ///
    /// # Errors
    /// Those of [`AiWorker::start`].
    pub(super) fn own(contest: &Match, skill: Skill) -> Result<Self> {
        let thinking = AiWorker::start(contest.position(), skill, contest.draw_seed())?;
        Ok(Self {
            thinking,
            purpose: AiTask::Play,
            skill,
        })
    }

    /// A person's shot.
    ///
    /// # Errors
    /// Those of [`Match::start_hint`].
    pub(super) fn for_person(contest: &Match, purpose: AiTask) -> Result<Self> {
        Ok(Self {
            thinking: contest.start_hint()?,
            purpose,
            skill: Match::hint_skill(),
        })
    }

    /// The decision, once it is made.
    ///
    /// # Errors
    /// Those of [`AiWorker::poll`].
    pub(super) fn poll(&self) -> Result<Option<(Decision, Skill)>> {
        let decision = self.thinking.poll()?;
        Ok(decision.map(|decision| (decision, self.skill)))
    }

    /// Takes the best of what was found so far.
    pub(super) fn hurry(&self) {
        self.thinking.finish_now();
    }
}

/// A shot of the computer's on its way to the blow.
#[derive(Debug)]
pub(super) struct PlannedStroke {
    pub(super) stroke: Stroke,
    pub(super) shot: Shot,
    /// What it is to do, a sentence.
    pub(super) intention: String,
    since_secs: f64,
    from: Aim,
    to: Aim,
}

impl PlannedStroke {
    /// From where the cue points at `now_secs`.
    pub(super) fn new(
        (stroke, shot): (Stroke, Shot),
        intention: String,
        from: Aim,
        now_secs: f64,
    ) -> Self {
        Self {
            to: Aim::of(&stroke),
            stroke,
            shot,
            intention,
            since_secs: now_secs,
            from,
        }
    }

    /// Where the cue points at `now_secs`.
    pub(super) fn aim(&self, now_secs: f64) -> Aim {
        let s = smoothstep((now_secs - self.since_secs) / TURN_SECS);
        let mix = |a: f64, b: f64| a + (b - a) * s;
        let turned = wrap_rad(self.to.bearing_rad - self.from.bearing_rad);
        Aim {
            bearing_rad: wrap_rad(self.from.bearing_rad + turned * s),
            tip: self.from.tip.lerp(self.to.tip, s),
            elevation_rad: mix(self.from.elevation_rad, self.to.elevation_rad),
            power: mix(self.from.power, self.to.power),
            ..self.to
        }
    }

    /// The share of the way back that the cue is drawn; none before it is.
    pub(super) fn drawn(&self, now_secs: f64) -> Option<f64> {
        let share = (now_secs - self.since_secs - TURN_SECS - REST_SECS) / DRAW_SECS;
        (share > 0.0).then(|| smoothstep(share))
    }

    /// Whether the cue is drawn back and the blow is due.
    pub(super) fn is_due(&self, now_secs: f64) -> bool {
        now_secs - self.since_secs >= PLAN_SECS
    }

    /// Makes the blow due at `now_secs`.
    pub(super) fn hurry(&mut self, now_secs: f64) {
        self.since_secs = self.since_secs.min(now_secs - PLAN_SECS);
    }
}

/// The cue turns to the shot, rests there and is drawn back: long enough to read the intention, of some
/// eight words, and to see the ball and the pocket.
const TURN_SECS: f64 = 1.0;
const REST_SECS: f64 = 1.2;
const DRAW_SECS: f64 = 0.6;
const PLAN_SECS: f64 = TURN_SECS + REST_SECS + DRAW_SECS;
