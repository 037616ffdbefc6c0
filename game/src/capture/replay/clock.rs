//! Clock of a replay, which runs at a rate, pauses and seeks.

/// Clock of one shot on show. `now_secs` is the display's time, which is monotonic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReplayClock {
    /// Moment of the shot at the display time `since_secs`.
    moment_secs: f64,
    since_secs: f64,
    rate: f64,
    is_running: bool,
    end_secs: f64,
    /// Number of changes of the mapping from display time to moments.
    turns: u64,
}

impl ReplayClock {
    /// A clock that runs from the start of a shot of duration `end_secs`.
    pub fn new(end_secs: f64, now_secs: f64) -> Self {
        Self {
            moment_secs: 0.0,
            since_secs: now_secs,
            rate: 1.0,
            is_running: end_secs > 0.0,
            end_secs,
            turns: 0,
        }
    }

    /// The clock at the start of another shot, at the same rate.
    #[must_use]
    pub fn restarted(self, end_secs: f64, now_secs: f64) -> Self {
        Self {
            rate: self.rate,
            turns: self.turns + 1,
            ..Self::new(end_secs, now_secs)
        }
    }

    /// The moment on show, in seconds since the stroke, at most the shot's duration.
    pub fn moment_secs(&self, now_secs: f64) -> f64 {
        let since = if self.is_running {
            self.rate * (now_secs - self.since_secs)
        } else {
            0.0
        };
        (self.moment_secs + since).clamp(0.0, self.end_secs)
    }

    /// Duration of the shot, in seconds.
    pub fn end_secs(&self) -> f64 {
        self.end_secs
    }

    /// Seconds of the shot per second of display time.
    pub fn rate(&self) -> f64 {
        self.rate
    }

    /// Whether the clock runs rather than pauses.
    pub fn is_running(&self) -> bool {
        self.is_running
    }

    /// Number of seeks, pauses and resumptions so far: frames requested before the last of them are of
    /// other moments.
    pub fn turns(&self) -> u64 {
        self.turns
    }

    /// Pauses at the shot's end; to be called regularly.
    pub fn tick(&mut self, now_secs: f64) {
        if self.is_running && self.moment_secs(now_secs) >= self.end_secs {
            self.seek(self.end_secs, now_secs);
            self.is_running = false;
        }
    }

    /// Pauses or resumes; at the end it starts again from the beginning.
    pub fn toggle(&mut self, now_secs: f64) {
        let moment = self.moment_secs(now_secs);
        let begins_again = !self.is_running && moment >= self.end_secs;
        self.seek(if begins_again { 0.0 } else { moment }, now_secs);
        self.is_running = !self.is_running && self.end_secs > 0.0;
    }

    /// Changes the rate; one that is not positive and finite is ignored.
    pub fn set_rate(&mut self, rate: f64, now_secs: f64) {
        if rate > 0.0 && rate.is_finite() {
            self.seek(self.moment_secs(now_secs), now_secs);
            self.rate = rate;
        }
    }

    /// Seeks to a moment, and keeps running if it ran.
    pub fn seek(&mut self, moment_secs: f64, now_secs: f64) {
        self.moment_secs = if moment_secs.is_nan() {
            0.0
        } else {
            moment_secs.clamp(0.0, self.end_secs)
        };
        self.since_secs = now_secs;
        self.turns += 1;
    }

    /// Pauses at the next of ascending `moments`, or at the last one before; at the shot's end or start
    /// if there is none.
    pub fn step(&mut self, moments: &[f64], forward: bool, now_secs: f64) {
        let now = self.moment_secs(now_secs);
        let mut moments = moments.iter().copied();
        let target = if forward {
            moments.find(|&moment| moment > now + APART_SECS)
        } else {
            moments.rfind(|&moment| moment < now - APART_SECS)
        };
        self.seek(
            target.unwrap_or(if forward { self.end_secs } else { 0.0 }),
            now_secs,
        );
        self.is_running = false;
    }
}

/// Time within which moments count as the same, in seconds.
const APART_SECS: f64 = 1e-4;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn it_runs_at_its_rate_and_stops_at_the_end() {
        let mut clock = ReplayClock::new(2.0, 10.0);
        assert_eq!(clock.moment_secs(10.5), 0.5);
        clock.set_rate(0.25, 11.0);
        assert_eq!(clock.moment_secs(13.0), 1.5);
        clock.tick(14.9);
        assert!(clock.is_running());
        clock.tick(15.1);
        assert!(!clock.is_running());
        assert_eq!(clock.moment_secs(99.0), 2.0);
        clock.toggle(100.0);
        assert_eq!((clock.is_running(), clock.moment_secs(102.0)), (true, 0.5));
        let next = clock.restarted(4.0, 103.0);
        assert_eq!((next.rate(), next.moment_secs(107.0)), (0.25, 1.0));
    }

    #[test]
    fn it_steps_from_event_to_event() {
        let mut clock = ReplayClock::new(2.0, 0.0);
        let moments = [0.0, 0.5, 0.500_01, 1.2];
        let mut step = |forward| {
            clock.step(&moments, forward, 0.0);
            clock.moment_secs(9.0)
        };
        assert_eq!([true, true, true].map(&mut step), [0.5, 1.2, 2.0]);
        assert_eq!(
            [false, false, false, false].map(&mut step),
            [1.2, 0.500_01, 0.0, 0.0]
        );
    }

    #[test]
    fn a_layout_has_no_time() {
        let mut clock = ReplayClock::new(0.0, 5.0);
        assert!(!clock.is_running());
        clock.toggle(6.0);
        assert_eq!((clock.is_running(), clock.moment_secs(7.0)), (false, 0.0));
    }

    proptest! {
        #[test]
        fn whatever_is_done_the_moment_is_in_the_shot(
            end in 0.0f64..100.0,
            deeds in prop::collection::vec((0u8..5, -10.0f64..110.0, 0.0f64..3.0), 0..40),
        ) {
            let mut clock = ReplayClock::new(end, 0.0);
            let mut now = 0.0;
            for (deed, value, pause) in deeds {
                let turns = clock.turns();
                let before = clock.moment_secs(now);
                match deed {
                    0 => clock.toggle(now),
                    1 => clock.set_rate(value, now),
                    2 => clock.seek(value, now),
                    3 => clock.step(&[1.0, 20.0, 50.0], value > 0.0, now),
                    _ => clock.tick(now),
                }
                let after = clock.moment_secs(now);
                // Only what is counted as a turn changes the moment.
                prop_assert!(clock.turns() > turns || before == after);
                now += pause;
                prop_assert!((0.0..=end).contains(&clock.moment_secs(now)));
            }
        }
    }
}
