//! Wire format of QUIC datagrams: a kind, little-endian numbers, a payload.

/// A datagram of either direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Datagram<'a> {
    /// To a player: a source symbol of a block.
    Source {
        block: u64,
        /// Its index in the block, below [`SOURCE_SYMBOLS_MAX`].
        index: u8,
        bytes: &'a [u8],
    },
    /// To a player: a repair symbol of a block.
    Repair {
        block: u64,
        /// Number of source symbols of the block, 1 to [`SOURCE_SYMBOLS_MAX`].
        source_count: u8,
        /// Number of repair symbols of the block, 1 to [`REPAIR_SYMBOLS_MAX`].
        repair_count: u8,
        /// Its index among them.
        index: u8,
        bytes: &'a [u8],
    },
    /// To a node: a block could not be decoded.
    Nack {
        block: u64,
        /// Bit i: source symbol i has been received.
        received: u64,
    },
    /// To a node: a copy of a request that also travels on the control stream.
    RequestCopy(&'a [u8]),
}

impl<'a> Datagram<'a> {
    /// Encodes the datagram.
    pub(crate) fn to_bytes(self) -> Vec<u8> {
        match self {
            Self::Source {
                block,
                index,
                bytes,
            } => [&[SOURCE], &block.to_le_bytes()[..], &[index], bytes].concat(),
            Self::Repair {
                block,
                source_count,
                repair_count,
                index,
                bytes,
            } => {
                let counts = [source_count, repair_count, index];
                [&[REPAIR], &block.to_le_bytes()[..], &counts, bytes].concat()
            }
            Self::Nack { block, received } => {
                [&[NACK], &block.to_le_bytes()[..], &received.to_le_bytes()].concat()
            }
            Self::RequestCopy(bytes) => [&[REQUEST_COPY], bytes].concat(),
        }
    }

    /// Parses a datagram; `None` if it is malformed or a number is out of range.
    pub(crate) fn parse(bytes: &'a [u8]) -> Option<Self> {
        let (&kind, rest) = bytes.split_first()?;
        if kind == REQUEST_COPY {
            return Some(Self::RequestCopy(rest));
        }
        let (block, rest) = split_u64(rest)?;
        if block == u64::MAX {
            return None; // every block must have a successor
        }
        match (kind, rest) {
            (SOURCE, &[index, ref bytes @ ..]) => {
                let datagram = Self::Source {
                    block,
                    index,
                    bytes,
                };
                (usize::from(index) < SOURCE_SYMBOLS_MAX && !bytes.is_empty()).then_some(datagram)
            }
            (REPAIR, &[source_count, repair_count, index, ref bytes @ ..]) => {
                let in_range = (1..=SOURCE_SYMBOLS_MAX).contains(&usize::from(source_count))
                    && (1..=REPAIR_SYMBOLS_MAX).contains(&usize::from(repair_count))
                    && index < repair_count
                    && !bytes.is_empty()
                    && bytes.len().is_multiple_of(2);
                in_range.then_some(Self::Repair {
                    block,
                    source_count,
                    repair_count,
                    index,
                    bytes,
                })
            }
            (NACK, rest) => {
                let (received, rest) = split_u64(rest)?;
                rest.is_empty().then_some(Self::Nack { block, received })
            }
            _ => None,
        }
    }
}

fn split_u64(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let (number, rest) = bytes.split_first_chunk()?;
    Some((u64::from_le_bytes(*number), rest))
}

/// Maximum source symbols of a block: a frame of 65 kB, and the bits of a NACK's word.
pub(crate) const SOURCE_SYMBOLS_MAX: usize = 64;
/// Maximum repair symbols of a block.
pub(crate) const REPAIR_SYMBOLS_MAX: usize = 32;
/// Bytes before a repair symbol, whose header is the longest.
pub(crate) const HEADER_BYTES_MAX: usize = 12;

const SOURCE: u8 = 0;
const REPAIR: u8 = 1;
const NACK: u8 = 2;
const REQUEST_COPY: u8 = 3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parsing_is_the_inverse_of_encoding() {
        let bytes = &[1, 2, 3, 4][..];
        let block = 0x0102_0304_0506_0708;
        for datagram in [
            Datagram::Source {
                block,
                index: 63,
                bytes,
            },
            Datagram::Repair {
                block,
                source_count: 64,
                repair_count: 32,
                index: 31,
                bytes,
            },
            Datagram::Nack {
                block,
                received: !1,
            },
            Datagram::RequestCopy(bytes),
        ] {
            let written = datagram.to_bytes();
            assert_eq!(Datagram::parse(&written), Some(datagram));
            assert!(written.len() <= bytes.len() + HEADER_BYTES_MAX + 1);
        }
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        let block = [0; 8];
        for (kind, rest) in [
            (SOURCE, &[64, 0][..]),
            (SOURCE, &[1]),
            (REPAIR, &[0, 1, 0, 0, 0]),
            (REPAIR, &[65, 1, 0, 0, 0]),
            (REPAIR, &[1, 33, 0, 0, 0]),
            (REPAIR, &[1, 2, 2, 0, 0]),
            (REPAIR, &[1, 2, 1, 0, 0, 0]),
            (NACK, &[0; 7]),
            (NACK, &[0; 9]),
            (9, &[0; 20]),
        ] {
            let bytes = [&[kind], &block[..], rest].concat();
            assert_eq!(Datagram::parse(&bytes), None, "{bytes:?}");
        }
        assert_eq!(Datagram::parse(&[0xff; 20]), None);
        let last = [&[SOURCE], &[0xff; 8][..], &[0, 0]].concat();
        assert_eq!(Datagram::parse(&last), None);
        assert_eq!(Datagram::parse(&[]), None);
        assert_eq!(Datagram::parse(&[SOURCE, 0, 0]), None);
    }
}
