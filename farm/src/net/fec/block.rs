//! Block being received: its symbols, and the packets restored from them.

use std::time::Duration;

use super::datagram::SOURCE_SYMBOLS_MAX;
use super::{PACKET_START, SYMBOL_BYTES_MAX, WORD_BYTES};

/// A block whose symbols are arriving or may still arrive.
#[derive(Debug)]
pub(super) struct ReceivedBlock {
    source_symbols: Vec<Option<Vec<u8>>>,
    repair_symbols: Vec<Option<Vec<u8>>>,
    /// Number of source symbols of the block, known from its first repair symbol.
    source_count: Option<usize>,
    /// Bit i: the packet that starts at symbol i has been delivered.
    pub(super) delivered: u64,
    decoded: bool,
    pub(super) created: Duration,
    pub(super) last_arrival: Duration,
    pub(super) last_nack: Option<Duration>,
    pub(super) nacks: u32,
    /// Whether a retransmission has arrived: the other missing packets then also come on reliable streams.
    pub(super) answered: bool,
}

impl ReceivedBlock {
    pub(super) fn new(now: Duration) -> Self {
        Self {
            source_symbols: Vec::new(),
            repair_symbols: Vec::new(),
            source_count: None,
            delivered: 0,
            decoded: false,
            created: now,
            last_arrival: now,
            last_nack: None,
            nacks: 0,
            answered: false,
        }
    }

    pub(super) fn insert_source(&mut self, index: usize, bytes: &[u8]) -> Result<(), &'static str> {
        if self.source_count.is_some_and(|count| index >= count) {
            return Err("a source symbol lies outside its block");
        }
        if bytes.len() <= WORD_BYTES {
            return Err("a source symbol has no content");
        }
        if self.source_symbols.len() <= index {
            self.source_symbols.resize(index + 1, None);
        }
        self.source_symbols[index].get_or_insert_with(|| bytes.to_vec());
        Ok(())
    }

    pub(super) fn insert_repair(
        &mut self,
        source_count: usize,
        repair_count: usize,
        index: usize,
        bytes: &[u8],
    ) -> Result<(), &'static str> {
        let contradicts =
            |known: usize| known != source_count || self.repair_symbols.len() != repair_count;
        if self.source_count.is_some_and(contradicts) || self.source_symbols.len() > source_count {
            return Err("the repair symbols of a block contradict each other");
        }
        self.source_count = Some(source_count);
        self.source_symbols.resize(source_count, None);
        self.repair_symbols.resize(repair_count, None);
        self.repair_symbols[index].get_or_insert_with(|| bytes.to_vec());
        Ok(())
    }

    /// Bit i: source symbol i has been received.
    pub(super) fn received(&self) -> u64 {
        let symbols = self.source_symbols.iter().enumerate();
        let bits = symbols.map(|(index, symbol)| u64::from(symbol.is_some()) << index);
        bits.fold(0, |received, bit| received | bit)
    }

    /// The time of the next NACK; `None` if the block is complete, or has been answered or NACKed often
    /// enough.
    pub(super) fn nack_timeout(
        &self,
        is_newest: bool,
        reordering: Duration,
        rtt: Duration,
    ) -> Option<Duration> {
        if self.decoded || self.answered || self.nacks >= NACKS_MAX {
            return None;
        }
        Some(match self.last_nack {
            Some(last_nack) => {
                let backoff = 1 << self.nacks.saturating_sub(2);
                last_nack + (rtt + RETRANSMISSION_SLACK) * backoff
            }
            None if is_newest => self.last_arrival + reordering + NEWEST_DELAY,
            None => self.last_arrival.max(self.created) + reordering + OLDER_DELAY,
        })
    }

    /// Restores lost source symbols if enough symbols have arrived; returns the packets completed by it.
    pub(super) fn decode(&mut self) -> Result<Vec<Vec<u8>>, &'static str> {
        let Some(source_count) = self.source_count.filter(|_| !self.decoded) else {
            return Ok(Vec::new());
        };
        let received = self.source_symbols.iter().flatten().count();
        // Reed–Solomon is MDS: any `source_count` symbols restore the block, fewer restore none of it.
        if received + self.repair_symbols.iter().flatten().count() < source_count {
            return Ok(Vec::new());
        }
        if received < source_count {
            self.restore(source_count)?;
        }
        self.decoded = true;
        let mut packets = Vec::new();
        for index in 0..source_count {
            packets.extend(self.packet_at(index)?);
        }
        Ok(packets)
    }

    fn restore(&mut self, source_count: usize) -> Result<(), &'static str> {
        let repair = self.repair_symbols.iter().enumerate();
        let repair: Vec<(usize, &Vec<u8>)> = repair
            .filter_map(|(index, symbol)| Some((index, symbol.as_ref()?)))
            .collect();
        // The last symbol of a packet is sent without its padding.
        let symbol_bytes = repair.first().map_or(0, |(_, symbol)| symbol.len());
        let padded = |(index, symbol): (usize, &Option<Vec<u8>>)| {
            let mut symbol = symbol.clone()?;
            // Never truncated: a source symbol longer than the repair symbols must make the decoder refuse
            // the block.
            symbol.resize(symbol_bytes.max(symbol.len()), 0);
            Some((index, symbol))
        };
        let source = self.source_symbols.iter().enumerate();
        let source: Vec<_> = source.filter_map(padded).collect();
        let repair_count = self.repair_symbols.len();
        let restored = reed_solomon_simd::decode(source_count, repair_count, source, repair)
            .map_err(|_| "the symbols of a block differ in length")?;
        for (index, symbol) in restored {
            self.source_symbols[index] = Some(symbol);
        }
        Ok(())
    }

    /// The packet that contains symbol `index`, if it is complete and has not been delivered.
    pub(super) fn packet_around(&mut self, index: usize) -> Result<Option<Vec<u8>>, &'static str> {
        // Backwards from the symbol that arrived: the first that starts a packet, or is missing, since the
        // packet may start there.
        let may_start = |index: &usize| {
            self.word(*index)
                .is_none_or(|word| word & PACKET_START != 0)
        };
        let Some(first) = (0..=index).rev().find(may_start) else {
            return Err("a block starts within a packet");
        };
        self.packet_at(first)
    }

    /// The packet that starts in symbol `first`; `None` if none does, or it is incomplete or already
    /// delivered.
    fn packet_at(&mut self, first: usize) -> Result<Option<Vec<u8>>, &'static str> {
        let Some(word) = self.word(first).filter(|word| word & PACKET_START != 0) else {
            return Ok(None);
        };
        // A packet may complete by arrival and again by the decoding of its block.
        if self.delivered & (1 << first) != 0 {
            return Ok(None);
        }
        let length = (word & !PACKET_START) as usize;
        if length > SOURCE_SYMBOLS_MAX * SYMBOL_BYTES_MAX {
            return Err("a packet is longer than a block");
        }
        // At most 96 kB by the check above: the length comes from the network.
        let mut packet = Vec::with_capacity(length);
        for index in first.. {
            let left = length - packet.len();
            if left == 0 {
                break;
            }
            let Some(Some(symbol)) = self.source_symbols.get(index) else {
                return Ok(None);
            };
            // Each symbol states the remaining length, so that a forged block cannot mix packets.
            if index > first && self.word(index) != Some(left as u32) {
                return Err("the symbols of a packet do not follow each other");
            }
            let part = &symbol[WORD_BYTES..];
            packet.extend_from_slice(&part[..part.len().min(left)]);
        }
        if packet.is_empty() {
            return Err("a packet is empty");
        }
        self.delivered |= 1 << first;
        Ok(Some(packet))
    }

    /// The word before symbol `index`: the remaining bytes of its packet, and [`PACKET_START`].
    fn word(&self, index: usize) -> Option<u32> {
        let word = self.source_symbols.get(index)?.as_ref()?.first_chunk()?;
        Some(u32::from_le_bytes(*word))
    }
}

/// Delay of an older block's first NACK: symbols that were overtaken may still arrive.
const OLDER_DELAY: Duration = Duration::from_millis(4);
/// Delay of the newest block's first NACK: it stays open for 3 ms, plus jitter, before its repair symbols
/// leave.
const NEWEST_DELAY: Duration = Duration::from_millis(8);
/// Slack added to the round-trip time of a retransmission.
const RETRANSMISSION_SLACK: Duration = Duration::from_millis(10);
/// Maximum number of NACKs of a block. A NACK may be lost, or reach a busy sender before it has closed the
/// block. From the third on the interval doubles: every deadline has passed by then, but a frame without one
/// must complete eventually.
const NACKS_MAX: u32 = 10;
