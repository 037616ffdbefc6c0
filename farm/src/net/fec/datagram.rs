//! What travels as QUIC datagrams, as bytes: a kind, numbers with the lowest byte first, a payload.

/// One datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Datagram<'a> {
    /// To a player: a piece of the tile packets of a block.
    Data {
        block: u64,
        /// Its place, below [`DATA_MAX`].
        index: u8,
        bytes: &'a [u8],
    },
    /// To a player: what lost pieces of a block are computed from.
    Parity {
        block: u64,
        /// Pieces of the block, 1 to [`DATA_MAX`].
        data: u8,
        /// Parities of the block, 1 to [`PARITY_MAX`].
        parity: u8,
        /// Its place among them.
        index: u8,
        bytes: &'a [u8],
    },
    /// To a node: a block has not come whole.
    Missing {
        block: u64,
        /// Bit i: piece i is here.
        held: u64,
    },
    /// To a node: a copy of a control packet that is on its way.
    Copy(&'a [u8]),
}

impl<'a> Datagram<'a> {
    /// The bytes.
    pub(crate) fn to_bytes(self) -> Vec<u8> {
        match self {
            Self::Data {
                block,
                index,
                bytes,
            } => [&[DATA], &block.to_le_bytes()[..], &[index], bytes].concat(),
            Self::Parity {
                block,
                data,
                parity,
                index,
                bytes,
            } => {
                let counts = [data, parity, index];
                [&[PARITY], &block.to_le_bytes()[..], &counts, bytes].concat()
            }
            Self::Missing { block, held } => {
                [&[MISSING], &block.to_le_bytes()[..], &held.to_le_bytes()].concat()
            }
            Self::Copy(bytes) => [&[COPY], bytes].concat(),
        }
    }

    /// Reads one; `None` if it is none or a number is out of range.
    pub(crate) fn parse(bytes: &'a [u8]) -> Option<Self> {
        let (&kind, rest) = bytes.split_first()?;
        if kind == COPY {
            return Some(Self::Copy(rest));
        }
        let (block, rest) = take_number(rest)?;
        if block == u64::MAX {
            return None; // there is a next one to every block
        }
        match (kind, rest) {
            (DATA, &[index, ref bytes @ ..]) => {
                let datagram = Self::Data {
                    block,
                    index,
                    bytes,
                };
                (usize::from(index) < DATA_MAX && !bytes.is_empty()).then_some(datagram)
            }
            (PARITY, &[data, parity, index, ref bytes @ ..]) => {
                let in_range = (1..=DATA_MAX).contains(&usize::from(data))
                    && (1..=PARITY_MAX).contains(&usize::from(parity))
                    && index < parity
                    && !bytes.is_empty()
                    && bytes.len().is_multiple_of(2);
                in_range.then_some(Self::Parity {
                    block,
                    data,
                    parity,
                    index,
                    bytes,
                })
            }
            (MISSING, rest) => {
                let (held, rest) = take_number(rest)?;
                rest.is_empty().then_some(Self::Missing { block, held })
            }
            _ => None,
        }
    }
}

fn take_number(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let (number, rest) = bytes.split_first_chunk()?;
    Some((u64::from_le_bytes(*number), rest))
}

/// Pieces of a block: a frame of 65 kB in one, and as many bits as a number has.
pub(crate) const DATA_MAX: usize = 64;
/// Parities of a block.
pub(crate) const PARITY_MAX: usize = 32;
/// Bytes before a parity, the longest header.
pub(crate) const HEADER_BYTES: usize = 12;

const DATA: u8 = 0;
const PARITY: u8 = 1;
const MISSING: u8 = 2;
const COPY: u8 = 3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let bytes = &[1, 2, 3, 4][..];
        let block = 0x0102_0304_0506_0708;
        for datagram in [
            Datagram::Data {
                block,
                index: 63,
                bytes,
            },
            Datagram::Parity {
                block,
                data: 64,
                parity: 32,
                index: 31,
                bytes,
            },
            Datagram::Missing { block, held: !1 },
            Datagram::Copy(bytes),
        ] {
            let written = datagram.to_bytes();
            assert_eq!(Datagram::parse(&written), Some(datagram));
            assert!(written.len() <= bytes.len() + HEADER_BYTES + 1);
        }
    }

    #[test]
    fn what_is_out_of_range_is_none() {
        let block = [0; 8];
        for (kind, rest) in [
            (DATA, &[64, 0][..]),
            (DATA, &[1]),
            (PARITY, &[0, 1, 0, 0, 0]),
            (PARITY, &[65, 1, 0, 0, 0]),
            (PARITY, &[1, 33, 0, 0, 0]),
            (PARITY, &[1, 2, 2, 0, 0]),
            (PARITY, &[1, 2, 1, 0, 0, 0]),
            (MISSING, &[0; 7]),
            (MISSING, &[0; 9]),
            (9, &[0; 20]),
        ] {
            let bytes = [&[kind], &block[..], rest].concat();
            assert_eq!(Datagram::parse(&bytes), None, "{bytes:?}");
        }
        assert_eq!(Datagram::parse(&[0xff; 20]), None);
        let last = [&[DATA], &[0xff; 8][..], &[0, 0]].concat();
        assert_eq!(Datagram::parse(&last), None);
        assert_eq!(Datagram::parse(&[]), None);
        assert_eq!(Datagram::parse(&[DATA, 0, 0]), None);
    }
}
