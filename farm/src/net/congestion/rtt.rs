//! Round-trip times for congestion control: the samples of one round, and the base RTT of the path.

use std::time::Duration;

/// RTTs of the acknowledgements of a round, of which at most [`SAMPLES_MAX`], evenly spread, are kept.
#[derive(Clone, Debug, Default)]
pub(super) struct RttSamples {
    kept: Vec<Duration>,
    /// One sample of this many is kept.
    stride: usize,
    /// Samples to skip before the next is kept.
    skips: usize,
}

impl RttSamples {
    pub(super) fn insert(&mut self, rtt: Duration) {
        if self.skips > 0 {
            self.skips -= 1;
            return;
        }
        if self.kept.len() == SAMPLES_MAX {
            // Every second sample is dropped, and from here on half as many are kept, so that the samples
            // stay evenly spread over the round, however long it becomes.
            self.kept = self.kept.iter().copied().step_by(2).collect();
            self.stride = 2 * self.stride.max(1);
        }
        self.kept.push(rtt);
        self.skips = self.stride.saturating_sub(1);
    }

    /// The quantile of the samples, rounded down to one of them; `share` is from 0 to 1.
    pub(super) fn quantile(&mut self, share: f64) -> Option<Duration> {
        let index = (self.kept.len().checked_sub(1)? as f64 * share) as usize;
        Some(*self.kept.select_nth_unstable(index).1)
    }

    pub(super) fn max(&self) -> Option<Duration> {
        self.kept.iter().max().copied()
    }

    pub(super) fn len(&self) -> usize {
        self.kept.len()
    }
}

/// RTT without queueing: the minimum over the last one to two [`WINDOW`]s.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct BaseRtt {
    current: Option<Duration>,
    previous: Option<Duration>,
    since: Duration,
}

impl BaseRtt {
    /// Inserts a sample and returns the minimum including it.
    pub(super) fn insert(&mut self, now: Duration, rtt: Duration) -> Duration {
        if self.current.is_none() {
            self.since = now;
        }
        let current = self.current.map_or(rtt, |current| current.min(rtt));
        self.current = Some(current);
        self.previous
            .map_or(current, |previous| previous.min(current))
    }

    pub(super) fn get(&self) -> Option<Duration> {
        self.current.into_iter().chain(self.previous).min()
    }

    pub(super) fn is_stale(&self, now: Duration) -> bool {
        now.saturating_sub(self.since) >= WINDOW
    }

    pub(super) fn renew(&mut self, now: Duration) {
        // The window before stays in the minimum, which thus never jumps up at once.
        (self.previous, self.current, self.since) = (self.current, None, now);
    }
}

/// More samples do not improve the quartiles.
const SAMPLES_MAX: usize = 64;
/// Half of the maximum age of a sample, since routes change: as long as BBR keeps its minimum RTT.
const WINDOW: Duration = Duration::from_secs(10);
