//! Receiver of forward error correction: turns datagrams into packets, whether they are late, duplicated,
//! reordered or lost.

use std::collections::BTreeMap;
use std::time::Duration;

use super::Retransmission;
use super::block::ReceivedBlock;
use super::datagram::Datagram;

/// FEC decoder of one connection's tile packets.
#[derive(Debug, Default)]
pub(crate) struct FecDecoder {
    /// The last [`BLOCKS_KEPT`] blocks.
    blocks: BTreeMap<u64, ReceivedBlock>,
    /// The number after the highest block known.
    next: u64,
    /// Reordering between blocks: how long after the creation of a block symbols of the one before still
    /// arrived, as a decaying maximum.
    reordering: Duration,
}

impl FecDecoder {
    /// Handles a datagram to a player; returns the packets completed by it.
    ///
    /// # Errors
    /// The rule that the sender broke.
    pub(crate) fn on_datagram(
        &mut self,
        now: Duration,
        datagram: Datagram<'_>,
    ) -> Result<Vec<Vec<u8>>, &'static str> {
        match datagram {
            Datagram::Source {
                block,
                index,
                bytes,
            } => {
                let Some(block) = self.block(now, block) else {
                    return Ok(Vec::new());
                };
                block.insert_source(usize::from(index), bytes)?;
                // A packet whose symbols have all arrived does not wait for its block: without loss, error
                // correction adds no delay.
                let packet = block.packet_around(usize::from(index))?;
                let mut packets: Vec<_> = packet.into_iter().collect();
                packets.extend(block.decode()?);
                Ok(packets)
            }
            Datagram::Repair {
                block,
                source_count,
                repair_count,
                index,
                bytes,
            } => {
                let Some(block) = self.block(now, block) else {
                    return Ok(Vec::new());
                };
                let counts = [source_count, repair_count, index].map(usize::from);
                block.insert_repair(counts[0], counts[1], counts[2], bytes)?;
                block.decode()
            }
            Datagram::Nack { .. } | Datagram::RequestCopy(_) => Err("the datagram is for nodes"),
        }
    }

    /// Handles a retransmitted packet; returns it if it is still missing.
    pub(crate) fn on_retransmission(&mut self, retransmission: Retransmission) -> Option<Vec<u8>> {
        let block = self.blocks.get_mut(&retransmission.block)?;
        // An index beyond the block is a mistake of the peer without consequences: ignored.
        let bit = 1u64.checked_shl(u32::from(retransmission.index))?;
        let is_missing = block.delivered & bit == 0;
        block.delivered |= bit;
        // The sender answers a NACK with all missing packets, so that another NACK would only repeat it.
        block.answered = true;
        is_missing.then_some(retransmission.packet)
    }

    /// Handles the sender's announcement that it has sent all blocks up to this one.
    pub(crate) fn on_announcement(&mut self, now: Duration, number: u64) {
        if number >= self.next {
            self.block(now, number);
        }
    }

    /// The next NACK that is due, if any.
    pub(crate) fn poll_nack(&mut self, now: Duration, rtt: Duration) -> Option<Datagram<'static>> {
        let (newest, reordering) = (self.next.saturating_sub(1), self.reordering);
        let nack = |(number, block): (&u64, &mut ReceivedBlock)| {
            let timeout = block.nack_timeout(*number >= newest, reordering, rtt)?;
            (timeout <= now).then(|| {
                (block.last_nack, block.nacks) = (Some(now), block.nacks + 1);
                Datagram::Nack {
                    block: *number,
                    received: block.received(),
                }
            })
        };
        self.blocks.iter_mut().find_map(nack)
    }

    /// The time of the next call of [`FecDecoder::poll_nack`]; `None` while no block needs one.
    pub(crate) fn nack_timeout(&self, rtt: Duration) -> Option<Duration> {
        let newest = self.next.saturating_sub(1);
        let timeout = |(number, block): (&u64, &ReceivedBlock)| {
            block.nack_timeout(*number >= newest, self.reordering, rtt)
        };
        self.blocks.iter().filter_map(timeout).min()
    }

    /// The block of that number unless it is too old, created together with missing ones before it.
    fn block(&mut self, now: Duration, number: u64) -> Option<&mut ReceivedBlock> {
        let oldest = self.next.saturating_sub(BLOCKS_KEPT);
        // Numbers come from the network: each needs a successor, and old blocks must not be created again.
        if number < oldest || number == u64::MAX {
            return None;
        }
        if number >= self.next {
            // However far the number jumps, only the last BLOCKS_KEPT blocks are created.
            let first = self.next.max((number + 1).saturating_sub(BLOCKS_KEPT));
            for skipped in first..=number {
                self.blocks.insert(skipped, ReceivedBlock::new(now));
            }
            self.reordering = self.reordering.mul_f64(REORDERING_DECAY);
            self.next = number + 1;
            self.blocks = self
                .blocks
                .split_off(&self.next.saturating_sub(BLOCKS_KEPT));
        }
        if let Some(after) = self.blocks.get(&(number + 1)) {
            // A symbol of this block arrived after the next one had begun: a NACK before would have been too
            // early.
            let late = now.saturating_sub(after.created).min(REORDERING_MAX);
            self.reordering = self.reordering.max(late);
        }
        let block = self.blocks.get_mut(&number)?;
        block.last_arrival = now;
        Some(block)
    }
}

/// Blocks kept: half a second of three blocks a frame, far beyond any deadline; 24 MB at most.
const BLOCKS_KEPT: u64 = 96;
/// Decay per block: half in two seconds of three blocks a frame.
const REORDERING_DECAY: f64 = 0.998;
/// A longer delay counts as loss.
const REORDERING_MAX: Duration = Duration::from_millis(50);

#[cfg(test)]
mod tests {
    use super::super::encoder::FecEncoder;
    use super::super::loss_estimator::LossEstimator;
    use super::*;
    use carom_testkit::link_emulator::{LinkConfig, LinkEmulator};
    use carom_testkit::random::SplitMix64;

    const MS: Duration = Duration::from_millis(1);
    const DATAGRAM_BYTES: usize = 1400;

    /// A sender and a receiver with a path in each direction between them.
    struct CodecPair {
        encoder: FecEncoder,
        decoder: FecDecoder,
        losses: LossEstimator,
        there: LinkEmulator,
        back: LinkEmulator,
        /// Datagrams in flight with their arrival times.
        datagrams: Vec<(Duration, Vec<u8>)>,
        nacks: Vec<(Duration, Vec<u8>)>,
        retransmissions: Vec<(Duration, Retransmission)>,
        announcements: Vec<(Duration, u64)>,
        /// Numbers of datagrams sent and lost.
        sent: (u64, u64),
        duplicated: f64,
        random: SplitMix64,
        delivered: Vec<(Duration, Vec<u8>)>,
    }

    impl CodecPair {
        fn new(config: LinkConfig, duplicated: f64) -> Self {
            Self {
                encoder: FecEncoder::default(),
                decoder: FecDecoder::default(),
                losses: LossEstimator::new(),
                there: LinkEmulator::new(config, 3),
                back: LinkEmulator::new(config, 4),
                datagrams: Vec::new(),
                nacks: Vec::new(),
                retransmissions: Vec::new(),
                announcements: Vec::new(),
                sent: (0, 0),
                duplicated,
                random: SplitMix64::new(5),
                delivered: Vec::new(),
            }
        }

        fn send(&mut self, now: Duration, datagrams: Vec<Vec<u8>>) {
            for datagram in datagrams {
                assert!(datagram.len() <= DATAGRAM_BYTES);
                self.sent.0 += 1;
                match self.there.send(now, datagram.len()) {
                    Some(at) => {
                        if self.random.uniform() < self.duplicated {
                            self.datagrams.push((at + 7 * MS, datagram.clone()));
                        }
                        self.datagrams.push((at, datagram));
                    }
                    None => self.sent.1 += 1,
                }
            }
        }

        fn step(&mut self, now: Duration, rtt: Duration) {
            if self.encoder.close_timeout().is_some_and(|at| at <= now) {
                let repair = self.encoder.close(&mut self.losses);
                self.send(now, repair);
                self.losses.observe(self.sent.0, self.sent.1);
            }
            let mut arrived: Vec<_> = self
                .datagrams
                .extract_if(.., |(at, _)| *at <= now)
                .collect();
            arrived.sort_by_key(|(at, _)| *at);
            for (at, bytes) in arrived {
                let datagram = Datagram::parse(&bytes).unwrap();
                let packets = self.decoder.on_datagram(at, datagram).unwrap();
                self.delivered
                    .extend(packets.into_iter().map(|packet| (at, packet)));
            }
            if self.encoder.announce_timeout().is_some_and(|at| at <= now) {
                let last = self.encoder.announce_last();
                self.announcements
                    .extend(last.map(|last| (now + rtt / 2, last)));
            }
            for (_, last) in self.announcements.extract_if(.., |(at, _)| *at <= now) {
                self.decoder.on_announcement(now, last);
            }
            while let Some(nack) = self.decoder.poll_nack(now, rtt) {
                let at = self.back.send(now, 17);
                self.nacks.extend(at.map(|at| (at, nack.to_bytes())));
            }
            for (at, bytes) in self.nacks.extract_if(.., |(at, _)| *at <= now) {
                let Some(Datagram::Nack { block, received }) = Datagram::parse(&bytes) else {
                    panic!("a NACK cannot be parsed");
                };
                let packets = self.encoder.retransmit(block, received).into_iter();
                self.losses.on_decoding_failure();
                let packets = packets.map(|packet| (at + rtt / 2, packet));
                self.retransmissions.extend(packets);
            }
            for (at, packet) in self.retransmissions.extract_if(.., |(at, _)| *at <= now) {
                let packet = self.decoder.on_retransmission(packet);
                self.delivered.extend(packet.map(|packet| (at, packet)));
            }
        }
    }

    /// Sends sixteen numbered packets of 4 kB over 8 ms of each frame; their delays, sorted.
    fn transfer(config: LinkConfig, duplicated: f64, frames: u32) -> (Vec<Duration>, CodecPair) {
        let mut pair = CodecPair::new(config, duplicated);
        let rtt = 2 * config.delay + MS;
        let mut sent = Vec::new();
        let half_ms = Duration::from_micros(500);
        for tick in 0..frames * 33 + 600 {
            let now = tick * half_ms;
            if tick < frames * 33 && tick % 33 < 16 {
                let mut packet = vec![tick as u8; 4056 - 700 * (tick as usize % 4)];
                packet[..4].copy_from_slice(&(sent.len() as u32).to_le_bytes());
                sent.push((now, packet.clone()));
                let losses = &mut pair.losses;
                let datagrams = pair.encoder.push(now, packet, DATAGRAM_BYTES, losses);
                pair.send(now, datagrams.unwrap());
            }
            pair.step(now, rtt);
        }
        let mut delays = vec![None; sent.len()];
        for (at, packet) in &pair.delivered {
            let number = u32::from_le_bytes(*packet.first_chunk().unwrap()) as usize;
            assert_eq!(*packet, sent[number].1, "packet {number} has changed");
            assert_eq!(delays[number], None, "packet {number} came twice");
            delays[number] = Some(*at - sent[number].0);
        }
        let lost = 9999 * MS;
        let mut delays: Vec<Duration> = delays
            .into_iter()
            .map(|delay| delay.unwrap_or(lost))
            .collect();
        delays.sort_unstable();
        (delays, pair)
    }

    fn long_path(loss: f64, burst: f64) -> LinkConfig {
        LinkConfig {
            delay: 23 * MS,
            jitter: Duration::from_micros(200),
            loss,
            burst,
            ..LinkConfig::default()
        }
    }

    fn quantile(delays: &[Duration], share: f64) -> Duration {
        delays[((delays.len() - 1) as f64 * share) as usize]
    }

    #[test]
    fn one_percent_loss_costs_no_round_trip() {
        let (delays, pair) = transfer(long_path(0.01, 1.0), 0.0, 300);
        assert!(
            quantile(&delays, 0.99) < 29 * MS,
            "{:?}",
            quantile(&delays, 0.99)
        );
        assert!(quantile(&delays, 0.9995) < 90 * MS);
        assert!(delays.last().unwrap() < &(200 * MS), "{:?}", delays.last());
        let packets: usize = pair.delivered.iter().map(|(_, packet)| packet.len()).sum();
        let overhead = pair.sent.0 as f64 * DATAGRAM_BYTES as f64 / packets as f64;
        assert!(overhead < 1.5, "{overhead}");
    }

    #[test]
    fn bursts_reordering_and_duplicates_lose_nothing() {
        for (loss, burst, reorder, duplicated) in [
            (0.01, 4.0, 0.0, 0.0),
            (0.02, 6.0, 0.0, 0.0),
            (0.0, 1.0, 0.3, 0.3),
            (0.05, 2.0, 0.2, 0.2),
        ] {
            let config = LinkConfig {
                reorder,
                ..long_path(loss, burst)
            };
            let (delays, _) = transfer(config, duplicated, 80);
            let missing = delays.iter().filter(|delay| **delay > 100 * MS).count();
            let share = missing as f64 / delays.len() as f64;
            assert!(
                share < 0.005,
                "{share} missing at {loss}, {burst}, {reorder}"
            );
        }
    }

    #[test]
    fn a_path_without_loss_needs_no_nack() {
        let (delays, pair) = transfer(long_path(0.0, 1.0), 0.0, 100);
        assert!(delays.last().unwrap() < &(30 * MS));
        assert!(
            pair.encoder.close_timeout().is_none()
                && pair.decoder.blocks.values().all(|b| b.nacks == 0)
        );
    }

    /// Every fiftieth datagram overtakes others by 11 ms, which is four blocks.
    #[test]
    fn reordered_symbols_are_waited_for() {
        let config = LinkConfig {
            reorder: 0.02,
            ..long_path(0.0, 1.0)
        };
        let (delays, pair) = transfer(config, 0.0, 100);
        assert!(delays.last().unwrap() < &(30 * MS), "{:?}", delays.last());
        let nacks: u32 = pair.decoder.blocks.values().map(|block| block.nacks).sum();
        let blocks = pair.decoder.blocks.len();
        assert!(
            nacks as usize * 20 < blocks,
            "{nacks} NACKs for {blocks} blocks"
        );
    }

    /// The only block is lost entirely, and so are the first four NACKs.
    #[test]
    fn a_last_block_that_is_lost_whole_is_recovered() {
        let (mut encoder, mut decoder) = (FecEncoder::default(), FecDecoder::default());
        let mut losses = LossEstimator::new();
        let (rtt, packet) = (46 * MS, vec![7; 900]);
        let sent = encoder.push(MS, packet.clone(), DATAGRAM_BYTES, &mut losses);
        assert!(!sent.unwrap().is_empty() && encoder.announce_timeout().is_none());
        encoder.close(&mut losses);
        let announced = encoder.announce_timeout().unwrap();
        let last = encoder.announce_last().unwrap();
        assert!(encoder.announce_timeout().is_none());
        decoder.on_announcement(announced, last);
        let mut now = announced;
        for lost in 0..5 {
            now = decoder.nack_timeout(rtt).unwrap();
            let nack = decoder.poll_nack(now, rtt);
            let Some(Datagram::Nack { block, received: 0 }) = nack else {
                panic!("{nack:?}");
            };
            if lost < 4 {
                continue;
            }
            let packets = encoder.retransmit(block, 0).into_iter();
            let delivered: Vec<_> = packets
                .filter_map(|packet| decoder.on_retransmission(packet))
                .collect();
            assert_eq!(delivered, std::slice::from_ref(&packet));
        }
        assert!(now < Duration::from_secs(1) && decoder.nack_timeout(rtt).is_none());
    }

    #[test]
    fn no_datagrams_panic_the_decoder() {
        let mut random = SplitMix64::new(1);
        for _ in 0..2000 {
            let mut decoder = FecDecoder::default();
            for _ in 0..20 {
                let bytes: Vec<u8> = (0..2 + random.below(12))
                    .map(|_| random.word() as u8)
                    .collect();
                let block = random.below(3);
                let index = random.below(4) as u8;
                let datagram = match random.below(2) {
                    0 => Datagram::Source {
                        block,
                        index,
                        bytes: &bytes,
                    },
                    _ => Datagram::Repair {
                        block,
                        source_count: 1 + random.below(4) as u8,
                        repair_count: 4,
                        index,
                        bytes: &bytes,
                    },
                };
                let written = datagram.to_bytes();
                if let Some(datagram) = Datagram::parse(&written)
                    && decoder.on_datagram(MS, datagram).is_err()
                {
                    break;
                }
            }
        }
    }

    #[test]
    fn a_leap_of_block_numbers_costs_no_memory() {
        let mut decoder = FecDecoder::default();
        for block in [0, u64::MAX - 1, u64::MAX, 5, u64::MAX - 3] {
            let datagram = Datagram::Source {
                block,
                index: 0,
                bytes: &[8, 0, 0, 0x80, 1, 2],
            };
            assert_eq!(decoder.on_datagram(MS, datagram), Ok(Vec::new()));
            assert!(decoder.blocks.len() <= BLOCKS_KEPT as usize);
        }
    }
}
