//! Tile packets to datagrams: pieces that leave at once, and for each block of them parities from
//! which lost ones are computed. Reed–Solomon codes over 16-bit symbols (Lin, Al-Naffouri and Han,
//! IEEE Transactions on Information Theory 62(11), 2016): any k of k + m datagrams are enough.
//!
//! ```text
//! packets   aaaaaaaaaa bbbb cccccccc
//! pieces    aaaa aaaa aa·· bbbb cccc cccc │ P P P      one datagram each; a block
//! ```
//!
//! Each packet begins a piece of its own, so that it can be read without the others. A piece
//! begins with a word: how many bytes of its packet are left, those in the piece included, and
//! [`BEGINS`] in the first one. Pure; `now` is an argument.

use std::collections::VecDeque;
use std::time::Duration;

use super::datagram::{DATA_MAX, Datagram, HEADER_BYTES};
use super::loss_estimator::LossMeter;

/// The sender's end.
#[derive(Debug, Default)]
pub(crate) struct Blocks {
    open: Block,
    /// Blocks whose packets may be asked for, the oldest first.
    kept: VecDeque<Block>,
    kept_bytes: usize,
    /// The first block whose end the player has not been told of.
    untold: u64,
}

#[derive(Debug, Default)]
struct Block {
    number: u64,
    began: Duration,
    piece_bytes: usize,
    /// Padded with zeros to [`Block::piece_bytes`]; none once the block is closed.
    pieces: Vec<Vec<u8>>,
    /// Each with its first piece.
    packets: Vec<(u8, Vec<u8>)>,
}

/// A packet that is sent once more, whole.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Repair {
    pub(crate) block: u64,
    /// Its first piece.
    pub(crate) index: u8,
    pub(crate) packet: Vec<u8>,
}

impl Blocks {
    /// Puts a packet into the open block; the datagrams to send, each of at most `datagram_bytes`.
    /// Hands the packet back if it is too long for a block.
    pub(crate) fn push(
        &mut self,
        now: Duration,
        packet: Vec<u8>,
        datagram_bytes: usize,
        losses: &mut LossMeter,
    ) -> Result<Vec<Vec<u8>>, Vec<u8>> {
        let piece_bytes = (datagram_bytes.saturating_sub(HEADER_BYTES) / 2 * 2).min(PIECE_BYTES);
        if piece_bytes < PIECE_BYTES_MIN || packet.is_empty() {
            return Err(packet);
        }
        let needed = |piece_bytes: usize| packet.len().div_ceil(piece_bytes - WORD_BYTES);
        if needed(piece_bytes) > PIECES_MAX {
            return Err(packet);
        }
        let mut datagrams = Vec::new();
        let fits = self.open.piece_bytes == piece_bytes
            && self.open.pieces.len() + needed(piece_bytes) <= PIECES_MAX;
        if !fits {
            datagrams = self.close(losses);
            (self.open.piece_bytes, self.open.began) = (piece_bytes, now);
        }
        if self.open.pieces.is_empty() {
            self.open.began = now;
        }
        self.open.push(packet, &mut datagrams);
        Ok(datagrams)
    }

    /// When [`Blocks::close`] wants to be called.
    pub(crate) fn due(&self) -> Option<Duration> {
        (!self.open.pieces.is_empty()).then(|| self.open.began + BLOCK_AGE_MAX)
    }

    /// Ends the open block, if there is one: its parities.
    pub(crate) fn close(&mut self, losses: &mut LossMeter) -> Vec<Vec<u8>> {
        if self.open.pieces.is_empty() {
            return Vec::new();
        }
        let next = Block {
            number: self.open.number + 1,
            piece_bytes: self.open.piece_bytes,
            ..Block::default()
        };
        let mut block = std::mem::replace(&mut self.open, next);
        let datagrams = block.parities(losses);
        block.pieces.clear();
        self.kept_bytes += block.bytes();
        self.kept.push_back(block);
        while self.kept_bytes > KEPT_BYTES_MAX {
            let Some(oldest) = self.kept.pop_front() else {
                break;
            };
            self.kept_bytes -= oldest.bytes();
        }
        datagrams
    }

    /// When [`Blocks::tell`] wants to be called: some time after a block that none follows. If all
    /// of it is lost, no other tells the player that there was one.
    pub(crate) fn tell_due(&self) -> Option<Duration> {
        let last = self.kept.back()?;
        let is_untold = self.open.pieces.is_empty() && last.number >= self.untold;
        is_untold.then(|| last.began + BLOCK_AGE_MAX + TELL_AFTER)
    }

    /// The number of the last block.
    pub(crate) fn tell(&mut self) -> Option<u64> {
        let last = self.kept.back()?.number;
        self.untold = last + 1;
        Some(last)
    }

    /// The packets of a block of which the player lacks a piece; each is handed out once.
    pub(crate) fn repair(&mut self, number: u64, held: u64) -> Vec<Repair> {
        let Some(block) = self.kept.iter_mut().find(|block| block.number == number) else {
            return Vec::new();
        };
        let before = block.bytes();
        let payload = block.piece_bytes - WORD_BYTES;
        let lacks = |(first, packet): &mut (u8, Vec<u8>)| {
            let pieces = packet.len().div_ceil(payload);
            let all = (u64::MAX >> (u64::BITS as usize - pieces)) << *first;
            held & all != all
        };
        let lacking: Vec<_> = block.packets.extract_if(.., lacks).collect();
        self.kept_bytes -= before - block.bytes();
        let repair = |(index, packet)| Repair {
            block: number,
            index,
            packet,
        };
        lacking.into_iter().map(repair).collect()
    }
}

impl Block {
    fn push(&mut self, packet: Vec<u8>, datagrams: &mut Vec<Vec<u8>>) {
        let payload = self.piece_bytes - WORD_BYTES;
        let first = self.pieces.len();
        let mut left = packet.len() as u32;
        let mut flag = BEGINS;
        for part in packet.chunks(payload) {
            let mut piece = Vec::with_capacity(self.piece_bytes);
            piece.extend_from_slice(&(left | flag).to_le_bytes());
            piece.extend_from_slice(part);
            let datagram = Datagram::Data {
                block: self.number,
                index: self.pieces.len() as u8,
                bytes: &piece,
            };
            datagrams.push(datagram.to_bytes());
            piece.resize(self.piece_bytes, 0);
            self.pieces.push(piece);
            (left, flag) = (left - part.len() as u32, 0);
        }
        self.packets.push((first as u8, packet));
    }

    fn parities(&self, losses: &mut LossMeter) -> Vec<Vec<u8>> {
        let data = self.pieces.len();
        let wanted = losses.parities(data);
        // The counts are in range and all pieces of one even length: there is no error to have.
        let parities = reed_solomon_simd::encode(data, wanted, &self.pieces).unwrap_or_default();
        let datagram = |(index, bytes): (usize, &Vec<u8>)| {
            let datagram = Datagram::Parity {
                block: self.number,
                data: data as u8,
                parity: wanted as u8,
                index: index as u8,
                bytes,
            };
            datagram.to_bytes()
        };
        parities.iter().enumerate().map(datagram).collect()
    }

    fn bytes(&self) -> usize {
        self.packets.iter().map(|(_, packet)| packet.len()).sum()
    }
}

/// Of the word before each piece.
pub(crate) const WORD_BYTES: usize = 4;
/// In the word: a packet begins here.
pub(crate) const BEGINS: u32 = 1 << 31;
/// The longest piece: what an Ethernet frame holds beside the headers.
const PIECE_BYTES: usize = 1500;
/// Below this, the headers are what is sent.
const PIECE_BYTES_MIN: usize = 256;
const PIECES_MAX: usize = DATA_MAX;
/// The last parity of a block comes this much after its first piece: what is lost is late by no
/// more, and blocks are long enough for few parities.
const BLOCK_AGE_MAX: Duration = Duration::from_millis(3);
/// As long as tiles of one frame may be apart.
const TELL_AFTER: Duration = Duration::from_millis(5);
/// 1 s of 31.5 Mbit/s or 130 ms of 250.
const KEPT_BYTES_MAX: usize = 4 << 20;
