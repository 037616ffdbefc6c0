//! How much a path loses, and what that asks for: tiles as datagrams with forward error correction
//! where a lost packet would cost a long round trip, and how many parities they need.

use std::time::Duration;

/// What has been seen of a path's losses.
#[derive(Clone, Debug)]
pub(crate) struct LossMeter {
    /// Packets until the last look, ever.
    sent: u64,
    lost: u64,
    /// Share of packets.
    loss: f64,
    lossy: bool,
    /// How much more comes together than independent losses would, 1 or more.
    clumps: f64,
}

impl LossMeter {
    /// Before anything has been seen a path is taken to lose one packet in a hundred: the first
    /// frames of a lossy path shall not be those that teach it.
    pub(crate) const fn new() -> Self {
        Self {
            sent: 0,
            lost: 0,
            loss: FIRST_LOSS,
            lossy: true,
            clumps: 1.0,
        }
    }

    /// Takes note of the packets that have been sent and lost on the connection until now.
    pub(crate) fn observe(&mut self, sent: u64, lost: u64) {
        let new_sent = sent.saturating_sub(self.sent);
        if new_sent < PACKETS_AT_ONCE {
            return;
        }
        let new_lost = lost.saturating_sub(self.lost);
        (self.sent, self.lost) = (sent, lost);
        let share = (new_lost as f64 / new_sent as f64).min(1.0);
        let gain = new_sent as f64 / (new_sent as f64 + PACKETS_REMEMBERED);
        self.loss += gain * (share - self.loss);
        self.lossy = match self.lossy {
            true => self.loss > LOSS_LEAST,
            false => self.loss > LOSS_MOST,
        };
    }

    /// Whether tiles should go as datagrams over a path of this round trip: where it is short a
    /// packet that is sent again comes soon enough, and where nothing is lost parities are waste.
    pub(crate) fn wants_datagrams(&self, round_trip: Duration) -> bool {
        self.lossy && round_trip >= LONG
    }

    /// A block could not be repaired from its parities: losses come in clumps.
    pub(crate) fn on_unrepaired(&mut self) {
        self.clumps = (CLUMPS_GROWTH * self.clumps).min(CLUMPS_MAX);
    }

    /// How many parities a block of `data` pieces gets: so many that one block in ten thousand
    /// loses more, but no more than half as many again.
    pub(crate) fn parities(&mut self, data: usize) -> usize {
        self.clumps = 1.0 + CLUMPS_KEPT * (self.clumps - 1.0);
        let loss = (self.loss.max(LOSS_LEAST) * self.clumps).min(0.5);
        let most = data.div_ceil(2).max(2);
        let enough = |parities: &usize| lost_more(data + parities, *parities, loss) <= UNREPAIRED;
        (1..most).find(enough).unwrap_or(most)
    }

    /// Bytes on the path for each byte of tiles.
    pub(crate) fn overhead(&self) -> f64 {
        let mut meter = self.clone();
        1.0 + meter.parities(TYPICAL_DATA) as f64 / TYPICAL_DATA as f64
    }
}

/// The chance that more than `bearable` of `count` packets are lost, each by chance `loss`.
fn lost_more(count: usize, bearable: usize, loss: f64) -> f64 {
    let mut chance = (1.0 - loss).powi(count as i32);
    let mut kept = chance;
    for lost in 1..=bearable {
        chance *= (count - lost + 1) as f64 / lost as f64 * loss / (1.0 - loss);
        kept += chance;
    }
    1.0 - kept
}

/// A packet that is lost on a shorter round trip comes again within half a frame.
const LONG: Duration = Duration::from_millis(10);
const FIRST_LOSS: f64 = 0.01;
/// Above this a path is lossy: each frame of 60 packets loses one in twenty times …
const LOSS_MOST: f64 = 1e-3;
/// … and below this it is not.
const LOSS_LEAST: f64 = 3e-4;
/// A fraction of a frame would be noise.
const PACKETS_AT_ONCE: u64 = 32;
/// 1.4 seconds of 31.5 Mbit/s: four losses at [`LOSS_MOST`].
const PACKETS_REMEMBERED: f64 = 4000.0;
const UNREPAIRED: f64 = 1e-4;
const CLUMPS_GROWTH: f64 = 1.5;
/// Bursts of eight.
const CLUMPS_MAX: f64 = 8.0;
/// With each block: halved in a second of three blocks a frame.
const CLUMPS_KEPT: f64 = 0.996;
/// Three milliseconds of 31.5 Mbit/s.
const TYPICAL_DATA: usize = 16;

#[cfg(test)]
mod tests {
    use super::*;

    const FAR: Duration = Duration::from_millis(46);

    /// A meter of a path that has lost each `one_in`th of so many packets.
    fn after(packets: u64, one_in: u64) -> LossMeter {
        let mut meter = LossMeter::new();
        for sent in (0..=packets).step_by(100) {
            meter.observe(sent, sent / one_in);
        }
        meter
    }

    #[test]
    fn only_long_lossy_paths_get_datagrams() {
        assert!(LossMeter::new().wants_datagrams(FAR));
        assert!(after(20_000, 100).wants_datagrams(FAR));
        assert!(!after(20_000, 100).wants_datagrams(Duration::from_millis(4)));
        assert!(!after(20_000, u64::MAX).wants_datagrams(FAR));
    }

    #[test]
    fn a_clean_path_that_turns_lossy_gets_them_and_does_not_waver() {
        let mut meter = after(20_000, u64::MAX);
        let (mut changes, mut before) = (0, false);
        for step in 1..400u64 {
            meter.observe(20_000 + 100 * step, step / 2);
            let now = meter.wants_datagrams(FAR);
            changes += u32::from(now != before);
            before = now;
        }
        assert_eq!((before, changes), (true, 1));
    }

    #[test]
    fn parities_follow_the_loss_and_its_clumps() {
        assert_eq!(after(100_000, 100).parities(18), 3);
        assert!(after(100_000, 1000).parities(18) <= 2);
        let mut heavy = after(100_000, 10);
        assert!((7..=9).contains(&heavy.parities(18)));
        let mut clumped = after(100_000, 100);
        (0..6).for_each(|_| clumped.on_unrepaired());
        assert!(clumped.parities(18) >= 6);
        let last = (0..2000).map(|_| clumped.parities(18)).last();
        assert_eq!(last, Some(3));
        assert_eq!(after(1000, 2).parities(1), 2);
    }

    /// Of 4 packets at 1/2: 5 in 16 lose more than 2.
    #[test]
    fn the_chance_is_the_binomial_one() {
        assert!((lost_more(4, 2, 0.5) - 5.0 / 16.0).abs() < 1e-12);
        assert!((lost_more(3, 0, 0.1) - 0.271).abs() < 1e-12);
    }
}
