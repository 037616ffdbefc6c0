//! Wire format of the streams that carry tiles to a player: a tile packet, or a byte with which no tile
//! packet starts and what it announces.

use super::Retransmission;

/// Content of a stream.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum TileStream {
    /// A tile packet.
    Packet(Vec<u8>),
    /// [`RETRANSMISSION`], the number of a block, the index of the packet's first symbol in it, and the
    /// packet, whose datagrams were lost.
    Retransmission(Retransmission),
    /// [`LAST_BLOCK`] and the number of the last block.
    LastBlock(u64),
}

impl TileStream {
    /// # Errors
    /// The rule that the stream breaks.
    pub(crate) fn parse(bytes: Vec<u8>) -> Result<Self, &'static str> {
        match bytes.first() {
            Some(&RETRANSMISSION) => {
                let (header, packet) = bytes
                    .split_first_chunk::<RETRANSMISSION_HEADER_BYTES>()
                    .ok_or("a retransmission is shorter than its header of 10 bytes")?;
                let [_, block @ .., index] = *header;
                Ok(Self::Retransmission(Retransmission {
                    block: u64::from_le_bytes(block),
                    index,
                    packet: packet.to_vec(),
                }))
            }
            Some(&LAST_BLOCK) => {
                let last = bytes[1..].try_into();
                let last = last.map_err(|_| "the number of the last block has not 8 bytes")?;
                Ok(Self::LastBlock(u64::from_le_bytes(last)))
            }
            _ => Ok(Self::Packet(bytes)),
        }
    }

    /// The header before the packet of a retransmission.
    pub(crate) fn retransmission_header(block: u64, index: u8) -> Vec<u8> {
        [&[RETRANSMISSION], &block.to_le_bytes()[..], &[index]].concat()
    }

    /// The stream that announces the last block.
    pub(crate) fn last_block(block: u64) -> Vec<u8> {
        [&[LAST_BLOCK], &block.to_le_bytes()[..]].concat()
    }
}

/// Length of the header before the packet of a retransmission.
pub(crate) const RETRANSMISSION_HEADER_BYTES: usize = 10;
const RETRANSMISSION: u8 = 0xff;
const LAST_BLOCK: u8 = 0xfe;
