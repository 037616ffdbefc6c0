//! Round-trip times as congestion control needs them: the samples of one round, and the base RTT of
//! the path.

use std::time::Duration;

/// The round-trip times of a round's acknowledgements, of which at most [`SAMPLES_MAX`] are kept,
/// evenly spread.
#[derive(Clone, Debug, Default)]
pub(super) struct RttSamples {
    kept: Vec<Duration>,
    /// One of this many is kept …
    stride: usize,
    /// … after this many more.
    skips: usize,
}

impl RttSamples {
    pub(super) fn insert(&mut self, rtt: Duration) {
        if self.skips > 0 {
            self.skips -= 1;
            return;
        }
        if self.kept.len() == SAMPLES_MAX {
            // Every second sample is dropped and half as many are taken from now on, so that those kept
            // stay spread evenly over the round, however long it becomes.
            self.kept = self.kept.iter().copied().step_by(2).collect();
            self.stride = 2 * self.stride.max(1);
        }
        self.kept.push(rtt);
        self.skips = self.stride.saturating_sub(1);
    }

    /// The RTT that this share of the samples are shorter than.
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

/// The RTT without queueing: the minimum over the last one to two [`WINDOW`]s.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct BaseRtt {
    current: Option<Duration>,
    previous: Option<Duration>,
    since: Duration,
}

impl BaseRtt {
    /// The minimum, this sample included.
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
        // Two windows in turn: the minimum never rises by surprise in the midst of one.
        (self.previous, self.current, self.since) = (self.current, None, now);
    }
}

/// Quartiles of more samples are no better.
const SAMPLES_MAX: usize = 64;
/// As long as BBR keeps its minimum RTT: routes change.
const WINDOW: Duration = Duration::from_secs(10);
