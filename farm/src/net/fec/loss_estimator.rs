//! Estimator of a path's packet loss, which decides whether tiles travel as datagrams with forward error
//! correction and how many repair symbols a block gets.

use std::time::Duration;

/// Loss estimator of one path.
#[derive(Clone, Debug)]
pub(crate) struct LossEstimator {
    /// Packets sent on the connection until the last observation.
    sent: u64,
    lost: u64,
    /// Estimated share of packets that are lost.
    loss: f64,
    lossy: bool,
    /// Factor, at least 1, by which losses concentrate on fewer blocks than independent ones would.
    burstiness: f64,
}

impl LossEstimator {
    /// An estimator that assumes a loss of one packet in a hundred, so that on a lossy path the first frames
    /// do not suffer.
    pub(crate) const fn new() -> Self {
        Self {
            sent: 0,
            lost: 0,
            loss: INITIAL_LOSS,
            lossy: true,
            burstiness: 1.0,
        }
    }

    /// Updates the estimate with the total numbers of packets that the connection has sent and lost.
    pub(crate) fn observe(&mut self, sent: u64, lost: u64) {
        let new_sent = sent.saturating_sub(self.sent);
        if new_sent < OBSERVATION_PACKETS_MIN {
            return;
        }
        let new_lost = lost.saturating_sub(self.lost);
        (self.sent, self.lost) = (sent, lost);
        let share = (new_lost as f64 / new_sent as f64).min(1.0);
        // Weighted by packets, since observations differ in length: MEMORY_PACKETS of history against those
        // of this observation.
        let gain = new_sent as f64 / (new_sent as f64 + MEMORY_PACKETS);
        self.loss += gain * (share - self.loss);
        // Hysteresis: a path near the threshold must not alternate between the transports.
        self.lossy = match self.lossy {
            true => self.loss > LOSSY_BELOW,
            false => self.loss > LOSSY_ABOVE,
        };
    }

    /// Whether error correction is worthwhile over a path with this round-trip time: on a short path a
    /// retransmission is soon enough, and without loss repair symbols are wasted.
    pub(crate) fn wants_fec(&self, rtt: Duration) -> bool {
        self.lossy && rtt >= FEC_RTT_MIN
    }

    /// Handles a block whose repair symbols did not suffice: losses occur in bursts.
    pub(crate) fn on_decoding_failure(&mut self) {
        self.burstiness = (BURSTINESS_GROWTH * self.burstiness).min(BURSTINESS_MAX);
    }

    /// The number of repair symbols for a block of `source_count`: the smallest with which one block in ten
    /// thousand loses more, but at most half of the source symbols. Called once per block.
    pub(crate) fn repair_count(&mut self, source_count: usize) -> usize {
        self.burstiness = 1.0 + BURSTINESS_DECAY * (self.burstiness - 1.0);
        // Bursts hit fewer blocks, each with more losses, which is modelled as a higher independent loss.
        let loss = (self.loss.max(LOSSY_BELOW) * self.burstiness).min(0.5);
        let most = source_count.div_ceil(2).max(2);
        let is_enough = |repair_count: &usize| {
            loss_tail(source_count + repair_count, *repair_count, loss) <= DECODING_FAILURE
        };
        (1..most).find(is_enough).unwrap_or(most)
    }

    /// Bytes on the path per byte of tiles, at least 1.
    pub(crate) fn overhead(&self) -> f64 {
        let mut estimator = self.clone();
        1.0 + estimator.repair_count(TYPICAL_SOURCE_COUNT) as f64 / TYPICAL_SOURCE_COUNT as f64
    }
}

/// The probability that more than `tolerated` of `count` packets are lost, each independently with
/// probability `loss`: the upper tail of the binomial distribution.
fn loss_tail(count: usize, tolerated: usize, loss: f64) -> f64 {
    let mut term = (1.0 - loss).powi(count as i32);
    let mut sum = term;
    for lost in 1..=tolerated {
        // P(lost) from P(lost − 1) by the ratio of binomial terms.
        term *= (count - lost + 1) as f64 / lost as f64 * loss / (1.0 - loss);
        sum += term;
    }
    // The cancellation is harmless, since the result is compared with a probability as large as 10⁻⁴.
    1.0 - sum
}

/// Minimum RTT for error correction: on shorter paths a retransmission arrives within half a frame.
const FEC_RTT_MIN: Duration = Duration::from_millis(10);
const INITIAL_LOSS: f64 = 0.01;
/// Loss above which a path becomes lossy: about one frame of 60 packets in twenty loses a packet.
const LOSSY_ABOVE: f64 = 1e-3;
/// Loss below which a path is no longer lossy.
const LOSSY_BELOW: f64 = 3e-4;
/// Minimum packets of an observation; fewer, a fraction of a frame, would be noise.
const OBSERVATION_PACKETS_MIN: u64 = 32;
/// Weight of the history in packets: 1.4 seconds at 31.5 Mbit/s, or four losses at [`LOSSY_ABOVE`].
const MEMORY_PACKETS: f64 = 4000.0;
/// Accepted probability that a block loses more than its repair symbols restore.
const DECODING_FAILURE: f64 = 1e-4;
const BURSTINESS_GROWTH: f64 = 1.5;
/// Maximum burstiness: bursts of eight losses.
const BURSTINESS_MAX: f64 = 8.0;
/// Decay per block: the excess of burstiness halves in a second of three blocks a frame.
const BURSTINESS_DECAY: f64 = 0.996;
/// Source symbols of a typical block at 31.5 Mbit/s.
const TYPICAL_SOURCE_COUNT: usize = 16;

#[cfg(test)]
mod tests {
    use super::*;

    const LONG_RTT: Duration = Duration::from_millis(46);

    /// An estimator after this number of packets, of which every `one_in`th was lost.
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

    /// Of 4 packets with loss 1/2, more than 2 are lost with probability 5/16.
    #[test]
    fn loss_tail_is_binomial() {
        assert!((loss_tail(4, 2, 0.5) - 5.0 / 16.0).abs() < 1e-12);
        assert!((loss_tail(3, 0, 0.1) - 0.271).abs() < 1e-12);
    }
}
