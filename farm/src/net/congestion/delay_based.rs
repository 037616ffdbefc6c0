//! Congestion window that follows queueing delay instead of loss: FAST TCP (Wei, Jin, Low and Hegde,
//! IEEE/ACM Transactions on Networking 14(6), 2006). Once per round, with the base RTT of the path
//! and the RTT of the round,
//!
//! ```text
//! cwnd ← min(2·cwnd, (1 − γ)·cwnd + γ·(cwnd · base_rtt / rtt + α))
//! ```
//!
//! whose equilibrium has α bytes of this connection in the bottleneck's queue. Random loss does not change
//! the window; slow start adds half a window per round until packets begin to queue. Terms are those of
//! RFC 9002, RFC 5681 and RFC 7661. The controller is pure: `now` is an argument.

use std::time::Duration;

use super::rtt::{BaseRtt, RttSamples};

/// Congestion controller of one connection; times count from any fixed moment.
#[derive(Clone, Debug)]
pub struct DelayBasedController {
    cwnd: f64,
    max_datagram_bytes: f64,
    slow_start: bool,
    /// The minimum RTT so far, as long as the window is the initial one and has not been validated by the
    /// path (RFC 7661).
    unvalidated: Option<Duration>,
    base_rtt: BaseRtt,
    round: RttRound,
    last_ack: Duration,
    /// Share of bytes lost, smoothed over rounds.
    loss: f64,
    /// Delivery rate in bytes per second: the decaying maximum of the rounds.
    delivery_rate: f64,
}

/// Events of a round, between two updates of the window.
#[derive(Clone, Debug, Default)]
struct RttRound {
    start: Duration,
    acked_bytes: f64,
    lost_bytes: f64,
    /// The longest RTT among the packets of the acknowledgement frame being processed.
    ack_rtt: Option<Duration>,
    rtts: RttSamples,
    /// Whether the window, not the application, held packets back.
    cwnd_limited: bool,
}

impl DelayBasedController {
    /// A controller with the initial window for packets of up to `max_datagram_bytes`.
    pub fn new(now: Duration, max_datagram_bytes: u16) -> Self {
        Self {
            cwnd: initial_cwnd(Duration::ZERO),
            max_datagram_bytes: f64::from(max_datagram_bytes),
            slow_start: true,
            unvalidated: Some(INITIAL_RTT_MAX),
            base_rtt: BaseRtt::default(),
            round: RttRound::starting(now),
            last_ack: now,
            loss: 0.0,
            delivery_rate: 0.0,
        }
    }

    /// Handles the acknowledgement of a packet; `app_limited` states that the application, not the window,
    /// limited what was sent.
    pub fn on_ack(&mut self, now: Duration, sent: Duration, bytes: u64, app_limited: bool) {
        let rtt = now.saturating_sub(sent);
        // Sent after the last acknowledgement: nothing was in flight in between.
        let pause = sent.saturating_sub(std::mem::replace(&mut self.last_ack, now));
        if pause > Duration::ZERO {
            self.end_pause(now, pause);
        }
        let round = &mut self.round;
        round.acked_bytes += bytes as f64;
        round.cwnd_limited |= !app_limited;
        // The longest RTT of the frame, since the shortest is that of a packet that overtook others. If one
        // in fifty overtakes by a quarter of the RTT, the shortest would become the base RTT, all others
        // would seem to queue, and the window would shrink to next to nothing.
        round.ack_rtt = round.ack_rtt.max(Some(rtt));
    }

    /// Handles the end of an acknowledgement frame.
    pub fn on_end_acks(&mut self, now: Duration) {
        let round = &mut self.round;
        let Some(rtt) = round.ack_rtt.take() else {
            return;
        };
        round.rtts.insert(rtt);
        let base_rtt = self.base_rtt.get().unwrap_or(rtt);
        if let Some(min_rtt) = &mut self.unvalidated {
            *min_rtt = rtt.min(*min_rtt);
            self.cwnd = initial_cwnd(*min_rtt);
        }
        let is_over = now.saturating_sub(round.start) >= base_rtt.max(ROUND_MIN);
        // A round ends once a whole window, which it is to judge, has been acknowledged; up to one datagram
        // may be missing. After an outage a window holds fewer packets than RTT_SAMPLES_MIN, so either
        // suffices.
        let is_whole_window = round.acked_bytes >= self.cwnd - self.max_datagram_bytes;
        if is_over && (is_whole_window || round.rtts.len() >= RTT_SAMPLES_MIN) {
            self.end_round(now);
        }
    }

    /// Handles the loss of packets.
    pub fn on_loss(&mut self, bytes: u64) {
        self.round.lost_bytes += bytes as f64;
    }

    /// Handles persistent congestion (RFC 9002, 7.6): nothing has come through for several round trips. What
    /// was known of the path no longer holds when it is back.
    pub fn on_persistent_congestion(&mut self, now: Duration) {
        let max_datagram_bytes = self.max_datagram_bytes as u16;
        *self = Self::new(now, max_datagram_bytes);
        self.cwnd = self.minimum_window();
        self.unvalidated = None;
    }

    /// Handles a change of the path MTU.
    pub fn on_mtu_update(&mut self, max_datagram_bytes: u16) {
        self.max_datagram_bytes = f64::from(max_datagram_bytes);
    }

    /// Bytes that may be in flight.
    pub fn window_bytes(&self) -> u64 {
        self.cwnd as u64
    }

    /// Bytes that may be in flight and that the path has been seen to carry, or carries so likely that pixels
    /// need not be coarser.
    pub fn validated_bytes(&self) -> u64 {
        match self.unvalidated {
            Some(_) => self.cwnd.min(UNVALIDATED_BYTES_MAX) as u64,
            None => self.window_bytes(),
        }
    }

    /// Ends a pause without packets in flight. The few before it tell the base RTT, but nothing about the
    /// window.
    fn end_pause(&mut self, now: Duration, pause: Duration) {
        if self.round.cwnd_limited {
            // The window held packets back before the pause, so the round goes on, without the pause in its
            // duration.
            self.round.start += pause;
            return;
        }
        let round = std::mem::replace(&mut self.round, RttRound::starting(now));
        if let Some(longest) = round.rtts.max()
            && round.rtts.len() >= PAUSE_RTT_SAMPLES_MIN
        {
            self.base_rtt.insert(now, longest);
        }
    }

    fn end_round(&mut self, now: Duration) {
        let mut round = std::mem::replace(&mut self.round, RttRound::starting(now));
        // The RTT of the round is its lower quartile: where other processes occupy a receiver's processor
        // more than half of the time, most acknowledgements are late without any queue. With the median, a
        // client that waits for its processor 12 of each 20 ms got 77 % of 31.5 Mbit/s; with the quartile,
        // all. The base RTT is the minimum of upper quartiles, since packets that overtake others make the
        // lower ones too short.
        let rtts = &mut round.rtts;
        let (Some(early), Some(late)) = (rtts.quantile(0.25), rtts.quantile(0.75)) else {
            return;
        };
        let base_rtt = self.base_rtt.insert(now, late);
        // The lower quartile may lie below the base, a minimum of upper quartiles; a negative queueing delay
        // would let the window grow without bound.
        let rtt = early.max(base_rtt);
        let queueing = rtt.saturating_sub(base_rtt);
        let secs = now.saturating_sub(round.start).as_secs_f64();
        let rate = round.acked_bytes / secs.max(1e-6);
        // A decaying maximum: a round in which the application had little to send is no evidence against the
        // path.
        self.delivery_rate = rate.max(self.delivery_rate * DELIVERY_RATE_DECAY);
        let lost = round.lost_bytes / (round.lost_bytes + round.acked_bytes).max(1.0);
        self.loss += LOSS_GAIN * (lost - self.loss);
        if round.cwnd_limited || queueing > SLOW_START_QUEUEING_MAX {
            self.unvalidated = None;
        }
        if self.loss > LOSS_MAX {
            // The queue is shorter than α. A single loss is no such sign: radio links and long paths lose at
            // random, and halving the window at each loss (Cubic) carried 4 of 31 Mbit/s at 1 %.
            self.slow_start = false;
            self.loss = 0.0;
            self.cwnd *= LOSS_BETA;
        } else if self.slow_start && queueing <= SLOW_START_QUEUEING_MAX.max(base_rtt / 32) {
            if round.cwnd_limited {
                // Half of what was carried, not of the window: a window that the path has not filled is no
                // evidence for a larger one, and this overshoots less once it is filled.
                let carried = rate * base_rtt.as_secs_f64() + self.alpha();
                self.cwnd += 0.5 * self.cwnd.min(carried);
            }
        } else if round.cwnd_limited || 2.0 * rate * rtt.as_secs_f64() >= self.cwnd {
            // Otherwise at most half of the window is in flight: its packets do not queue behind each other,
            // and the window is left alone.
            let delivered = rate * base_rtt.as_secs_f64();
            self.follow_delay(round.cwnd_limited, base_rtt, delivered, queueing);
        }
        if self.base_rtt.is_stale(now) {
            // A minimum kept for ever would mistake a longer route for a queue for ever.
            self.base_rtt.renew(now);
            if round.cwnd_limited {
                // Drains this connection's own queue, so that the new minimum is measured without it.
                self.cwnd *= DRAIN_FACTOR;
            }
        }
        self.cwnd = self.cwnd.clamp(self.minimum_window(), CWND_BYTES_MAX);
    }

    /// Applies the update rule of FAST TCP; `delivered` is the bytes delivered in one base RTT.
    fn follow_delay(
        &mut self,
        cwnd_limited: bool,
        base_rtt: Duration,
        delivered: f64,
        queueing: Duration,
    ) {
        let base_secs = base_rtt.as_secs_f64();
        if self.slow_start {
            // Slow start has overshot one round trip ago: the rate since then is what the path carries.
            self.slow_start = false;
            self.cwnd = self.cwnd.min(self.delivery_rate * base_secs + self.alpha());
        }
        // cwnd · base_rtt / rtt would be in flight without a queue; α more are to wait in it.
        let ratio = base_secs / (base_secs + queueing.as_secs_f64()).max(1e-6);
        // Never below what this round delivered: its RTTs belong to a window that may have been cut since,
        // and would cut it twice.
        let target = delivered.clamp(self.cwnd * ratio, self.cwnd) + self.alpha();
        let next = (1.0 - GAMMA) * self.cwnd + GAMMA * target;
        // An application that sends less than the window does not validate a larger one.
        if cwnd_limited || next < self.cwnd {
            self.cwnd = next.min(2.0 * self.cwnd);
        }
    }

    /// α: bytes of this connection to keep in the bottleneck's queue.
    fn alpha(&self) -> f64 {
        let least = self.minimum_window();
        let queued = (self.delivery_rate * ALPHA_SECS_MAX).clamp(least, ALPHA_BYTES.max(least));
        queued.max(self.cwnd / ALPHA_CWND_DIVISOR)
    }

    fn minimum_window(&self) -> f64 {
        MINIMUM_WINDOW_DATAGRAMS * self.max_datagram_bytes
    }
}

impl RttRound {
    fn starting(start: Duration) -> Self {
        Self {
            start,
            ..Self::default()
        }
    }
}

/// The initial window in bytes for an RTT, by which at most two frames queue at 25 Mbit/s. With 46 ms it is
/// 219 kB, enough for 31.5 Mbit/s and repair symbols, so that the first frames are not slow.
pub(super) fn initial_cwnd(rtt: Duration) -> f64 {
    INITIAL_BYTES_PER_SEC * (rtt.as_secs_f64() / PACING_GAIN + INITIAL_QUEUE_SECS)
}

/// quinn paces at 1.25 windows per round trip.
const PACING_GAIN: f64 = 1.25;
const INITIAL_BYTES_PER_SEC: f64 = 25e6 / 8.0;
/// Duration of two frames at 60 per second.
const INITIAL_QUEUE_SECS: f64 = 2.0 / 60.0;
/// Bound of the RTT for the initial window: a longer handshake depends on the machine more than on the path.
const INITIAL_RTT_MAX: Duration = Duration::from_millis(150);
/// Bytes of two frames of 65 kB.
const UNVALIDATED_BYTES_MAX: f64 = 131_072.0;
/// Base value of α: 5 ms at 25 Mbit/s.
const ALPHA_BYTES: f64 = 16_384.0;
/// Maximum queueing time of α's base value, for slower links.
const ALPHA_SECS_MAX: f64 = 0.008;
/// On faster links α is at least a sixteenth of the window, which adds a fifteenth to the round trip.
const ALPHA_CWND_DIVISOR: f64 = 16.0;
/// γ, with the paper's value.
const GAMMA: f64 = 0.5;
/// Queueing delay that ends slow start: jitter of a round's quartile seldom exceeds it, or 1/32 of the base
/// RTT.
const SLOW_START_QUEUEING_MAX: Duration = Duration::from_millis(2);
/// Minimum duration of a round: over loopback a round trip has two packets, too few for a quartile.
const ROUND_MIN: Duration = Duration::from_millis(2);
/// Minimum number of RTTs of a round shorter than a window. If one acknowledgement in twelve is early, more
/// than half of this many are so in one round of 100,000.
const RTT_SAMPLES_MIN: usize = 12;
/// Minimum number of RTTs that determine the base RTT at a pause. That most of them overtook others by chance
/// is rare enough.
const PAUSE_RTT_SAMPLES_MIN: usize = 4;
/// Factor of the window when the base RTT is measured anew.
const DRAIN_FACTOR: f64 = 0.75;
/// Share of bytes lost, averaged over some eight rounds, above which the window is reduced.
const LOSS_MAX: f64 = 0.05;
/// Weight of a round in the smoothed loss.
const LOSS_GAIN: f64 = 0.125;
/// Factor of the window after too much loss.
const LOSS_BETA: f64 = 0.8;
/// Decay of the maximum delivery rate per round.
const DELIVERY_RATE_DECAY: f64 = 0.9;
/// Minimum window in datagrams: twice RFC 9002's kMinimumWindow.
const MINIMUM_WINDOW_DATAGRAMS: f64 = 4.0;
/// Maximum window, which the receiver's flow control does not exceed.
const CWND_BYTES_MAX: f64 = 16_777_216.0;
