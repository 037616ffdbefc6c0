//! Turns of the computer: as a player, as an adviser, and in place of a person. The search runs on a
//! thread; the shot is animated, with the cue turning to it before it strikes.

use carom_billiards::Result;
use carom_billiards::ai::{AiWorker, Decision, Skill};
use carom_billiards::game_match::Match;
use carom_billiards::physics::{Shot, Stroke};

use crate::camera::{smoothstep, wrap_rad};

use super::aim::Aim;

/// A running search for a shot.
#[derive(Debug)]
pub(super) struct AiTurn {
    thinking: AiWorker,
    /// Purpose of the search.
    pub(super) purpose: AiTask,
    skill: Skill,
}

/// Purpose of a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AiTask {
    /// Play the shot, the computer's own or one requested by a person.
    Play,
    /// Suggest the shot to a person.
    Advise,
}

impl AiTurn {
    /// Starts a search for the computer's own shot.
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

    /// Starts a search for a person's shot.
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

    /// The decision, once the search has finished.
    ///
    /// # Errors
    /// Those of [`AiWorker::poll`].
    pub(super) fn poll(&self) -> Result<Option<(Decision, Skill)>> {
        let decision = self.thinking.poll()?;
        Ok(decision.map(|decision| (decision, self.skill)))
    }

    /// Ends the search with the best shot found so far.
    pub(super) fn hurry(&self) {
        self.thinking.finish_now();
    }
}

/// The computer's shot, with the animation of the cue before it.
#[derive(Debug)]
pub(super) struct PlannedStroke {
    pub(super) stroke: Stroke,
    pub(super) shot: Shot,
    /// Sentence about the intended result.
    pub(super) intention: String,
    since_secs: f64,
    from: Aim,
    to: Aim,
}

impl PlannedStroke {
    /// An animation that begins at `now_secs` with the aim `from`.
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

    /// The aim at `now_secs`.
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

    /// Share of the cue's travel by which it is drawn back; none before it is.
    pub(super) fn drawn(&self, now_secs: f64) -> Option<f64> {
        let share = (now_secs - self.since_secs - TURN_SECS - REST_SECS) / DRAW_SECS;
        (share > 0.0).then(|| smoothstep(share))
    }

    /// Whether the cue is drawn back and the stroke is due.
    pub(super) fn is_due(&self, now_secs: f64) -> bool {
        now_secs - self.since_secs >= PLAN_SECS
    }

    /// Makes the stroke due at `now_secs`.
    pub(super) fn hurry(&mut self, now_secs: f64) {
        self.since_secs = self.since_secs.min(now_secs - PLAN_SECS);
    }
}

/// Times in which the cue turns to the shot, rests and is drawn back: long enough to read the intention,
/// about eight words, and to find the ball and the pocket.
const TURN_SECS: f64 = 1.0;
const REST_SECS: f64 = 1.2;
const DRAW_SECS: f64 = 0.6;
const PLAN_SECS: f64 = TURN_SECS + REST_SECS + DRAW_SECS;
