//! Names of the ways to divide frames, as used in settings, command lines and results.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::Error;

/// How a frame's tiles are divided among nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Algorithm {
    /// `equal`: the same number of tiles for each node.
    Equal,
    /// `naive`: in proportion to each node's last speed, its tiles by its response time.
    Naive,
    /// `naive_mean`: the same with the mean of all its speeds so far.
    NaiveMean,
    /// `naive_frozen`: the same with the mean of its first 60 speeds.
    NaiveFrozen,
    /// `ab`: y = A + B·x with averages over all requests, after 60 frames of [`Algorithm::Equal`].
    Ab,
    /// `ab_exponential`: the same with exponential averages.
    AbExponential,
    /// `cycles`: each node's time moves a part of its distance towards the mean, until all times are within
    /// two per cent of it.
    Cycles,
    /// `pull`: nodes hold as many tiles as the round trip needs, and pull more as they deliver.
    Pull,
    /// `water_filling`: y = A + B·w with filtered A and B, divided for the earliest common finish.
    #[default]
    WaterFilling,
    /// `own`: the application's balancer, set by [`crate::Farm::set_balancer`]. It cannot be chosen by
    /// name.
    Own,
}

/// Dimension in which a frame is divided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Distribution {
    /// `tiles`: each node traces all samples of its part of the picture. Each pixel crosses the
    /// network once.
    #[default]
    Tiles,
    /// `samples`: each node traces different samples of the whole picture, merged as they arrive: a partial
    /// result is the whole picture with more noise, and a lost node costs noise until others have traced
    /// its samples. Transfers the picture once per pass, at most 16 times. Frames that cannot be merged
    /// (sRGB, denoised, or with one sample) are divided by tiles.
    Samples,
}

/// An algorithm, with or without hedging. Its name is the algorithm's, followed by `_hedged` if it is
/// hedged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Balancing {
    /// Algorithm that divides frames.
    pub algorithm: Algorithm,
    /// Whether late tiles are requested from other nodes too. This repeats under 2 % of the work; without
    /// it a frame waits for its slowest node.
    pub hedged: bool,
}

impl Algorithm {
    /// All algorithms that can be chosen by name, the simplest first.
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

    /// The name in settings, command lines and results.
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

    /// This algorithm with hedging.
    pub const fn hedged(self) -> Balancing {
        Balancing {
            algorithm: self,
            hedged: true,
        }
    }

    /// This algorithm without hedging.
    pub const fn unhedged(self) -> Balancing {
        Balancing {
            algorithm: self,
            hedged: false,
        }
    }
}

impl Balancing {
    /// All combinations: each algorithm without and with hedging.
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
    /// Both distributions.
    pub const ALL: [Self; 2] = [Self::Tiles, Self::Samples];

    /// The name in settings, command lines and results.
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

/// Suffix of the names of hedged algorithms.
const HEDGED: &str = "_hedged";
