//! The two groups of 8-ball.

use carom_text::text;

/// A player's seven balls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BallGroup {
    /// 1 to 7.
    Solids,
    /// 9 to 15.
    Stripes,
}

impl BallGroup {
    /// The group of a ball; none of the 8 and the cue ball.
    pub fn of(ball: u8) -> Option<Self> {
        match ball {
            1..=7 => Some(Self::Solids),
            9..=15 => Some(Self::Stripes),
            _ => None,
        }
    }

    /// The other group.
    #[must_use]
    pub fn other(self) -> Self {
        match self {
            Self::Solids => Self::Stripes,
            Self::Stripes => Self::Solids,
        }
    }

    /// Its name.
    pub fn display_text(self) -> &'static str {
        match self {
            Self::Solids => text!("group-solids"),
            Self::Stripes => text!("group-stripes"),
        }
    }

    /// Its symbol: a full disc, or a disc with a band.
    pub fn glyph(self) -> &'static str {
        match self {
            Self::Solids => "●",
            Self::Stripes => "◍",
        }
    }
}
