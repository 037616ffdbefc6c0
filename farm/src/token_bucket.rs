//! Token bucket: limits a mean rate and lets bursts through.

use std::time::{Duration, Instant};

/// A bucket that fills at `per_sec` tokens per second up to `burst`. It may be overdrawn.
#[derive(Debug)]
pub(crate) struct TokenBucket {
    tokens: f64,
    burst: f64,
    per_sec: f64,
    filled: Instant,
}

impl TokenBucket {
    /// A full bucket.
    pub(crate) const fn new(now: Instant, burst: f64, per_sec: f64) -> Self {
        Self {
            tokens: burst,
            burst,
            per_sec,
            filled: now,
        }
    }

    /// Takes tokens, and returns the pause until the bucket is no longer overdrawn.
    pub(crate) fn take(&mut self, now: Instant, tokens: f64) -> Duration {
        self.fill(now);
        self.tokens -= tokens;
        Duration::from_secs_f64((-self.tokens / self.per_sec).max(0.0))
    }

    /// Takes a token if there is one.
    #[cfg(feature = "net")]
    pub(crate) fn try_take(&mut self, now: Instant) -> bool {
        self.fill(now);
        let free = self.tokens >= 1.0;
        self.tokens -= f64::from(u8::from(free));
        free
    }

    /// Whether the bucket is full again.
    pub(crate) fn is_full(&mut self, now: Instant) -> bool {
        self.fill(now);
        // Exact comparison, as `fill` clamps to `burst` itself.
        self.tokens == self.burst
    }

    fn fill(&mut self, now: Instant) {
        let since = now.saturating_duration_since(self.filled).as_secs_f64();
        self.filled = now;
        self.tokens = (self.tokens + since * self.per_sec).min(self.burst);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bucket_bounds_the_mean_rate_after_a_burst() {
        let start = Instant::now();
        let mut bucket = TokenBucket::new(start, 100.0, 10.0);
        let mut now = start;
        for _ in 0..300 {
            now += bucket.take(now, 1.0);
        }
        let secs = now.duration_since(start).as_secs_f64();
        assert!((19.9..20.1).contains(&secs), "{secs}");
        now += Duration::from_secs(1000);
        assert_eq!(bucket.take(now, 100.0), Duration::ZERO);
        assert!(bucket.take(now, 1.0) > Duration::ZERO);
    }

    #[cfg(feature = "net")]
    #[test]
    fn an_empty_bucket_gives_nothing_until_it_fills() {
        let start = Instant::now();
        let mut bucket = TokenBucket::new(start, 2.0, 0.5);
        let taken: Vec<bool> = (0..4)
            .map(|secs| bucket.try_take(start + Duration::from_secs(secs / 2)))
            .collect();
        assert_eq!(taken, [true, true, false, false]);
        assert!(bucket.try_take(start + Duration::from_secs(2)));
    }
}
