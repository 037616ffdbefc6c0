//! Forward error correction of tile packets: blocks of datagrams whose repair symbols restore lost
//! source symbols without a round trip (the FEC framework of RFC 6363).
//!
//! ```text
//! packets          aaaaaaaaaa bbbb cccccccc
//! source symbols   aaaa aaaa aa·· bbbb cccc cccc │ R R R   repair symbols; one datagram each
//! ```
//!
//! Each packet begins a symbol of its own, so that it can be read without the others. A source symbol starts
//! with a word: the bytes of its packet that are left, including those in the symbol, and [`PACKET_START`] in
//! the packet's first symbol. The code is Reed–Solomon over 16-bit symbols (Lin, Al-Naffouri and Han, IEEE
//! Transactions on Information Theory 62(11), 2016): any k of k + m datagrams suffice. A block that loses
//! more is reported by a NACK, and its packets are sent again on streams. All code here is pure; `now` is an
//! argument.

mod block;
pub(crate) mod datagram;
pub(crate) mod decoder;
pub(crate) mod encoder;
pub(crate) mod loss_estimator;
pub(crate) mod tile_stream;

/// A packet that is sent again as a whole, on a stream.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Retransmission {
    pub(crate) block: u64,
    /// The index of its first symbol.
    pub(crate) index: u8,
    pub(crate) packet: Vec<u8>,
}

/// Length of the word before each source symbol.
const WORD_BYTES: usize = 4;
/// Flag in the word of a packet's first symbol.
const PACKET_START: u32 = 1 << 31;
/// Maximum length of a symbol: the payload of an Ethernet frame.
const SYMBOL_BYTES_MAX: usize = 1500;
