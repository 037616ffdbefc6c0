//! An estimate of a path's packet loss, which decides whether tiles travel as datagrams with
//! forward error correction and how many repair symbols a block needs.

use std::time::Duration;

/// The estimator of one path.
#[derive(Clone, Debug)]
pub(crate) struct LossEstimator {
    /// Packets of the connection until the last observation.
    sent: u64,
    lost: u64,
    /// Share of packets that are lost.
    loss: f64,
    lossy: bool,
    /// Factor by which more losses share a block than independent ones would, 1 or more.
    burstiness: f64,
}

impl LossEstimator {
    /// An estimator that assumes a loss of one packet in a hundred, so that a lossy path does not
    /// cost the first frames.
    pub(crate) const fn new() -> Self {
        Self {
            sent: 0,
            lost: 0,
            loss: INITIAL_LOSS,
            lossy: true,
            burstiness: 1.0,
        }
    }

    /// Updates the estimate with the packets that the connection has sent and lost until now.
    pub(crate) fn observe(&mut self, sent: u64, lost: u64) {
        let new_sent = sent.saturating_sub(self.sent);
        if new_sent < OBSERVATION_PACKETS_MIN {
            return;
        }
        let new_lost = lost.saturating_sub(self.lost);
        (self.sent, self.lost) = (sent, lost);
        let share = (new_lost as f64 / new_sent as f64).min(1.0);
        // Weighted by packets, as observations are of unequal length.
        // As much as MEMORY_PACKETS packets of history weigh against those of the observation.
        let gain = new_sent as f64 / (new_sent as f64 + MEMORY_PACKETS);
        self.loss += gain * (share - self.loss);
        // Hysteresis: a path at the threshold must not alternate between transports.
        self.lossy = match self.lossy {
            true => self.loss > LOSSY_BELOW,
            false => self.loss > LOSSY_ABOVE,
        };
    }

    /// Whether error correction pays over a path with this round-trip time: on a short path a
    /// retransmission comes soon enough, and without loss repair symbols are waste.
    pub(crate) fn wants_fec(&self, rtt: Duration) -> bool {
        self.lossy && rtt >= FEC_RTT_MIN
    }

    /// Handles a block whose repair symbols did not suffice: losses come in bursts.
    pub(crate) fn on_decoding_failure(&mut self) {
        self.burstiness = (BURSTINESS_GROWTH * self.burstiness).min(BURSTINESS_MAX);
    }

    /// Repair symbols for a block of `source_count` symbols: so many that one block in ten thousand
    /// loses more, but at most half as many as source symbols.
    pub(crate) fn repair_count(&mut self, source_count: usize) -> usize {
        self.burstiness = 1.0 + BURSTINESS_DECAY * (self.burstiness - 1.0);
        // Losses in bursts hit fewer blocks with more each; a higher loss of independent packets stands
        // for that.
        let loss = (self.loss.max(LOSSY_BELOW) * self.burstiness).min(0.5);
        let most = source_count.div_ceil(2).max(2);
        let is_enough = |repair_count: &usize| {
            loss_tail(source_count + repair_count, *repair_count, loss) <= DECODING_FAILURE
        };
        (1..most).find(is_enough).unwrap_or(most)
    }

    /// Bytes on the path for each byte of tiles, 1 or more.
    pub(crate) fn overhead(&self) -> f64 {
        let mut estimator = self.clone();
        1.0 + estimator.repair_count(TYPICAL_SOURCE_COUNT) as f64 / TYPICAL_SOURCE_COUNT as f64
    }
}

/// The probability that more than `tolerated` of `count` packets are lost, each with probability
/// `loss`: the upper tail of the binomial distribution.
fn loss_tail(count: usize, tolerated: usize, loss: f64) -> f64 {
    let mut term = (1.0 - loss).powi(count as i32);
    let mut sum = term;
    for lost in 1..=tolerated {
        // P(lost) from P(lost − 1), without factorials.
        term *= (count - lost + 1) as f64 / lost as f64 * loss / (1.0 - loss);
        sum += term;
    }
    1.0 - sum
}

/// Over a shorter round trip a retransmission comes within half a frame.
const FEC_RTT_MIN: Duration = Duration::from_millis(10);
const INITIAL_LOSS: f64 = 0.01;
/// Above this a path is lossy: each frame of 60 packets loses one in twenty times …
const LOSSY_ABOVE: f64 = 1e-3;
/// … and below this it is not.
const LOSSY_BELOW: f64 = 3e-4;
/// Fewer packets, a fraction of a frame, would be noise.
const OBSERVATION_PACKETS_MIN: u64 = 32;
/// 1.4 seconds of 31.5 Mbit/s: four losses at [`LOSSY_ABOVE`].
const MEMORY_PACKETS: f64 = 4000.0;
const DECODING_FAILURE: f64 = 1e-4;
const BURSTINESS_GROWTH: f64 = 1.5;
/// Bursts of eight.
const BURSTINESS_MAX: f64 = 8.0;
/// A block: burstiness halves in a second of three blocks a frame.
const BURSTINESS_DECAY: f64 = 0.996;
/// A block of 31.5 Mbit/s.
const TYPICAL_SOURCE_COUNT: usize = 16;

#[cfg(test)]
mod tests {
    use super::*;

    const LONG_RTT: Duration = Duration::from_millis(46);

    /// An estimator of a path that has lost each `one_in`th of so many packets.
    fn after(packets: u64, one_in: u64) -> LossEstimator {
        let mut estimator = LossEstimator::new();
        for sent in (0..=packets).step_by(100) {
            estimator.observe(sent, sent / one_in);
        }
        estimator
    }

    #[test]
    fn only_long_lossy_paths_want_fec() {
        assert!(LossEstimator::new().wants_fec(LONG_RTT));
        assert!(after(20_000, 100).wants_fec(LONG_RTT));
        assert!(!after(20_000, 100).wants_fec(Duration::from_millis(4)));
        assert!(!after(20_000, u64::MAX).wants_fec(LONG_RTT));
    }

    #[test]
    fn a_path_that_turns_lossy_wants_fec_once() {
        let mut estimator = after(20_000, u64::MAX);
        let (mut changes, mut before) = (0, false);
        for step in 1..400u64 {
            estimator.observe(20_000 + 100 * step, step / 2);
            let now = estimator.wants_fec(LONG_RTT);
            changes += u32::from(now != before);
            before = now;
        }
        assert_eq!((before, changes), (true, 1));
    }

    #[test]
    fn repair_count_follows_loss_and_burstiness() {
        assert_eq!(after(100_000, 100).repair_count(18), 3);
        assert!(after(100_000, 1000).repair_count(18) <= 2);
        let mut heavy = after(100_000, 10);
        assert!((7..=9).contains(&heavy.repair_count(18)));
        let mut bursty = after(100_000, 100);
        (0..6).for_each(|_| bursty.on_decoding_failure());
        assert!(bursty.repair_count(18) >= 6);
        let last = (0..2000).map(|_| bursty.repair_count(18)).last();
        assert_eq!(last, Some(3));
        assert_eq!(after(1000, 2).repair_count(1), 2);
    }

    /// Of 4 packets at 1/2: 5 in 16 lose more than 2.
    #[test]
    fn loss_tail_is_binomial() {
        assert!((loss_tail(4, 2, 0.5) - 5.0 / 16.0).abs() < 1e-12);
        assert!((loss_tail(3, 0, 0.1) - 0.271).abs() < 1e-12);
    }
}
