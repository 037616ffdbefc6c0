//! The verdict of a referee on a shot.

use carom_text::text;
use serde::{Deserialize, Serialize};

use super::{foul::Foul, layout::BallPositions};

/// Verdict of a referee on a shot, or on a choice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdict {
    /// The fouls, the gravest first.
    pub fouls: Vec<Foul>,
    /// The course of the shot and its consequences, a sentence each, in order. One that begins with a
    /// small letter is about the player of the shot, whose name goes before it.
    pub lines: Vec<String>,
    /// Balls to be put on the table, in this order: spotted balls, the cue ball in hand.
    pub moves: BallPositions,
    /// The seed of a new rack, if the balls are racked again.
    pub rack: Option<u32>,
    /// Points of the player who played.
    pub points: i32,
    /// The object balls that were potted as the rules want it.
    pub pots: Vec<u8>,
    /// Whether the cue balls change places, 0 and 1: in carom each player has one, and that of the
    /// player at the table is 0.
    pub swaps_cue_balls: bool,
    /// Whether the same player goes on.
    pub goes_on: bool,
}

impl Verdict {
    /// Whether the shot was a foul.
    pub fn is_foul(&self) -> bool {
        !self.fouls.is_empty()
    }

    pub(crate) fn add_line(&mut self, line: impl Into<String>) {
        self.lines.push(line.into());
    }
}

/// A choice of the player at the table in place of simply playing on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Choice {
    /// To play the balls as they lie: what a stroke without a choice means.
    Accept,
    /// The other player has to play from here.
    Return,
    /// To have the balls racked, and break.
    Rerack,
    /// To have the balls racked, and let the other player break again.
    RerackReturn,
    /// To take the cue ball in hand.
    TakeInHand,
    /// To have balls that touch set up on their spots.
    SpotBalls,
}

impl Choice {
    /// Label of its button.
    pub fn display_text(self) -> &'static str {
        match self {
            Self::Accept => text!("choice-accept"),
            Self::Return => text!("choice-return"),
            Self::Rerack => text!("choice-rerack"),
            Self::RerackReturn => text!("choice-rerack-return"),
            Self::TakeInHand => text!("choice-take-in-hand"),
            Self::SpotBalls => text!("choice-spot-balls"),
        }
    }
}
