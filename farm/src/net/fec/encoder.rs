//! Sender of forward error correction: turns packets into datagrams.

use std::collections::VecDeque;
use std::time::Duration;

use super::datagram::{Datagram, HEADER_BYTES_MAX, SOURCE_SYMBOLS_MAX};
use super::loss_estimator::LossEstimator;
use super::{PACKET_START, Retransmission, SYMBOL_BYTES_MAX, WORD_BYTES};

/// FEC encoder of one connection's tile packets.
#[derive(Debug, Default)]
pub(crate) struct FecEncoder {
    open: SourceBlock,
    /// Blocks whose packets may be retransmitted, the oldest first.
    sent: VecDeque<SourceBlock>,
    sent_bytes: usize,
    /// The first block that has not been announced to the receiver.
    unannounced: u64,
}

#[derive(Debug, Default)]
struct SourceBlock {
    number: u64,
    start: Duration,
    symbol_bytes: usize,
    /// Padded with zeros to `symbol_bytes`; cleared once the block is closed.
    symbols: Vec<Vec<u8>>,
    /// The packets, each with the index of its first symbol.
    packets: Vec<(u8, Vec<u8>)>,
}

impl FecEncoder {
    /// Adds a packet to the open block and returns the datagrams to send, each of at most `datagram_bytes`.
    /// Fails with the packet itself if it is too long for a block.
    pub(crate) fn push(
        &mut self,
        now: Duration,
        packet: Vec<u8>,
        datagram_bytes: usize,
        losses: &mut LossEstimator,
    ) -> Result<Vec<Vec<u8>>, Vec<u8>> {
        // Reed–Solomon over 16-bit symbols needs even lengths.
        let symbol_bytes = datagram_bytes.saturating_sub(HEADER_BYTES_MAX) / 2 * 2;
        let symbol_bytes = symbol_bytes.min(SYMBOL_BYTES_MAX);
        if symbol_bytes < SYMBOL_BYTES_MIN || packet.is_empty() {
            return Err(packet);
        }
        let needed = packet.len().div_ceil(symbol_bytes - WORD_BYTES);
        if needed > SOURCE_SYMBOLS_MAX {
            return Err(packet);
        }
        let mut datagrams = Vec::new();
        // All symbols of a block have one length, which follows the path MTU.
        let fits = self.open.symbol_bytes == symbol_bytes
            // A packet never spans two blocks, which are decoded independently.
            && self.open.symbols.len() + needed <= SOURCE_SYMBOLS_MAX;
        if !fits {
            datagrams = self.close(losses);
            (self.open.symbol_bytes, self.open.start) = (symbol_bytes, now);
        }
        if self.open.symbols.is_empty() {
            self.open.start = now;
        }
        self.open.push(packet, &mut datagrams);
        Ok(datagrams)
    }

    /// The time at which the open block must be closed.
    pub(crate) fn close_timeout(&self) -> Option<Duration> {
        (!self.open.symbols.is_empty()).then(|| self.open.start + BLOCK_AGE_MAX)
    }

    /// Closes the open block, if there is one, and returns its repair symbols as datagrams.
    pub(crate) fn close(&mut self, losses: &mut LossEstimator) -> Vec<Vec<u8>> {
        if self.open.symbols.is_empty() {
            return Vec::new();
        }
        // Numbers are consecutive whatever happens to the block, so that the receiver notices a gap if all of
        // it is lost.
        let next = SourceBlock {
            number: self.open.number + 1,
            symbol_bytes: self.open.symbol_bytes,
            ..SourceBlock::default()
        };
        let mut block = std::mem::replace(&mut self.open, next);
        let datagrams = block.repair_symbols(losses);
        block.symbols.clear();
        self.sent_bytes += block.packet_bytes();
        self.sent.push_back(block);
        // Packets older than this are past any deadline.
        while self.sent_bytes > SENT_BYTES_MAX {
            let Some(oldest) = self.sent.pop_front() else {
                break;
            };
            self.sent_bytes -= oldest.packet_bytes();
        }
        datagrams
    }

    /// The time at which the last block must be announced unless another follows it: if all of its datagrams
    /// were lost, the receiver would not know that it exists.
    pub(crate) fn announce_timeout(&self) -> Option<Duration> {
        let last = self.sent.back()?;
        let is_unannounced = self.open.symbols.is_empty() && last.number >= self.unannounced;
        is_unannounced.then(|| last.start + BLOCK_AGE_MAX + ANNOUNCE_DELAY)
    }

    /// The number of the last block, to be announced on a stream.
    pub(crate) fn announce_last(&mut self) -> Option<u64> {
        let last = self.sent.back()?.number;
        self.unannounced = last + 1;
        Some(last)
    }

    /// The packets of a block of which the receiver lacks a symbol; each is returned once.
    pub(crate) fn retransmit(&mut self, number: u64, received: u64) -> Vec<Retransmission> {
        let Some(block) = self.sent.iter_mut().find(|block| block.number == number) else {
            return Vec::new();
        };
        let before = block.packet_bytes();
        let payload_bytes = block.symbol_bytes - WORD_BYTES;
        let is_incomplete = |(first, packet): &mut (u8, Vec<u8>)| {
            let symbols = packet.len().div_ceil(payload_bytes);
            // One bit for each symbol of the packet.
            let all = (u64::MAX >> (u64::BITS as usize - symbols)) << *first;
            received & all != all
        };
        // Removed, so that a second NACK that crosses the answer does not send them twice.
        let packets: Vec<_> = block.packets.extract_if(.., is_incomplete).collect();
        self.sent_bytes -= before - block.packet_bytes();
        let retransmission = |(index, packet)| Retransmission {
            block: number,
            index,
            packet,
        };
        packets.into_iter().map(retransmission).collect()
    }
}

impl SourceBlock {
    fn push(&mut self, packet: Vec<u8>, datagrams: &mut Vec<Vec<u8>>) {
        let payload_bytes = self.symbol_bytes - WORD_BYTES;
        let first = self.symbols.len();
        let mut left = packet.len() as u32;
        let mut flag = PACKET_START;
        for part in packet.chunks(payload_bytes) {
            let mut symbol = Vec::with_capacity(self.symbol_bytes);
            // Part of the symbol and thus restored with it: a receiver that lost the first symbol of a packet
            // still learns where it begins and how long it is.
            symbol.extend_from_slice(&(left | flag).to_le_bytes());
            symbol.extend_from_slice(part);
            let datagram = Datagram::Source {
                block: self.number,
                index: self.symbols.len() as u8,
                bytes: &symbol,
            };
            datagrams.push(datagram.to_bytes());
            // Sent without the padding, but encoded with it, since all symbols of a code have one length.
            symbol.resize(self.symbol_bytes, 0);
            self.symbols.push(symbol);
            (left, flag) = (left - part.len() as u32, 0);
        }
        self.packets.push((first as u8, packet));
    }

    fn repair_symbols(&self, losses: &mut LossEstimator) -> Vec<Vec<u8>> {
        let source_count = self.symbols.len();
        let repair_count = losses.repair_count(source_count);
        // Cannot fail: the counts are in range, and all symbols have one even length.
        let symbols = reed_solomon_simd::encode(source_count, repair_count, &self.symbols)
            .unwrap_or_default();
        let datagram = |(index, bytes): (usize, &Vec<u8>)| {
            let datagram = Datagram::Repair {
                block: self.number,
                source_count: source_count as u8,
                repair_count: repair_count as u8,
                index: index as u8,
                bytes,
            };
            datagram.to_bytes()
        };
        symbols.iter().enumerate().map(datagram).collect()
    }

    fn packet_bytes(&self) -> usize {
        self.packets.iter().map(|(_, packet)| packet.len()).sum()
    }
}

/// With shorter symbols, headers would be a large part of what is sent.
const SYMBOL_BYTES_MIN: usize = 256;
/// Maximum age of an open block: restored packets are late by no more, and blocks are long enough to need few
/// repair symbols.
const BLOCK_AGE_MAX: Duration = Duration::from_millis(3);
/// Tiles of one frame are sent within this time of each other.
const ANNOUNCE_DELAY: Duration = Duration::from_millis(5);
/// Bytes of packets kept for retransmission: 1 s at 31.5 Mbit/s, 130 ms at 250.
const SENT_BYTES_MAX: usize = 4 << 20;
