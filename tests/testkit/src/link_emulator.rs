//! One direction of a network link as a pure function of time: delay, jitter, loss, rate, a bounded
//! queue and reordering, all drawn from a seed.

use std::time::Duration;

use crate::error::Error;
use crate::random::SplitMix64;

/// Properties of one direction of a link. The default is a perfect one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkConfig {
    /// Delay of every packet, one way.
    pub delay: Duration,
    /// Mean of an additional, exponentially distributed delay. Packets stay in order.
    pub jitter: Duration,
    /// Share of packets that are lost, 0 to 1.
    pub loss: f64,
    /// Mean number of consecutive losses, 1 or more.
    pub burst: f64,
    /// Rate in bits per second; `None` for no limit.
    pub rate: Option<f64>,
    /// Capacity of the queue before the rate limit, in bytes; packets beyond it are lost.
    pub queue_bytes: usize,
    /// Share of packets that arrive before those ahead of them, 0 to 1.
    pub reorder: f64,
    /// Largest packets that pass, in bytes; larger ones are lost, from which a sender finds the limit.
    pub packet_bytes_max: usize,
}

impl Default for LinkConfig {
    fn default() -> Self {
        Self {
            delay: Duration::ZERO,
            jitter: Duration::ZERO,
            loss: 0.0,
            burst: 1.0,
            rate: None,
            queue_bytes: 256 * 1024,
            reorder: 0.0,
            packet_bytes_max: ETHERNET_BYTES,
        }
    }
}

impl LinkConfig {
    /// Checks each number.
    ///
    /// # Errors
    /// The value that is out of its range.
    pub fn validate(&self) -> Result<(), Error> {
        for (quantity, share) in [("loss", self.loss), ("reorder", self.reorder)] {
            if !(0.0..=1.0).contains(&share) {
                return Err(Error::PacketShare { quantity, share });
            }
        }
        if !(1.0..=1e6).contains(&self.burst) {
            return Err(Error::Burst(self.burst));
        }
        if let Some(rate) = self.rate.filter(|rate| !(1e3..=1e12).contains(rate)) {
            return Err(Error::Rate(rate));
        }
        if self.packet_bytes_max < QUIC_BYTES_MIN {
            return Err(Error::PacketBytes {
                bytes_max: self.packet_bytes_max,
                quic_bytes_min: QUIC_BYTES_MIN,
            });
        }
        let delay = self.delay.max(self.jitter);
        if delay > DELAY_MAX {
            return Err(Error::Delay {
                delay,
                delay_max: DELAY_MAX,
            });
        }
        Ok(())
    }
}

/// One direction of a path.
#[derive(Clone, Debug)]
pub struct LinkEmulator {
    config: LinkConfig,
    random: SplitMix64,
    /// Time at which the previous packet leaves the queue.
    free_at: Duration,
    /// Time at which the previous packet arrives.
    arrived: Duration,
    in_burst: bool,
}

impl LinkEmulator {
    /// An emulator: equal seeds give the same packets the same fate.
    pub fn new(config: LinkConfig, seed: u64) -> Self {
        Self {
            config,
            random: SplitMix64::new(seed),
            free_at: Duration::ZERO,
            arrived: Duration::ZERO,
            in_burst: false,
        }
    }

    /// Time of arrival of a packet that is sent `now`; `None` if it is lost.
    pub fn send(&mut self, now: Duration, bytes: usize) -> Option<Duration> {
        if bytes > self.config.packet_bytes_max {
            return None;
        }
        let lost = self.loses();
        // A lost packet uses the rate as well: it is lost behind the bottleneck.
        let left = self.leaves_queue(now, bytes)?;
        if lost {
            return None;
        }
        let jitter = self.config.jitter.mul_f64(self.random.exponential());
        let arrives = left + self.config.delay + jitter;
        if self.random.uniform() < self.config.reorder {
            return Some(left + self.config.delay / 2);
        }
        self.arrived = self.arrived.max(arrives);
        Some(self.arrived)
    }

    /// Waiting time in the queue of a packet that is sent `now`.
    pub(crate) fn queue_delay(&self, now: Duration) -> Duration {
        self.free_at.saturating_sub(now)
    }

    /// Gilbert's two-state Markov chain (1960): a burst continues with probability 1 − 1/burst, and
    /// begins with loss / (burst · (1 − loss)), at which the stationary share of losses is `loss`.
    fn loses(&mut self) -> bool {
        let LinkConfig { loss, burst, .. } = self.config;
        let begins = (loss / (burst * (1.0 - loss).max(1e-9))).min(1.0);
        let chance = match self.in_burst {
            true => 1.0 - 1.0 / burst,
            false => begins,
        };
        // Without bursts losses are independent.
        let chance = if burst <= 1.0 { loss } else { chance };
        self.in_burst = self.random.uniform() < chance;
        self.in_burst
    }

    fn leaves_queue(&mut self, now: Duration, bytes: usize) -> Option<Duration> {
        let Some(rate) = self.config.rate else {
            return Some(now);
        };
        let waiting = self.free_at.saturating_sub(now).as_secs_f64() * rate / 8.0;
        if waiting + bytes as f64 > self.config.queue_bytes as f64 {
            return None;
        }
        let takes = Duration::from_secs_f64(bytes as f64 * 8.0 / rate);
        self.free_at = self.free_at.max(now) + takes;
        Some(self.free_at)
    }
}

/// Payload of a UDP datagram: Ethernet's 1500 bytes less the headers of IPv4 and UDP.
const ETHERNET_BYTES: usize = 1472;
/// Smallest datagram size that QUIC needs: RFC 9000, 14.
const QUIC_BYTES_MIN: usize = 1200;
/// Maximum delay: later packets are of no use.
const DELAY_MAX: Duration = Duration::from_secs(10);
