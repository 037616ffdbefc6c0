//! Frame pacing ahead of time: the moment of a shot to ask for next, and the frame to show now.
//!
//! After the stroke nothing changes a shot, so pictures are asked for ahead of time and shown when
//! their moment comes. The farm's latency then does not delay what is seen.

use std::collections::VecDeque;

/// How far ahead to ask: what 95 of the last hundred pictures took at most. A picture that takes
/// longer by less than a period is late by less than that.
#[derive(Clone, Debug, Default)]
pub struct LeadTime {
    recent_secs: VecDeque<f64>,
}

impl LeadTime {
    /// Takes in that a picture came `secs` after it had been asked for.
    pub fn observe(&mut self, secs: f64) {
        self.recent_secs.push_back(secs);
        if self.recent_secs.len() > PICTURES_REMEMBERED {
            self.recent_secs.pop_front();
        }
    }

    /// Ask for the picture of this many seconds from now, at most [`LeadTime::SECS_MAX`].
    pub fn secs(&self) -> f64 {
        self.quantile(0.95)
            .unwrap_or(FIRST_LEAD_SECS)
            .min(Self::SECS_MAX)
    }

    /// How long after a click the stroke falls: when the first picture in which something has moved, one
    /// of `period_secs` later, has just time to come in three of four cases. To wait until it has in nearly
    /// all would delay most strokes by a refresh, and the others are no later so.
    pub fn stroke_delay_secs(&self, period_secs: f64) -> f64 {
        let usual_secs = self.quantile(0.75).unwrap_or(FIRST_LEAD_SECS);
        (usual_secs.min(Self::SECS_MAX) - period_secs).max(0.0)
    }

    /// How many pictures to have in flight so that one comes each `period_secs`, at most `max`: as
    /// many periods as the fastest of the last pictures took. Slower ones waited for others, and
    /// more in flight would make all wait.
    pub fn pictures_in_flight(&self, period_secs: f64, max: usize) -> usize {
        // By the fastest: the mean grows with the pictures in flight, and following it would be a loop
        // that never ends.
        let fastest_secs = self.quantile(0.0).unwrap_or(FIRST_LEAD_SECS);
        let periods = (fastest_secs / period_secs).ceil() as usize;
        (periods + 1).clamp(2, max.max(2))
    }

    fn quantile(&self, share: f64) -> Option<f64> {
        let mut sorted: Vec<f64> = self.recent_secs.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        Some(sorted[(last as f64 * share).ceil() as usize])
    }

    /// Moments further ahead would be drawn with a camera that the player may still move.
    pub const SECS_MAX: f64 = 0.6;
}

const PICTURES_REMEMBERED: usize = 100;
/// Before the first picture has come.
const FIRST_LEAD_SECS: f64 = 0.07;

/// The moments to ask for: as close together as `period`, each after the last. The first is a period after
/// the stroke: that of the stroke itself is on show. Where a moment comes less than a period before it
/// is nearly sure to be ready, the next are a little further apart until they are; where more, the
/// next is one that is.
#[derive(Clone, Debug, Default)]
pub struct FrameSchedule {
    asked_secs: Option<f64>,
}

impl FrameSchedule {
    /// The next moment to ask for at `clock_secs` (the moment on show), and notes it as asked.
    /// Nothing once the end itself has been asked for.
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
        // A moment too far ahead would be drawn with a camera that the player may still move.
        if after_last > clock_secs + lead_secs + AHEAD_PERIODS_MAX * period_secs {
            return None;
        }
        let late_secs = (clock_secs + lead_secs - after_last).max(0.0);
        // Small lateness is made up by spreading the next moments a little, which is not seen; a large
        // one by leaving moments out.
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
    /// Pictures that were passed over because a later one was due: the farm or the window was slow.
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
    /// Keeps a picture of the moment `at_secs`, in place of an earlier one of the same; moments
    /// never fall.
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

    /// When the next picture is due.
    pub fn next_secs(&self) -> Option<f64> {
        self.waiting.front().map(|(at, _)| *at)
    }

    /// Forgets what waits.
    pub fn clear(&mut self) {
        self.waiting.clear();
    }
}

/// How many pictures beyond the lead may be asked for.
const AHEAD_PERIODS_MAX: f64 = 2.0;
/// By what part of a period moments may be further apart to make up for late ones.
const CATCH_UP: f64 = 0.25;
/// More pictures than a farm has in flight never wait for long.
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
        // The first is asked for half a period later than it should be.
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
