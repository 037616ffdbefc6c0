//! First lessons: three instructions, each shown until it has been followed.

use carom_text::text;
use clap::ValueEnum;

use crate::input::{Action, AimIntent, Bindings, Intent, MatchIntent, StrokeIntent};

/// What a newcomer is taught next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Lesson {
    /// To point the cue.
    #[default]
    Aim,
    /// To strike.
    Strike,
    /// To let the computer suggest a shot, and play it.
    Suggest,
    /// Nothing more.
    Done,
}

impl Lesson {
    /// The instruction; none after the last lesson.
    pub fn sentence(self, bindings: &Bindings) -> Option<String> {
        // Only the first key is named.
        let key = |action| {
            let first = bindings.triggers(action).into_iter().next();
            first.map_or_else(|| bindings.words(action), |trigger| trigger.to_string())
        };
        let strike = key(Action::Strike);
        Some(match self {
            Self::Aim => text!("lesson-aim").to_owned(),
            Self::Strike => text!(
                "lesson-strike",
                stroke = key(Action::Stroke),
                strike = strike
            ),
            Self::Suggest => text!(
                "lesson-suggest",
                suggest = key(Action::Suggest),
                strike = strike
            ),
            Self::Done => return None,
        })
    }

    /// The lesson after an intent of the player; `is_suggested` says whether a suggestion was requested
    /// before it.
    #[must_use]
    pub fn after(self, intent: Intent, is_suggested: bool) -> Self {
        let strikes = matches!(
            intent,
            Intent::Stroke(StrokeIntent::Strike | StrokeIntent::Release)
        );
        match (self, intent) {
            (Self::Aim, Intent::Aim(AimIntent::Turn(_) | AimIntent::AimAt(_))) => Self::Strike,
            (Self::Aim | Self::Strike, _) if strikes => Self::Suggest,
            (Self::Suggest, _) if strikes && is_suggested => Self::Done,
            (Self::Suggest, Intent::Match(MatchIntent::TakeOver)) => Self::Done,
            (lesson, _) => lesson,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lessons_follow_each_other_as_they_are_done() {
        let strike = Intent::Stroke(StrokeIntent::Strike);
        let mut lesson = Lesson::default();
        for (intent, is_suggested, next) in [
            (Intent::Match(MatchIntent::Undo), false, Lesson::Aim),
            (Intent::Aim(AimIntent::Turn(0.1)), false, Lesson::Strike),
            (strike, false, Lesson::Suggest),
            (strike, false, Lesson::Suggest),
            (strike, true, Lesson::Done),
        ] {
            lesson = lesson.after(intent, is_suggested);
            assert_eq!(lesson, next, "after {intent:?}");
        }
        assert_eq!(lesson.sentence(&Bindings::default()), None);
    }
}
