//! Frame rate of the window, and percentiles of its slowest frames.

use std::collections::VecDeque;

/// Recorder of the intervals between redraws of the window while something moves.
#[derive(Debug, Default)]
pub struct FrameRate {
    last: Option<(f64, bool)>,
    intervals_secs: VecDeque<f64>,
}

/// Rates in redraws per second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rates {
    /// Over the last quarter of a second.
    pub now: f64,
    /// Over all recorded intervals.
    pub mean: f64,
    /// The rate of the interval that the slowest hundredth exceeds.
    pub low_1_percent: f64,
    /// The rate of the interval that the slowest thousandth exceeds.
    pub low_01_percent: f64,
}

impl FrameRate {
    /// Maximum number of recorded intervals.
    pub const INTERVALS_MAX: usize = 1000;

    /// Records a redraw; `moves` states that something has moved since the previous one. Pauses without
    /// motion are not counted as slow frames.
    pub fn note(&mut self, now_secs: f64, moves: bool) {
        let last = self.last.replace((now_secs, moves));
        let Some((last_secs, true)) = last else {
            return;
        };
        let secs = now_secs - last_secs;
        if !moves || !(0.0..PAUSE_SECS).contains(&secs) {
            return;
        }
        if self.intervals_secs.len() == Self::INTERVALS_MAX {
            self.intervals_secs.pop_front();
        }
        self.intervals_secs.push_back(secs);
    }

    /// The recorded intervals in seconds, the oldest first.
    pub fn intervals_secs(&self) -> &VecDeque<f64> {
        &self.intervals_secs
    }

    /// The present rates; 0 before the first interval.
    pub fn rates(&self) -> Rates {
        let count = self.intervals_secs.len();
        if count == 0 {
            return Rates::default();
        }
        let rate = |secs: f64| if secs > 0.0 { 1.0 / secs } else { 0.0 };
        let mut sorted: Vec<f64> = self.intervals_secs.iter().copied().collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let low = |share: f64| rate(sorted[((1.0 - share) * count as f64) as usize]);
        let (mut secs, mut newest) = (0.0, 0);
        for interval in self.intervals_secs.iter().rev() {
            secs += interval;
            newest += 1;
            if secs >= NOW_SECS {
                break;
            }
        }
        Rates {
            now: rate(secs / f64::from(newest)),
            mean: rate(sorted.iter().sum::<f64>() / count as f64),
            low_1_percent: low(0.01),
            low_01_percent: low(0.001),
        }
    }
}

/// Longer intervals are pauses.
const PAUSE_SECS: f64 = 1.0;
const NOW_SECS: f64 = 0.25;

#[cfg(test)]
mod tests {
    use super::*;

    fn play(intervals: impl IntoIterator<Item = f64>) -> FrameRate {
        let mut redraws = FrameRate::default();
        let mut now = 1.0;
        redraws.note(now, true);
        for secs in intervals {
            now += secs;
            redraws.note(now, true);
        }
        redraws
    }

    #[test]
    fn lows_are_the_rates_of_the_slowest_frames() {
        // Of a thousand frames, eighteen take 40 ms and two 100 ms.
        let secs = |i: usize| match i {
            250 | 750 => 0.1,
            i if i % 50 == 0 => 0.04,
            _ => 0.01,
        };
        let rates = play((0..1000).map(secs)).rates();
        assert!((rates.low_1_percent - 25.0).abs() < 1e-6, "{rates:?}");
        assert!((rates.low_01_percent - 10.0).abs() < 1e-6, "{rates:?}");
        assert!((rates.now - 100.0).abs() < 1e-6, "{rates:?}");
        assert!((90.0..100.0).contains(&rates.mean), "{rates:?}");
    }

    #[test]
    fn a_pause_is_no_slow_frame_and_a_hitch_is_one() {
        let mut redraws = play([0.01; 50]);
        redraws.note(2.0, false); // a picture got finer while nothing moved
        redraws.note(2.25, true);
        redraws.note(2.26, true);
        redraws.note(9.0, true);
        assert!((redraws.rates().low_01_percent - 100.0).abs() < 1e-6);
        redraws.note(9.4, true);
        assert!((redraws.rates().low_01_percent - 2.5).abs() < 1e-6);
    }

    #[test]
    fn memory_is_bounded_and_nothing_divides_by_zero() {
        assert_eq!(FrameRate::default().rates(), Rates::default());
        let redraws = play([0.0; 5000]);
        assert_eq!(redraws.intervals_secs().len(), FrameRate::INTERVALS_MAX);
        assert_eq!(redraws.rates(), Rates::default());
    }
}
