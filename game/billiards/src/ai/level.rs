//! The computer's levels of strength, by name.

use carom_text::text;
use serde::{Deserialize, Serialize};

/// How well the computer plays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// Misses most shots that are not straight in
    Easy,
    /// Pots easy shots, and sometimes two in a row
    #[default]
    Medium,
    /// Pots most shots and thinks of the next
    Hard,
    /// Hardly misses
    Expert,
}

impl Level {
    /// All levels, weakest first.
    pub const ALL: [Self; 4] = [Self::Easy, Self::Medium, Self::Hard, Self::Expert];

    /// Its name on the command line and in results.
    pub fn key(self) -> &'static str {
        match self {
            Self::Easy => "easy",
            Self::Medium => "medium",
            Self::Hard => "hard",
            Self::Expert => "expert",
        }
    }

    /// Its name.
    pub fn display_text(self) -> &'static str {
        match self {
            Self::Easy => text!("level-easy"),
            Self::Medium => text!("level-medium"),
            Self::Hard => text!("level-hard"),
            Self::Expert => text!("level-expert"),
        }
    }
}
