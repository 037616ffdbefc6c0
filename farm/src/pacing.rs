//! Frame pacing ahead of time: which moment of a shot to request next, and which frame to show now.
//!
//! After the stroke nothing changes a shot, so its pictures are requested ahead of time and shown at their
//! moment. The farm's latency then does not delay the display.

use std::collections::VecDeque;

/// Lead time of requests: the 95th percentile of the last hundred pictures' latencies. A picture that
/// exceeds it by less than a period is late by less than that.
#[derive(Clone, Debug, Default)]
pub struct LeadTime {
    recent_secs: VecDeque<f64>,
}

impl LeadTime {
    /// Records that a picture arrived `secs` after its request.
    pub fn observe(&mut self, secs: f64) {
        self.recent_secs.push_back(secs);
        if self.recent_secs.len() > PICTURES_REMEMBERED {
            self.recent_secs.pop_front();
        }
    }

    /// Seconds ahead of which to request a picture, at most [`LeadTime::SECS_MAX`].
    pub fn secs(&self) -> f64 {
        self.quantile(0.95)
            .unwrap_or(FIRST_LEAD_SECS)
            .min(Self::SECS_MAX)
    }

    /// Delay of the stroke after a click, in seconds: the first picture with motion, one of `period_secs`
    /// after the stroke, then arrives in time in three of four cases. Waiting for nearly all cases would
    /// delay most strokes by a refresh, without making the others earlier.
    pub fn stroke_delay_secs(&self, period_secs: f64) -> f64 {
        let usual_secs = self.quantile(0.75).unwrap_or(FIRST_LEAD_SECS);
        (usual_secs.min(Self::SECS_MAX) - period_secs).max(0.0)
    }

    /// Number of pictures to keep in flight for one per `period_secs`, at most `max`: as many periods as
    /// the fastest of the last pictures took, plus one. Slower ones were queued behind others, and more in
    /// flight would delay all.
    pub fn pictures_in_flight(&self, period_secs: f64, max: usize) -> usize {
        // By the fastest: the mean grows with the pictures in flight, so that following it would be
        // positive feedback.
        let fastest_secs = self.quantile(0.0).unwrap_or(FIRST_LEAD_SECS);
        let periods = (fastest_secs / period_secs).ceil() as usize;
        (periods + 1).clamp(2, max.max(2))
    }

    fn quantile(&self, share: f64) -> Option<f64> {
        let mut sorted: Vec<f64> = self.recent_secs.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        // The order statistic at the rank rounded up, so that small samples err towards longer times.
        let last = sorted.len().checked_sub(1)?;
        Some(sorted[(last as f64 * share).ceil() as usize])
    }

    /// Maximum lead in seconds: moments further ahead would be traced with a camera that the player may
    /// still move.
    pub const SECS_MAX: f64 = 0.6;
}

const PICTURES_REMEMBERED: usize = 100;
/// Assumed latency before the first picture.
const FIRST_LEAD_SECS: f64 = 0.07;

/// Schedule of the moments to request, one `period` apart. The first is a period after the stroke, whose
/// own moment is already shown. Where a moment is less than a period too close to arrive in time, the
/// following ones are spaced slightly wider until they do; where it is more, the next moment is one that
/// does.
#[derive(Clone, Debug, Default)]
pub struct FrameSchedule {
    asked_secs: Option<f64>,
}

impl FrameSchedule {
    /// The next moment to request at `clock_secs` (the moment on display), which counts as requested.
    /// `None` if it is too far ahead, or once the end itself has been requested.
    pub fn next(
        &mut self,
        clock_secs: f64,
        lead_secs: f64,
        period_secs: f64,
        end_secs: f64,
    ) -> Option<f64> {
        let after_last = self.asked_secs.unwrap_or(0.0) + period_secs;
        if self.asked_secs.is_some_and(|asked| asked >= end_secs) {
            return None;
        }
        // A moment too far ahead would be traced with a camera that the player may still move.
        if after_last > clock_secs + lead_secs + AHEAD_PERIODS_MAX * period_secs {
            return None;
        }
        let late_secs = (clock_secs + lead_secs - after_last).max(0.0);
        // Small lateness is made up by spreading the following moments invisibly, large lateness by
        // skipping moments.
        let step_secs = match late_secs < period_secs {
            true => late_secs.min(CATCH_UP * period_secs),
            false => late_secs,
        };
        let moment = (after_last + step_secs).min(end_secs);
        self.asked_secs = Some(moment);
        Some(moment)
    }
}

/// Finished pictures that wait for their moment.
#[derive(Clone, Debug)]
pub struct PresentationQueue<T> {
    waiting: VecDeque<(f64, T)>,
    /// Pictures skipped because a later one was due: the farm or the window was slow.
    pub skipped: u64,
}

impl<T> Default for PresentationQueue<T> {
    fn default() -> Self {
        Self {
            waiting: VecDeque::new(),
            skipped: 0,
        }
    }
}

impl<T> PresentationQueue<T> {
    /// Adds a picture of the moment `at_secs`, replacing an earlier one of the same moment; moments must
    /// not decrease.
    pub fn push(&mut self, at_secs: f64, picture: T) {
        let again = |(at, _): &mut (f64, T)| *at == at_secs;
        if self.waiting.back_mut().is_some_and(again) {
            self.waiting.pop_back();
        }
        self.waiting.push_back((at_secs, picture));
        if self.waiting.len() > WAITING_MAX {
            self.waiting.pop_front();
        }
    }

    /// The picture to show at `clock_secs`: the latest whose moment has come.
    pub fn due(&mut self, clock_secs: f64) -> Option<(f64, T)> {
        let mut due = None;
        while self
            .waiting
            .front()
            .is_some_and(|(at, _)| *at <= clock_secs)
        {
            self.skipped += u64::from(due.is_some());
            due = self.waiting.pop_front();
        }
        due
    }

    /// Moment of the next picture.
    pub fn next_secs(&self) -> Option<f64> {
        self.waiting.front().map(|(at, _)| *at)
    }

    /// Drops all waiting pictures.
    pub fn clear(&mut self) {
        self.waiting.clear();
    }
}

/// Periods beyond the lead that may be requested.
const AHEAD_PERIODS_MAX: f64 = 2.0;
/// Maximum extra spacing of moments that make up for lateness, as a share of the period.
const CATCH_UP: f64 = 0.25;
/// Maximum number of waiting pictures: more than a farm has in flight.
const WAITING_MAX: usize = 32;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lead_covers_nearly_every_picture() {
        let mut lead = LeadTime::default();
        // 40 to 60 ms, evenly spread.
        let makespan = |i: u32| 0.04 + 0.02 * f64::from(i * 7919 % 101) / 100.0;
        let mut covered = 0;
        for i in 0..1000 {
            covered += u32::from(i >= 100 && makespan(i) <= lead.secs());
            lead.observe(makespan(i));
        }
        assert!(covered >= 840, "{covered} of 900 came within the lead");
        assert!(lead.secs() < 0.08);
        let delay_secs = lead.stroke_delay_secs(0.01);
        assert!((0.044..0.046).contains(&delay_secs), "{delay_secs}");
        assert_eq!(lead.stroke_delay_secs(1.0), 0.0);
    }

    #[test]
    fn moments_rise_end_with_the_end_and_are_never_in_the_past() {
        let mut schedule = FrameSchedule::default();
        let (mut clock, mut asked) = (1.0 / 30.0 - 0.2, Vec::new());
        while asked.last() != Some(&2.0) {
            while let Some(moment) = schedule.next(clock, 0.2, 1.0 / 30.0, 2.0) {
                assert!(moment >= (clock + 0.2f64).min(2.0) && moment <= 2.0);
                asked.push(moment);
            }
            clock += 0.016;
        }
        assert_eq!(asked[0], 1.0 / 30.0);
        assert!(asked.windows(2).all(|pair| pair[0] < pair[1]));
        assert!((60..=64).contains(&asked.len()), "{} pictures", asked.len());
        assert_eq!(schedule.next(9.0, 0.2, 1.0 / 30.0, 2.0), None);
    }

    #[test]
    fn a_little_lateness_is_made_up_for_over_several_moments_and_much_at_once() {
        const PERIOD: f64 = 1.0 / 60.0;
        let mut schedule = FrameSchedule::default();
        // The first is requested half a period later than it should be.
        let (mut clock, mut asked) = (-3.5 * PERIOD, vec![]);
        for _ in 0..10 {
            asked.extend(schedule.next(clock, 5.0 * PERIOD, PERIOD, 9.0));
            clock += PERIOD;
        }
        let steps: Vec<f64> = asked.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert_eq!(asked.len(), 10);
        assert!(steps.iter().all(|step| *step < 1.26 * PERIOD), "{steps:?}");
        let late_secs = clock - PERIOD + 5.0 * PERIOD - asked[9];
        assert!(late_secs.abs() < 1e-9, "{late_secs}");
        // The game stood still.
        clock += 20.0 * PERIOD;
        let moment = schedule.next(clock, 5.0 * PERIOD, PERIOD, 9.0);
        assert_eq!(moment, Some(clock + 5.0 * PERIOD));
    }

    #[test]
    fn a_picture_is_shown_at_its_moment_and_not_before() {
        let mut queue = PresentationQueue::default();
        for i in 0..4 {
            queue.push(f64::from(i) * 0.1, i);
        }
        assert_eq!(queue.due(-0.01), None);
        assert_eq!(queue.due(0.05), Some((0.0, 0)));
        assert_eq!(queue.due(0.05), None);
        assert_eq!(queue.due(0.25), Some((0.2, 2)));
        assert_eq!((queue.skipped, queue.next_secs()), (1, Some(0.1 * 3.0)));
        queue.push(0.1 * 3.0, 4);
        assert_eq!(queue.due(9.0), Some((0.1 * 3.0, 4)));
    }
}
