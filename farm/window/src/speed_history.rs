//! Speed of a node over the last seconds, robust against single slow tiles.

use std::collections::VecDeque;

/// Samples of time in seconds and speed, the oldest first.
#[derive(Clone, Debug, Default)]
pub(crate) struct SpeedHistory {
    samples: VecDeque<(f64, f64)>,
}

impl SpeedHistory {
    /// Adds the speed at a time; `None` clears the history.
    pub(crate) fn add(&mut self, now_secs: f64, speed: Option<f64>) {
        let Some(speed) = speed else {
            return self.samples.clear();
        };
        let newest = self.samples.back();
        if newest.is_none_or(|(secs, _)| now_secs - secs >= STEP_SECS) {
            self.samples.push_back((now_secs, speed));
        }
        self.samples
            .retain(|(secs, _)| now_secs - secs <= KEPT_SECS);
    }

    /// The median speed, once the samples span several seconds.
    pub(crate) fn median(&self) -> Option<f64> {
        let (oldest, newest) = (self.samples.front()?.0, self.samples.back()?.0);
        let mut speeds: Vec<f64> = self.samples.iter().map(|(_, speed)| *speed).collect();
        if newest - oldest < SPAN_SECS || speeds.len() < COUNT_MIN {
            return None;
        }
        speeds.sort_unstable_by(f64::total_cmp);
        Some(speeds[speeds.len() / 2])
    }
}

const STEP_SECS: f64 = 0.25;
const KEPT_SECS: f64 = 5.0;
/// Minimum time span in seconds for a median.
const SPAN_SECS: f64 = 3.5;
const COUNT_MIN: usize = 3;
