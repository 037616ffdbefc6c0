//! The names of the ways to divide frames: what settings, command lines and results call them.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::Error;

/// How a frame's tiles are divided among nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Algorithm {
    /// `equal`: the same number of tiles for each node.
    Equal,
    /// `naive`: in proportion to each node's last speed, tiles by response time.
    Naive,
    /// `naive_mean`: the same with the mean of all its speeds so far.
    NaiveMean,
    /// `naive_frozen`: the same with the mean of its first 60 speeds, for ever.
    NaiveFrozen,
    /// `ab`: y = A + B·x with averages over the whole run, after 60 frames of
    /// [`Algorithm::Equal`].
    Ab,
    /// `ab_exponential`: the same with averages that forget.
    AbExponential,
    /// `cycles`: each share is moved by a part of its distance from the mean time, until all times
    /// are within two per cent of it.
    Cycles,
    /// `pull`: nodes hold a few tiles, as many as the round trip needs, and get more as they
    /// deliver.
    Pull,
    /// `water_filling`: y = A + B·w with filtered A and B, the earliest common finish.
    #[default]
    WaterFilling,
    /// `own`: the application's, which [`crate::Farm::set_balancer`] is given. It cannot be chosen by
    /// name.
    Own,
}

/// What of a frame is divided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Distribution {
    /// `tiles`: each node traces all samples of its part of the picture. Each pixel crosses the
    /// network once.
    #[default]
    Tiles,
    /// `samples`: each node traces other samples of the whole picture, merged as they come: whatever
    /// is there early is the whole picture with more noise, and a node that is lost costs noise until
    /// others have traced its samples. Costs the bytes of the picture once for each node, at most 16
    /// times. Frames that cannot be merged (sRGB, denoised, of one sample) are divided by tiles.
    Samples,
}

/// An algorithm, with or without hedging. Its name is the algorithm's, with `_hedged` at the end
/// if it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Balancing {
    /// Divides frames.
    pub algorithm: Algorithm,
    /// Whether tiles that are late are asked of other nodes too. Costs under 2 % of the work
    /// again; without it a frame waits for its slowest node.
    pub hedged: bool,
}

impl Algorithm {
    /// All that can be chosen by name, the simplest first.
    pub const ALL: [Self; 9] = [
        Self::Equal,
        Self::Naive,
        Self::NaiveMean,
        Self::NaiveFrozen,
        Self::Ab,
        Self::AbExponential,
        Self::Cycles,
        Self::Pull,
        Self::WaterFilling,
    ];

    /// What it is called everywhere.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Equal => "equal",
            Self::Naive => "naive",
            Self::NaiveMean => "naive_mean",
            Self::NaiveFrozen => "naive_frozen",
            Self::Ab => "ab",
            Self::AbExponential => "ab_exponential",
            Self::Cycles => "cycles",
            Self::Pull => "pull",
            Self::WaterFilling => "water_filling",
            Self::Own => "own",
        }
    }

    /// With hedging.
    pub const fn hedged(self) -> Balancing {
        Balancing {
            algorithm: self,
            hedged: true,
        }
    }

    /// Without.
    pub const fn unhedged(self) -> Balancing {
        Balancing {
            algorithm: self,
            hedged: false,
        }
    }
}

impl Balancing {
    /// All of them: each algorithm without and with hedging.
    pub fn all() -> impl Iterator<Item = Self> {
        let both = |algorithm: Algorithm| [algorithm.unhedged(), algorithm.hedged()];
        Algorithm::ALL.into_iter().flat_map(both)
    }
}

/// Water-filling with hedging.
impl Default for Balancing {
    fn default() -> Self {
        Algorithm::WaterFilling.hedged()
    }
}

impl Distribution {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Tiles, Self::Samples];

    /// What it is called everywhere.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tiles => "tiles",
            Self::Samples => "samples",
        }
    }
}

impl fmt::Display for Distribution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Distribution {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let named = Self::ALL.into_iter().find(|of| of.name() == text);
        named.ok_or(Error::Choice("tiles or samples"))
    }
}

impl fmt::Display for Balancing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.algorithm.name())?;
        f.write_str(if self.hedged { HEDGED } else { "" })
    }
}

impl FromStr for Balancing {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        Self::all()
            .find(|balancing| balancing.to_string() == text)
            .ok_or_else(|| Error::UnknownBalancer {
                name: text.to_owned(),
                known: Algorithm::ALL.map(Algorithm::name).join(", "),
                hedged: HEDGED,
            })
    }
}

impl TryFrom<String> for Balancing {
    type Error = Error;

    fn try_from(text: String) -> Result<Self, Error> {
        text.parse()
    }
}

impl From<Balancing> for String {
    fn from(balancing: Balancing) -> Self {
        balancing.to_string()
    }
}

/// The end of a name.
const HEDGED: &str = "_hedged";
