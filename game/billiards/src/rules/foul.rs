//! Fouls, with their reasons in words.

use carom_text::text;

use super::ruleset::RuleSet;

/// A foul, and the ball that it concerns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Foul {
    /// The cue ball fell into a pocket (WPA 6.1).
    Scratch,
    /// The cue ball was driven off the table (WPA 6.1).
    CueBallOff,
    /// The cue ball touched no ball (WPA 6.2).
    NoBallHit,
    /// The cue ball first touched a ball that was not on (WPA 6.2).
    WrongBall {
        /// The ball.
        hit: u8,
        /// The balls on, in words, to follow "legal was".
        on: String,
    },
    /// No ball was driven to a cushion after the contact (WPA 6.3).
    NoRail,
    /// An object ball was driven off the table (WPA 6.5).
    BallOff(u8),
    /// The tip met the cue ball twice (WPA 6.7).
    DoubleHit(u8),
    /// From behind the head string the cue ball first touched a ball that lies there, without having
    /// crossed the line (WPA 6.11).
    BehindHeadString(u8),
    /// The break drove too few balls to cushions (WPA 2.3, 4.3).
    WeakBreak {
        /// Number of object balls that were driven to a cushion.
        driven: usize,
        /// Number that is needed.
        needed: usize,
    },
    /// A ball that was not on was potted (WPBSA 10).
    WrongPot(u8),
    /// The cue ball jumped over a ball (WPBSA 10).
    Jump(u8),
    /// The cue ball was played into a ball that touched it (WPBSA 8; UMB 27).
    PushStroke(u8),
    /// The free ball and no other hides the ball on from the next player (WPBSA 12).
    FreeBallSnooker(u8),
}

impl Foul {
    /// The foul of driving this ball off the table.
    pub(crate) fn off_table(ball: u8) -> Self {
        match ball {
            0 => Self::CueBallOff,
            ball => Self::BallOff(ball),
        }
    }

    /// The reason, without a full stop, to follow "fouled: ".
    pub fn display_text(&self, rules: RuleSet) -> String {
        let name = |ball: &u8| rules.ball_name(*ball);
        match self {
            Self::Scratch => text!("foul-scratch").to_owned(),
            Self::CueBallOff => text!("foul-cue-ball-off").to_owned(),
            Self::NoBallHit => text!("foul-no-ball-hit").to_owned(),
            Self::WrongBall { hit, on } => {
                text!("foul-wrong-ball", hit = name(hit), on = on.as_str())
            }
            Self::NoRail => text!("foul-no-rail").to_owned(),
            Self::BallOff(ball) => text!("foul-ball-off", ball = name(ball)),
            Self::DoubleHit(ball) => text!("foul-double-hit", ball = name(ball)),
            Self::BehindHeadString(ball) => text!("foul-behind-head-string", ball = name(ball)),
            Self::WeakBreak { driven, needed } => {
                text!("foul-weak-break", driven = *driven, needed = *needed)
            }
            Self::WrongPot(ball) => text!("foul-wrong-pot", ball = name(ball)),
            Self::Jump(ball) => text!("foul-jump", ball = name(ball)),
            Self::PushStroke(ball) => text!("foul-push-stroke", ball = name(ball)),
            Self::FreeBallSnooker(ball) => text!("foul-free-ball-snooker", ball = name(ball)),
        }
    }
}
