//! What stands before the planes of a payload.

use super::mode::Mode;
use crate::precision::PixelPrecision;

/// What stands before the planes of sRGB tiles.
pub(crate) struct Header<'a> {
    pub(crate) precision: PixelPrecision,
    pub(crate) storage: u8,
    /// `None` for a tile that is as its reference is.
    pub(crate) modes: Vec<Option<Mode>>,
    pub(crate) rest: &'a [u8],
}

impl<'a> Header<'a> {
    pub(crate) fn parse(payload: &'a [u8], tiles: usize) -> Result<Self, String> {
        let (&first, rest) = payload.split_first().ok_or("it has no bytes")?;
        let precision = PixelPrecision::ALL.get(usize::from(first >> PRECISION_SHIFT));
        let precision = *precision.ok_or("its first byte names no precision")?;
        let storage = first & STORAGE_MASK;
        if first & MODES == 0 {
            let modes = vec![Some(Mode::USUAL); tiles];
            return Ok(Self {
                precision,
                storage,
                modes,
                rest,
            });
        }
        let (bytes, rest) = rest
            .split_at_checked(tiles.div_ceil(2))
            .ok_or("its modes are cut short")?;
        let nibbles = bytes.iter().flat_map(|byte| [byte & 0xf, byte >> 4]);
        let modes = nibbles.take(tiles).map(|nibble| match nibble {
            UNCHANGED => Ok(None),
            number => Mode::of(number).map(Some),
        });
        Ok(Self {
            precision,
            storage,
            modes: modes.collect::<Result<_, _>>()?,
            rest,
        })
    }
}

/// The first byte, without modes.
pub(crate) fn first(precision: PixelPrecision, storage: u8) -> u8 {
    (precision as u8) << PRECISION_SHIFT | storage
}

/// The first byte, and the modes if any is not the usual one.
pub(crate) fn write(precision: PixelPrecision, modes: &[Option<Mode>]) -> Vec<u8> {
    let first = first(precision, STORED);
    if modes.iter().all(|mode| *mode == Some(Mode::USUAL)) {
        return vec![first];
    }
    let mut bytes = vec![first | MODES];
    for pair in modes.chunks(2) {
        let nibbles = pair.iter().map(|mode| mode.map_or(UNCHANGED, Mode::number));
        bytes.push(nibbles.rev().fold(0, |byte, nibble| byte << 4 | nibble));
    }
    bytes
}

/// Bits of the first byte that say how the planes are stored.
const STORAGE_MASK: u8 = 3;
/// Planes as they are.
pub(crate) const STORED: u8 = 0;
/// Planes as one zstd frame.
pub(crate) const ZSTD: u8 = 1;
/// A JPEG scan.
pub(crate) const JPEG: u8 = 2;
/// The changes of each tile, range coded; no modes.
pub(crate) const CHANGES: u8 = 3;
/// The bit that says that four bits for each tile follow, the first tile's the lowest.
const MODES: u8 = 4;
/// The bits above it are the precision.
const PRECISION_SHIFT: u32 = 3;
/// A tile that is as its reference is; those below are [`Mode::number`].
const UNCHANGED: u8 = 9;
