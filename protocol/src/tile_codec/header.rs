//! Header of an sRGB payload: its precision, how its planes are stored, and the modes of its tiles.

use crate::error::{EMPTY, Reason};
use crate::precision::PixelPrecision;

/// Coding mode of a tile in a payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TileMode {
    /// By itself: differences between neighbouring pixels, or a JPEG scan.
    Intra,
    /// Against its reference: a mask and the differences of the marked pixels.
    Delta,
    /// Not at all: it equals its reference.
    Unchanged,
}

/// Parsed header of a payload, and the bytes after it.
pub(super) struct Header<'a> {
    pub(super) precision: PixelPrecision,
    /// One of [`STORED`], [`ZSTD`], [`JPEG`] and [`RANGE_CODED`].
    pub(super) storage: u8,
    pub(super) modes: Vec<TileMode>,
    pub(super) body: &'a [u8],
}

impl<'a> Header<'a> {
    pub(super) fn parse(payload: &'a [u8], tiles: usize) -> Result<Self, Reason> {
        let (&first, rest) = payload.split_first().ok_or(EMPTY)?;
        let precision = PixelPrecision::ALL.get(usize::from(first >> PRECISION_SHIFT));
        let unknown = || format!("its first byte names no precision: {first:#04x}");
        let header = |modes, body| {
            Ok(Self {
                precision: *precision.ok_or_else(unknown)?,
                storage: first & STORAGE_MASK,
                modes,
                body,
            })
        };
        if first & MODES == 0 {
            return header(vec![TileMode::Intra; tiles], rest);
        }
        let (bytes, body) = rest
            .split_at_checked(tiles.div_ceil(TILES_PER_BYTE))
            .ok_or("its modes are cut short")?;
        let bits = bytes
            .iter()
            .flat_map(|byte| [0, 2, 4, 6].map(|shift| byte >> shift & 3));
        let modes: Result<_, _> = bits.take(tiles).map(TileMode::from_bits).collect();
        header(modes?, body)
    }
}

impl TileMode {
    fn from_bits(bits: u8) -> Result<Self, Reason> {
        match bits {
            0 => Ok(Self::Intra),
            1 => Ok(Self::Delta),
            2 => Ok(Self::Unchanged),
            _ => Err(format!("there is no mode {bits}").into()),
        }
    }
}

/// The first byte of a payload without tile modes.
pub(super) fn first_byte(precision: PixelPrecision, storage: u8) -> u8 {
    (precision as u8) << PRECISION_SHIFT | storage
}

/// The header of a payload with stored planes; another storage's bits are set in its first byte later.
pub(super) fn write(precision: PixelPrecision, modes: &[TileMode]) -> Vec<u8> {
    let first = first_byte(precision, STORED);
    if modes.iter().all(|mode| *mode == TileMode::Intra) {
        return vec![first];
    }
    let mut bytes = vec![first | MODES];
    for four in modes.chunks(TILES_PER_BYTE) {
        let four = four.iter().rev();
        bytes.push(four.fold(0, |byte, mode| byte << 2 | *mode as u8));
    }
    bytes
}

/// Bits of the first byte that state the storage.
const STORAGE_MASK: u8 = 3;
/// Planes as they are.
pub(super) const STORED: u8 = 0;
/// Planes as one zstd frame.
pub(super) const ZSTD: u8 = 1;
/// A JPEG scan.
pub(super) const JPEG: u8 = 2;
/// Delta masks and values of all tiles, range coded; without modes.
pub(super) const RANGE_CODED: u8 = 3;
/// Bit of the first byte that states that tile modes follow: two bits a tile, the first tile's the lowest.
const MODES: u8 = 4;
/// The precision is the bits of the first byte from this one up.
const PRECISION_SHIFT: u32 = 3;
const TILES_PER_BYTE: usize = 4;
