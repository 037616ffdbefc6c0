//! Fouls, in words with the reason, and those that games have in common.

use serde::{Deserialize, Serialize};

use super::ruleset::RuleSet;

/// What a player did wrong.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
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
        /// What was on, in words, to follow "legal was".
        on: String,
    },
    /// No ball was driven to a cushion after the contact (WPA 6.3).
    NoRail,
    /// An object ball was driven off the table (WPA 6.5).
    BallOff {
        /// The ball.
        ball: u8,
    },
    /// The tip met the cue ball twice (WPA 6.7).
    DoubleHit {
        /// The ball that lay too near.
        ball: u8,
    },
    /// From behind the head string the cue ball first touched a ball that lies there, without having
    /// crossed the line (WPA 6.11).
    BehindHeadString {
        /// The ball.
        ball: u8,
    },
    /// The break drove too few balls to cushions (WPA 2.3, 4.3).
    WeakBreak {
        /// How many object balls were driven to a cushion.
        driven: usize,
        /// How many it takes.
        needed: usize,
    },
    /// A ball that was not on was potted (WPBSA 10).
    WrongPot {
        /// The ball.
        ball: u8,
    },
    /// The cue ball jumped over a ball (WPBSA 10).
    Jump {
        /// The ball.
        ball: u8,
    },
    /// The cue ball was played into a ball that touched it (WPBSA 8; UMB 27).
    PushStroke {
        /// The ball.
        ball: u8,
    },
    /// The free ball and no other hides the ball on from the next player (WPBSA 12).
    FreeBallSnooker {
        /// The ball.
        ball: u8,
    },
}

impl Foul {
    /// The reason, without a full stop, to follow "fouled: ".
    pub fn display_text(&self, rules: RuleSet) -> String {
        let name = |ball: &u8| rules.ball_name(*ball);
        match self {
            Self::Scratch => "the cue ball fell into a pocket".to_owned(),
            Self::CueBallOff => "the cue ball left the table".to_owned(),
            Self::NoBallHit => "the cue ball touched no ball".to_owned(),
            Self::WrongBall { hit, on } => {
                format!("{} was hit first; legal was {on}", name(hit))
            }
            Self::NoRail => "no ball reached a cushion after the contact".to_owned(),
            Self::BallOff { ball } => format!("{} left the table", name(ball)),
            Self::DoubleHit { ball } => {
                format!("the tip met the cue ball twice, so close to {}", name(ball))
            }
            Self::BehindHeadString { ball } => format!(
                "{} lies behind the head string, which the cue ball had to cross first",
                name(ball)
            ),
            Self::WeakBreak { driven, needed } => format!(
                "the break drove {driven} balls to a cushion; it takes {needed}, or a ball potted"
            ),
            Self::WrongPot { ball } => format!("{} was potted, and was not on", name(ball)),
            Self::Jump { ball } => format!("the cue ball jumped over {}", name(ball)),
            Self::PushStroke { ball } => {
                format!("the cue ball touched {} and was played into it", name(ball))
            }
            Self::FreeBallSnooker { ball } => {
                format!(
                    "the next player is snookered behind {}, the free ball",
                    name(ball)
                )
            }
        }
    }
}
