//! The style of the table and its balls, as the player chooses it.

use carom_billiards::rules::RuleSet;
use clap::ValueEnum;
use glam::Vec3;

use crate::scene::ball_materials::BallSet;

/// The colour of the cloth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ClothColour {
    /// The game's own: blue, and green for snooker
    #[default]
    Tournament,
    /// Tournament blue
    Blue,
    /// Green
    Green,
    /// Burgundy
    Red,
    /// Slate grey
    Grey,
}

impl ClothColour {
    /// Albedo of the cloth on a table of `rules`.
    pub fn albedo(self, rules: RuleSet) -> Vec3 {
        match self {
            Self::Tournament if rules == RuleSet::Snooker => Self::Green.albedo(rules),
            Self::Tournament | Self::Blue => Vec3::new(0.022, 0.115, 0.235),
            Self::Green => Vec3::new(0.028, 0.15, 0.068),
            Self::Red => Vec3::new(0.2, 0.026, 0.034),
            Self::Grey => Vec3::new(0.1, 0.108, 0.12),
        }
    }
}

/// What the player chooses of a table's look.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TableStyle {
    /// Material of the balls.
    pub balls: BallSet,
    /// Colour of the cloth.
    pub cloth: ClothColour,
}

impl From<BallSet> for TableStyle {
    fn from(balls: BallSet) -> Self {
        Self {
            balls,
            ..Self::default()
        }
    }
}
