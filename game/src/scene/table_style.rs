//! Look of the table and its balls, as chosen by the player.

use carom_billiards::rules::RuleSet;
use clap::ValueEnum;
use glam::Vec3;

use crate::particles::ParticleDetail;
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

/// The cue's woods.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum CueStyle {
    /// A maple shaft, a butt of dark rosewood
    #[default]
    Rosewood,
    /// A maple shaft, a butt of ebony
    Ebony,
    /// Ash from tip to butt, as snooker cues are
    Ash,
    /// A black carbon shaft, a butt stained blue
    Carbon,
}

impl CueStyle {
    /// Albedo of shaft and butt.
    pub fn albedos(self) -> [Vec3; 2] {
        let maple = Vec3::new(0.62, 0.44, 0.24);
        match self {
            Self::Rosewood => [maple, Vec3::new(0.055, 0.018, 0.012)],
            Self::Ebony => [maple, Vec3::new(0.016, 0.014, 0.013)],
            Self::Ash => [Vec3::new(0.55, 0.42, 0.27), Vec3::new(0.4, 0.28, 0.16)],
            Self::Carbon => [Vec3::splat(0.02), Vec3::new(0.012, 0.04, 0.14)],
        }
    }
}

/// The light of the room. All its lamps keep their proportions, so that this is the exposure of the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Brightness {
    /// Half the light, for dark rooms
    Dim,
    /// As the room is lit
    #[default]
    Normal,
    /// Half as much light again
    Bright,
    /// Twice the light, for displays in daylight
    Daylight,
}

impl Brightness {
    /// Factor on the normal radiance.
    pub fn factor(self) -> f32 {
        match self {
            Self::Dim => 0.5,
            Self::Normal => 1.0,
            Self::Bright => 1.5,
            Self::Daylight => 2.0,
        }
    }
}

/// The player's choices for the look of a table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TableStyle {
    /// Material of the balls.
    pub balls: BallSet,
    /// Colour of the cloth.
    pub cloth: ClothColour,
    /// Woods of the cue.
    pub cue: CueStyle,
    /// Light of the room.
    pub brightness: Brightness,
    /// Detail of dust.
    pub particles: ParticleDetail,
}

impl From<BallSet> for TableStyle {
    fn from(balls: BallSet) -> Self {
        Self {
            balls,
            ..Self::default()
        }
    }
}
