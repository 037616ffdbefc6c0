//! Forward error correction of tile packets: blocks of datagrams whose repair symbols restore lost
//! source symbols without a round trip (the FEC framework of RFC 6363).
//!
//! ```text
//! packets          aaaaaaaaaa bbbb cccccccc
//! source symbols   aaaa aaaa aa·· bbbb cccc cccc │ R R R   repair symbols; one datagram each
//! ```
//!
//! Each packet begins a symbol of its own, so that it can be read without the others. A source
//! symbol starts with a word: how many bytes of its packet are left, those in the symbol included,
//! and [`PACKET_START`] in the packet's first one. The code is Reed–Solomon over 16-bit symbols
//! (Lin, Al-Naffouri and Han, IEEE Transactions on Information Theory 62(11), 2016): any k of k + m
//! datagrams are enough. A block that loses more is reported by a NACK, and its packets are sent
//! once more on streams. All is pure; `now` is an argument.

mod block;
pub(crate) mod datagram;
pub(crate) mod decoder;
pub(crate) mod encoder;
pub(crate) mod loss_estimator;
pub(crate) mod tile_stream;

/// A packet that is sent once more, whole, on a stream.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Retransmission {
    pub(crate) block: u64,
    /// The index of its first symbol.
    pub(crate) index: u8,
    pub(crate) packet: Vec<u8>,
}

/// Length of the word before each source symbol.
const WORD_BYTES: usize = 4;
/// In the word: a packet starts here.
const PACKET_START: u32 = 1 << 31;
/// The longest symbol: what an Ethernet frame holds beside the headers.
const SYMBOL_BYTES_MAX: usize = 1500;
