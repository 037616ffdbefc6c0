//! Datagrams back to tile packets, however they come: late, twice, in another order or not at all.
//! What the parities do not repair is asked for. Pure; `now` is an argument.

use std::collections::BTreeMap;
use std::time::Duration;

use super::block::Block;
use super::datagram::Datagram;
use super::encoder::Repair;

/// The receiver's end of [`super::encoder`].
#[derive(Debug, Default)]
pub(crate) struct Assembly {
    /// Those that are not whole, and those that were until a moment ago.
    blocks: BTreeMap<u64, Block>,
    /// The first block that has not been heard of.
    next: u64,
    /// How long after a block had begun pieces of those before it still came, the most of late.
    overtaken: Duration,
}

impl Assembly {
    /// Takes a datagram that is for players; the packets that it makes whole.
    ///
    /// # Errors
    /// What the sender did wrong.
    pub(crate) fn receive(
        &mut self,
        now: Duration,
        datagram: Datagram<'_>,
    ) -> Result<Vec<Vec<u8>>, &'static str> {
        match datagram {
            Datagram::Data {
                block,
                index,
                bytes,
            } => {
                let Some(block) = self.block(now, block) else {
                    return Ok(Vec::new());
                };
                block.insert_piece(usize::from(index), bytes)?;
                let mut packets = block.packet_around(usize::from(index))?;
                packets.extend(block.repair()?);
                Ok(packets)
            }
            Datagram::Parity {
                block,
                data,
                parity,
                index,
                bytes,
            } => {
                let Some(block) = self.block(now, block) else {
                    return Ok(Vec::new());
                };
                block.insert_parity(usize::from(data), parity, index, bytes)?;
                block.repair()
            }
            Datagram::Missing { .. } | Datagram::Copy(_) => Err("a datagram is for nodes"),
        }
    }

    /// Takes a packet that was sent whole; it, if it is still missing.
    pub(crate) fn receive_repair(&mut self, repair: Repair) -> Option<Vec<u8>> {
        let block = self.blocks.get_mut(&repair.block)?;
        let bit = 1u64.checked_shl(u32::from(repair.index))?;
        let missing = block.delivered & bit == 0;
        block.delivered |= bit;
        block.answered = true;
        missing.then_some(repair.packet)
    }

    /// Takes note that the sender has sent all blocks up to this one.
    pub(crate) fn expect(&mut self, now: Duration, number: u64) {
        if number >= self.next {
            self.block(now, number);
        }
    }

    /// The next block of which pieces are missing for too long, if there is one; `round_trip` is
    /// how long an answer takes.
    pub(crate) fn poll_missing(
        &mut self,
        now: Duration,
        round_trip: Duration,
    ) -> Option<Datagram<'static>> {
        let (newest, overtaken) = (self.next.saturating_sub(1), self.overtaken);
        let due = |(number, block): (&u64, &mut Block)| {
            let asks = block.due(*number < newest, overtaken, round_trip)? <= now;
            asks.then(|| {
                (block.asked, block.asks) = (Some(now), block.asks + 1);
                Datagram::Missing {
                    block: *number,
                    held: block.held(),
                }
            })
        };
        self.blocks.iter_mut().find_map(due)
    }

    /// When [`Assembly::poll_missing`] wants to be called.
    pub(crate) fn next_timeout(&self, round_trip: Duration) -> Option<Duration> {
        let (newest, overtaken) = (self.next.saturating_sub(1), self.overtaken);
        let due =
            |(number, block): (&u64, &Block)| block.due(*number < newest, overtaken, round_trip);
        self.blocks.iter().filter_map(due).min()
    }

    /// A block that is not too old, and with it those before it of which nothing has come.
    fn block(&mut self, now: Duration, number: u64) -> Option<&mut Block> {
        let oldest = self.next.saturating_sub(BLOCKS_KEPT);
        if number < oldest || number == u64::MAX {
            return None;
        }
        if number >= self.next {
            let first = self.next.max((number + 1).saturating_sub(BLOCKS_KEPT));
            for skipped in first..=number {
                self.blocks.insert(skipped, Block::new(now));
            }
            self.overtaken = self.overtaken.mul_f64(OVERTAKEN_KEPT);
            self.next = number + 1;
            self.blocks = self
                .blocks
                .split_off(&self.next.saturating_sub(BLOCKS_KEPT));
        }
        if let Some(after) = self.blocks.get(&(number + 1)) {
            let overtaken = now.saturating_sub(after.began).min(OVERTAKEN_MAX);
            self.overtaken = self.overtaken.max(overtaken);
        }
        let block = self.blocks.get_mut(&number)?;
        block.heard = now;
        Some(block)
    }
}

/// Half a second of three blocks a frame: far beyond any deadline. 24 MB at most.
const BLOCKS_KEPT: u64 = 96;
/// Each block; halved in two seconds of three blocks a frame.
const OVERTAKEN_KEPT: f64 = 0.998;
/// What comes later is not waited for, but asked for.
const OVERTAKEN_MAX: Duration = Duration::from_millis(50);

#[cfg(test)]
mod tests {
    use super::super::encoder::Blocks;
    use super::super::loss_estimator::LossMeter;
    use super::*;
    use crate::net::path::{Path, PathConfig};
    use crate::sim::random::Random;

    const MS: Duration = Duration::from_millis(1);
    const DATAGRAM_BYTES: usize = 1400;

    /// A sender and a receiver with a path each way between them.
    struct Pair {
        blocks: Blocks,
        assembly: Assembly,
        losses: LossMeter,
        there: Path,
        back: Path,
        /// When, and what; answers whole.
        flying: Vec<(Duration, Vec<u8>)>,
        asked: Vec<(Duration, Vec<u8>)>,
        repairs: Vec<(Duration, Repair)>,
        told: Vec<(Duration, u64)>,
        sent: (u64, u64),
        repeated: f64,
        random: Random,
        came: Vec<(Duration, Vec<u8>)>,
    }

    impl Pair {
        fn new(config: PathConfig, repeated: f64) -> Self {
            Self {
                blocks: Blocks::default(),
                assembly: Assembly::default(),
                losses: LossMeter::new(),
                there: Path::new(config, 3),
                back: Path::new(config, 4),
                flying: Vec::new(),
                asked: Vec::new(),
                repairs: Vec::new(),
                told: Vec::new(),
                sent: (0, 0),
                repeated,
                random: Random::new(5),
                came: Vec::new(),
            }
        }

        fn send(&mut self, now: Duration, datagrams: Vec<Vec<u8>>) {
            for datagram in datagrams {
                assert!(datagram.len() <= DATAGRAM_BYTES);
                self.sent.0 += 1;
                match self.there.send(now, datagram.len()) {
                    Some(at) => {
                        if self.random.uniform() < self.repeated {
                            self.flying.push((at + 7 * MS, datagram.clone()));
                        }
                        self.flying.push((at, datagram));
                    }
                    None => self.sent.1 += 1,
                }
            }
        }

        fn step(&mut self, now: Duration, round_trip: Duration) {
            if self.blocks.due().is_some_and(|due| due <= now) {
                let parities = self.blocks.close(&mut self.losses);
                self.send(now, parities);
                self.losses.observe(self.sent.0, self.sent.1);
            }
            let mut arrived: Vec<_> = self.flying.extract_if(.., |(at, _)| *at <= now).collect();
            arrived.sort_by_key(|(at, _)| *at);
            for (at, bytes) in arrived {
                let datagram = Datagram::parse(&bytes).unwrap();
                let packets = self.assembly.receive(at, datagram).unwrap();
                self.came
                    .extend(packets.into_iter().map(|packet| (at, packet)));
            }
            if self.blocks.tell_due().is_some_and(|due| due <= now) {
                let told = self.blocks.tell().map(|last| (now + round_trip / 2, last));
                self.told.extend(told);
            }
            for (_, last) in self.told.extract_if(.., |(at, _)| *at <= now) {
                self.assembly.expect(now, last);
            }
            while let Some(missing) = self.assembly.poll_missing(now, round_trip) {
                let at = self.back.send(now, 17);
                self.asked.extend(at.map(|at| (at, missing.to_bytes())));
            }
            for (at, bytes) in self.asked.extract_if(.., |(at, _)| *at <= now) {
                let Some(Datagram::Missing { block, held }) = Datagram::parse(&bytes) else {
                    panic!("a question was not understood");
                };
                let answers = self.blocks.repair(block, held).into_iter();
                self.losses.on_unrepaired();
                let answers = answers.map(|repair| (at + round_trip / 2, repair));
                self.repairs.extend(answers);
            }
            for (at, repair) in self.repairs.extract_if(.., |(at, _)| *at <= now) {
                let packet = self.assembly.receive_repair(repair);
                self.came.extend(packet.map(|packet| (at, packet)));
            }
        }
    }

    /// Sixteen packets of 4 kB over 8 ms of each frame, each numbered: how late each came, sorted.
    fn play(config: PathConfig, repeated: f64, frames: u32) -> (Vec<Duration>, Pair) {
        let mut pair = Pair::new(config, repeated);
        let round_trip = 2 * config.delay + MS;
        let mut sent = Vec::new();
        let half_ms = Duration::from_micros(500);
        for tick in 0..frames * 33 + 600 {
            let now = tick * half_ms;
            if tick < frames * 33 && tick % 33 < 16 {
                let mut packet = vec![tick as u8; 4056 - 700 * (tick as usize % 4)];
                packet[..4].copy_from_slice(&(sent.len() as u32).to_le_bytes());
                sent.push((now, packet.clone()));
                let losses = &mut pair.losses;
                let datagrams = pair.blocks.push(now, packet, DATAGRAM_BYTES, losses);
                pair.send(now, datagrams.unwrap());
            }
            pair.step(now, round_trip);
        }
        let mut late = vec![None; sent.len()];
        for (at, packet) in &pair.came {
            let number = u32::from_le_bytes(*packet.first_chunk().unwrap()) as usize;
            assert_eq!(*packet, sent[number].1, "packet {number} has changed");
            assert_eq!(late[number], None, "packet {number} came twice");
            late[number] = Some(*at - sent[number].0);
        }
        let mut late: Vec<Duration> = late.into_iter().map(|at| at.unwrap_or(9999 * MS)).collect();
        late.sort_unstable();
        (late, pair)
    }

    fn long(loss: f64, burst: f64) -> PathConfig {
        PathConfig {
            delay: 23 * MS,
            jitter: Duration::from_micros(200),
            loss,
            burst,
            ..PathConfig::default()
        }
    }

    fn quantile(late: &[Duration], share: f64) -> Duration {
        late[((late.len() - 1) as f64 * share) as usize]
    }

    #[test]
    fn one_packet_in_a_hundred_lost_delays_no_tile_by_a_round_trip() {
        let (late, pair) = play(long(0.01, 1.0), 0.0, 300);
        assert!(
            quantile(&late, 0.99) < 29 * MS,
            "{:?}",
            quantile(&late, 0.99)
        );
        assert!(quantile(&late, 0.9995) < 90 * MS);
        assert!(late.last().unwrap() < &(200 * MS), "{:?}", late.last());
        let packets: usize = pair.came.iter().map(|(_, packet)| packet.len()).sum();
        let overhead = pair.sent.0 as f64 * DATAGRAM_BYTES as f64 / packets as f64;
        assert!(overhead < 1.5, "{overhead}");
    }

    #[test]
    fn bursts_reordering_and_repeats_lose_nothing_and_change_nothing() {
        for (loss, burst, reorder, repeated) in [
            (0.01, 4.0, 0.0, 0.0),
            (0.02, 6.0, 0.0, 0.0),
            (0.0, 1.0, 0.3, 0.3),
            (0.05, 2.0, 0.2, 0.2),
        ] {
            let config = PathConfig {
                reorder,
                ..long(loss, burst)
            };
            let (late, _) = play(config, repeated, 80);
            let missing = late.iter().filter(|late| **late > 100 * MS).count();
            let share = missing as f64 / late.len() as f64;
            assert!(
                share < 0.005,
                "{share} missing at {loss}, {burst}, {reorder}"
            );
        }
    }

    #[test]
    fn a_path_that_loses_nothing_is_never_asked_twice() {
        let (late, pair) = play(long(0.0, 1.0), 0.0, 100);
        assert!(late.last().unwrap() < &(30 * MS));
        assert!(pair.blocks.due().is_none() && pair.assembly.blocks.values().all(|b| b.asks == 0));
    }

    /// Each fiftieth datagram overtakes others by 11 ms, four blocks.
    #[test]
    fn what_others_overtook_is_waited_for() {
        let config = PathConfig {
            reorder: 0.02,
            ..long(0.0, 1.0)
        };
        let (late, pair) = play(config, 0.0, 100);
        assert!(late.last().unwrap() < &(30 * MS), "{:?}", late.last());
        let asks: u32 = pair.assembly.blocks.values().map(|block| block.asks).sum();
        let blocks = pair.assembly.blocks.len();
        assert!(
            asks as usize * 20 < blocks,
            "{asks} asks for {blocks} blocks"
        );
    }

    /// Nothing comes of the only block, nor of the first four questions.
    #[test]
    fn a_last_block_that_is_lost_whole_is_missed_and_comes() {
        let (mut blocks, mut assembly) = (Blocks::default(), Assembly::default());
        let mut losses = LossMeter::new();
        let (round_trip, packet) = (46 * MS, vec![7; 900]);
        let sent = blocks.push(MS, packet.clone(), DATAGRAM_BYTES, &mut losses);
        assert!(!sent.unwrap().is_empty() && blocks.tell_due().is_none());
        blocks.close(&mut losses);
        let told = blocks.tell_due().unwrap();
        let last = blocks.tell().unwrap();
        assert!(blocks.tell_due().is_none());
        assembly.expect(told, last);
        let mut now = told;
        for lost in 0..5 {
            now = assembly.next_timeout(round_trip).unwrap();
            let asked = assembly.poll_missing(now, round_trip);
            let Some(Datagram::Missing { block, held: 0 }) = asked else {
                panic!("{asked:?}");
            };
            if lost < 4 {
                continue;
            }
            let repairs = blocks.repair(block, 0).into_iter();
            let came: Vec<_> = repairs
                .filter_map(|repair| assembly.receive_repair(repair))
                .collect();
            assert_eq!(came, std::slice::from_ref(&packet));
        }
        assert!(now < Duration::from_secs(1) && assembly.next_timeout(round_trip).is_none());
    }

    #[test]
    fn any_datagrams_are_met_by_a_packet_or_a_reason() {
        let mut random = Random::new(1);
        for _ in 0..2000 {
            let mut assembly = Assembly::default();
            for _ in 0..20 {
                let bytes: Vec<u8> = (0..2 + random.below(12))
                    .map(|_| random.word() as u8)
                    .collect();
                let block = random.below(3);
                let index = random.below(4) as u8;
                let datagram = match random.below(2) {
                    0 => Datagram::Data {
                        block,
                        index,
                        bytes: &bytes,
                    },
                    _ => Datagram::Parity {
                        block,
                        data: 1 + random.below(4) as u8,
                        parity: 4,
                        index,
                        bytes: &bytes,
                    },
                };
                let written = datagram.to_bytes();
                if let Some(datagram) = Datagram::parse(&written)
                    && assembly.receive(MS, datagram).is_err()
                {
                    break;
                }
            }
        }
    }

    #[test]
    fn a_leap_of_block_numbers_costs_no_memory() {
        let mut assembly = Assembly::default();
        for block in [0, u64::MAX - 1, u64::MAX, 5, u64::MAX - 3] {
            let datagram = Datagram::Data {
                block,
                index: 0,
                bytes: &[8, 0, 0, 0x80, 1, 2],
            };
            assert_eq!(assembly.receive(MS, datagram), Ok(Vec::new()));
            assert!(assembly.blocks.len() <= BLOCKS_KEPT as usize);
        }
    }
}
