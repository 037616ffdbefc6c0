//! The speed of a node over the last seconds, of which one slow tile says nothing.

use std::collections::VecDeque;

/// Moments and speeds, the oldest first.
#[derive(Clone, Debug, Default)]
pub(crate) struct SpeedHistory {
    samples: VecDeque<(f64, f64)>,
}

impl SpeedHistory {
    /// Takes in the speed at a moment; without one everything is forgotten.
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

    /// The median, once it is of some seconds.
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
/// Less says too little.
const SPAN_SECS: f64 = 3.5;
const COUNT_MIN: usize = 3;
