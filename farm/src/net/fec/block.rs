//! One block of datagrams as it comes: its pieces, its parities, and the packets that they make.

use std::time::Duration;

use super::datagram::DATA_MAX;
use super::encoder::{BEGINS, WORD_BYTES};

/// A block that is not whole, or was not until a moment ago.
#[derive(Debug)]
pub(super) struct Block {
    pieces: Vec<Option<Vec<u8>>>,
    parities: Vec<Option<Vec<u8>>>,
    /// Pieces, once a parity has come.
    count: Option<usize>,
    /// Bit i: the packet that begins at piece i has been handed out.
    pub(super) delivered: u64,
    whole: bool,
    pub(super) began: Duration,
    pub(super) heard: Duration,
    pub(super) asked: Option<Duration>,
    pub(super) asks: u32,
    /// Part of an answer has come: the others come as surely.
    pub(super) answered: bool,
}

impl Block {
    pub(super) fn new(now: Duration) -> Self {
        Self {
            pieces: Vec::new(),
            parities: Vec::new(),
            count: None,
            delivered: 0,
            whole: false,
            began: now,
            heard: now,
            asked: None,
            asks: 0,
            answered: false,
        }
    }

    pub(super) fn insert_piece(&mut self, index: usize, bytes: &[u8]) -> Result<(), &'static str> {
        if self.count.is_some_and(|count| index >= count) {
            return Err("a piece is outside of its block");
        }
        if bytes.len() <= WORD_BYTES {
            return Err("a piece has no content");
        }
        if self.pieces.len() <= index {
            self.pieces.resize(index + 1, None);
        }
        self.pieces[index].get_or_insert_with(|| bytes.to_vec());
        Ok(())
    }

    pub(super) fn insert_parity(
        &mut self,
        count: usize,
        parities: u8,
        index: u8,
        bytes: &[u8],
    ) -> Result<(), &'static str> {
        let others = |known: usize| known != count || self.parities.len() != usize::from(parities);
        if self.count.is_some_and(others) || self.pieces.len() > count {
            return Err("parities of one block count it differently");
        }
        self.count = Some(count);
        self.pieces.resize(count, None);
        self.parities.resize(usize::from(parities), None);
        self.parities[usize::from(index)].get_or_insert_with(|| bytes.to_vec());
        Ok(())
    }

    /// Bit i: piece i is here.
    pub(super) fn held(&self) -> u64 {
        let here = |(index, piece): (usize, &Option<Vec<u8>>)| u64::from(piece.is_some()) << index;
        let pieces = self.pieces.iter().enumerate().map(here);
        pieces.fold(0, |held, piece| held | piece)
    }

    /// When it is asked for; `None` if it is whole or has been asked for often enough.
    pub(super) fn due(
        &self,
        is_past: bool,
        overtaken: Duration,
        round_trip: Duration,
    ) -> Option<Duration> {
        if self.whole || self.answered || self.asks >= ASKS_MAX {
            return None;
        }
        Some(match self.asked {
            Some(asked) => {
                asked + (round_trip + ANSWER_PATIENCE) * (1 << self.asks.saturating_sub(2))
            }
            None if is_past => self.heard.max(self.began) + overtaken + PAST_PATIENCE,
            None => self.heard + overtaken + LAST_PATIENCE,
        })
    }

    /// Computes what is missing if there are parities enough; the packets that it makes whole.
    pub(super) fn repair(&mut self) -> Result<Vec<Vec<u8>>, &'static str> {
        let Some(count) = self.count.filter(|_| !self.whole) else {
            return Ok(Vec::new());
        };
        let here = self.pieces.iter().flatten().count();
        if here + self.parities.iter().flatten().count() < count {
            return Ok(Vec::new());
        }
        if here < count {
            self.compute(count)?;
        }
        self.whole = true;
        let mut packets = Vec::new();
        for index in 0..count {
            packets.extend(self.packet_at(index)?);
        }
        Ok(packets)
    }

    fn compute(&mut self, count: usize) -> Result<(), &'static str> {
        let parities = self.parities.iter().enumerate();
        let parities: Vec<(usize, &Vec<u8>)> = parities
            .filter_map(|(index, parity)| Some((index, parity.as_ref()?)))
            .collect();
        let bytes = parities.first().map_or(0, |(_, parity)| parity.len());
        let padded = |(index, piece): (usize, &Option<Vec<u8>>)| {
            let mut piece = piece.clone()?;
            piece.resize(bytes.max(piece.len()), 0);
            Some((index, piece))
        };
        let pieces: Vec<_> = self.pieces.iter().enumerate().filter_map(padded).collect();
        let computed = reed_solomon_simd::decode(count, self.parities.len(), pieces, parities)
            .map_err(|_| "the lengths of pieces and parities differ")?;
        for (index, piece) in computed {
            self.pieces[index] = Some(piece);
        }
        Ok(())
    }

    /// The packet that has a part in piece `index`, if it is whole and has not been handed out.
    pub(super) fn packet_around(&mut self, index: usize) -> Result<Vec<Vec<u8>>, &'static str> {
        let begins = |index: &usize| self.word(*index).is_none_or(|word| word & BEGINS != 0);
        let Some(first) = (0..=index).rev().find(begins) else {
            return Err("a block begins within a packet");
        };
        Ok(self.packet_at(first)?.into_iter().collect())
    }

    /// The packet that begins in piece `first`; `None` if none does, it is not whole, or it has
    /// been handed out.
    fn packet_at(&mut self, first: usize) -> Result<Option<Vec<u8>>, &'static str> {
        let Some(word) = self.word(first).filter(|word| word & BEGINS != 0) else {
            return Ok(None);
        };
        if self.delivered & (1 << first) != 0 {
            return Ok(None);
        }
        let length = (word & !BEGINS) as usize;
        if length > DATA_MAX * PACKET_PIECE_BYTES_MAX {
            return Err("a packet is longer than a block");
        }
        let mut packet = Vec::with_capacity(length);
        for index in first.. {
            let left = length - packet.len();
            if left == 0 {
                break;
            }
            let Some(Some(piece)) = self.pieces.get(index) else {
                return Ok(None);
            };
            if index > first && self.word(index) != Some(left as u32) {
                return Err("a packet's pieces do not follow each other");
            }
            let part = &piece[WORD_BYTES..];
            packet.extend_from_slice(&part[..part.len().min(left)]);
        }
        if packet.is_empty() {
            return Err("a packet is empty");
        }
        self.delivered |= 1 << first;
        Ok(Some(packet))
    }

    fn word(&self, index: usize) -> Option<u32> {
        let word = self.pieces.get(index)?.as_ref()?.first_chunk()?;
        Some(u32::from_le_bytes(*word))
    }
}

const PACKET_PIECE_BYTES_MAX: usize = 1500;
/// Pieces that others overtook may still come, and as late as others have.
const PAST_PATIENCE: Duration = Duration::from_millis(4);
/// Of the newest block the parities may still come: a block is open for 3 ms, and jitter.
const LAST_PATIENCE: Duration = Duration::from_millis(8);
/// An answer may be longer under way than the round trip.
const ANSWER_PATIENCE: Duration = Duration::from_millis(10);
/// A question may be lost itself, or come before a busy sender has ended the block. From the third on
/// they are twice as far apart each time: no deadline is met any more, but a frame without one must
/// be whole some time.
const ASKS_MAX: u32 = 10;
