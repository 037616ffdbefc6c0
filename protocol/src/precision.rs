//! Precision of sRGB pixels: a ladder of levels from bit-exact to JPEG of quality 50.

use serde::{Deserialize, Serialize};

use crate::error::Reason;

/// Trade-off between exact pixels and few bytes, the finest level first. It applies to
/// [`crate::PixelFormat::Srgb8`]; linear formats are always exact.
///
/// Each level takes at least a tenth fewer bytes than the one before wherever the camera moves:
/// the table in [`crate::tile_codec`] has the figures.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum PixelPrecision {
    /// Each pixel bit for bit.
    #[default]
    Exact,
    /// Each channel within ±1 of 255, which is invisible; seven tenths of the bytes.
    Within1,
    /// Each channel within ±2 of 255: six tenths of the bytes.
    Within2,
    /// JPEG of quality 90 with full chroma resolution: a sixth of the bytes, 47 dB.
    Lossy90,
    /// JPEG of quality 75 with halved chroma resolution: a twelfth.
    Lossy75,
    /// JPEG of quality 50: blocks are visible. For links that carry nothing else.
    Lossy50,
}

impl PixelPrecision {
    /// All levels, the finest first.
    pub const ALL: [Self; 6] = [
        Self::Exact,
        Self::Within1,
        Self::Within2,
        Self::Lossy90,
        Self::Lossy75,
        Self::Lossy50,
    ];

    /// The quantisation step of a channel of 0 to 255; `None` for JPEG. Rounding to the nearest multiple of
    /// an odd step changes a value by at most (step − 1) / 2.
    pub(crate) const fn step(self) -> Option<u8> {
        match self {
            Self::Exact => Some(1),
            Self::Within1 => Some(3),
            Self::Within2 => Some(5),
            Self::Lossy90 | Self::Lossy75 | Self::Lossy50 => None,
        }
    }

    /// Whether it is a JPEG level, which bounds no single pixel's error.
    pub fn is_lossy(self) -> bool {
        self.step().is_none()
    }

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Within1 => "within1",
            Self::Within2 => "within2",
            Self::Lossy90 => "lossy90",
            Self::Lossy75 => "lossy75",
            Self::Lossy50 => "lossy50",
        }
    }

    /// The next finer level.
    pub fn finer(self) -> Option<Self> {
        Self::ALL.get((self as usize).checked_sub(1)?).copied()
    }

    /// The next coarser level.
    pub fn coarser(self) -> Option<Self> {
        Self::ALL.get(self as usize + 1).copied()
    }
}

/// Parses `exact`, `within1`, `within2`, `lossy90`, `lossy75` or `lossy50`, for command lines.
impl std::str::FromStr for PixelPrecision {
    type Err = Reason;

    fn from_str(text: &str) -> Result<Self, Reason> {
        let named = Self::ALL.iter().find(|precision| precision.name() == text);
        named.copied().ok_or_else(|| {
            let known = Self::ALL.map(Self::name).join(", ");
            format!("it must be one of {known}").into()
        })
    }
}

impl std::fmt::Display for PixelPrecision {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// Range of levels from which a node may choose, message by message, so that its link keeps up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct PrecisionRange {
    /// The level used while the link carries it.
    pub finest: PixelPrecision,
    /// The level used when the link is slowest.
    pub coarsest: PixelPrecision,
}

impl PrecisionRange {
    /// Exact pixels only.
    pub const EXACT: Self = Self::only(PixelPrecision::Exact);

    /// All levels.
    pub const ANY: Self = Self {
        finest: PixelPrecision::Exact,
        coarsest: PixelPrecision::Lossy50,
    };

    /// A range of one level.
    pub const fn only(precision: PixelPrecision) -> Self {
        Self {
            finest: precision,
            coarsest: precision,
        }
    }

    /// Whether `precision` is allowed.
    pub fn contains(self, precision: PixelPrecision) -> bool {
        (self.finest..=self.coarsest).contains(&precision)
    }

    /// The allowed level that is nearest to `precision`.
    pub fn nearest(self, precision: PixelPrecision) -> PixelPrecision {
        precision.min(self.coarsest).max(self.finest)
    }

    /// Checks that the finest level is not coarser than the coarsest.
    ///
    /// # Errors
    /// The rule, with both levels.
    pub fn validate(self) -> Result<(), Reason> {
        if self.finest <= self.coarsest {
            return Ok(());
        }
        let Self { finest, coarsest } = self;
        Err(
            format!("the finest precision, {finest}, is coarser than the coarsest, {coarsest}")
                .into(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_ordered_and_named() {
        for (index, precision) in PixelPrecision::ALL.into_iter().enumerate() {
            assert_eq!(precision as usize, index);
            assert_eq!(precision.to_string().parse(), Ok(precision));
            assert_eq!(
                precision.coarser().and_then(PixelPrecision::finer),
                Some(precision).filter(|precision| *precision != PixelPrecision::Lossy50)
            );
        }
        assert!("jpeg".parse::<PixelPrecision>().is_err());
    }
}
