//! Statistics of a node's messages: how far they are from when they were expected, and how much work
//! comes at once.
//!
//! From them follow how long a silent node is waited for ([`ArrivalModel::timeout_secs`]), how large
//! a share is over before anything is heard of it, and how much earlier such a share should end.

use carom_protocol::FrameId;

use super::open_request::OpenRequest;

/// The messages of one node.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ArrivalModel {
    /// The most work that comes at once, and the same as a share of its request: a GPU delivers a whole
    /// request at its end, a processor a few tiles at a time.
    burst_work: f64,
    burst_share: f64,
    /// The most work of the last requests.
    usual_work: f64,
    /// Of all messages.
    deviation: MeanDeviation,
    /// Of the first ones of frames: what is late then is on its way, or its node pauses.
    first_deviation: MeanDeviation,
    /// Grows when the node was taken for lost and was not.
    timeout_backoff: f64,
}

/// Mean absolute difference between when messages came and when they were expected, as the
/// retransmission timer of TCP keeps it (Jacobson, "Congestion Avoidance and Control", 1988).
#[derive(Clone, Copy, Debug, Default)]
struct MeanDeviation {
    secs: f64,
    messages: u32,
}

impl MeanDeviation {
    fn observe(&mut self, late_secs: f64) {
        // One message that a sleeping machine held up must not make the node trusted for minutes.
        let most = OUTLIER * self.secs + OUTLIER_SECS;
        let error = late_secs.abs().min(most);
        self.messages = self.messages.saturating_add(1);
        // A plain mean until there are enough messages for one that forgets.
        let gain = DEVIATION_GAIN.max(1.0 / f64::from(self.messages));
        self.secs += gain * (error - self.secs);
    }
}

impl ArrivalModel {
    /// Learns from a message that came `late_secs` after it was expected, the first of a frame or
    /// another.
    pub(super) fn observe(&mut self, late_secs: f64, is_first: bool) {
        self.deviation.observe(late_secs);
        if is_first {
            self.first_deviation.observe(late_secs);
        }
        // Fades with messages, not with time: a node that is silent proves nothing.
        self.timeout_backoff *= BACKOFF_KEPT;
    }

    /// Learns from a request that was answered in full.
    pub(super) fn observe_whole(&mut self, request: &OpenRequest) {
        self.usual_work = request.work.max(USUAL_KEPT * self.usual_work);
        if request.work < 0.5 * self.usual_work {
            return; // a small request comes at once whatever its node does
        }
        let share = (request.burst_max / request.work).min(1.0);
        if self.burst_work == 0.0 {
            (self.burst_work, self.burst_share) = (request.burst_max, share);
        }
        self.burst_work += BURST_GAIN * (request.burst_max - self.burst_work);
        self.burst_share += BURST_GAIN * (share - self.burst_share);
    }

    /// Work of which nothing is heard before it is too late for others to help: what comes in one
    /// message, and as much again and a half, for help takes time too.
    pub(super) fn unmonitored_work(&self) -> f64 {
        UNMONITORED_BURSTS * self.burst_work
    }

    /// Seconds by which a message may well be late.
    pub(super) fn margin_secs(&self) -> f64 {
        MARGIN_FACTOR * self.deviation.secs
    }

    /// Waits longer from now on: the node was not lost after all.
    pub(super) fn back_off(&mut self) {
        self.timeout_backoff = (self.timeout_backoff + 1.0).min(BACKOFF_MAX);
    }

    /// Work that should come with a request's next message.
    pub(super) fn next_message_work(&self, request: &OpenRequest) -> f64 {
        let known = self.burst_work > 0.0;
        // The larger of both: a GPU delivers a share of its request at a time, a processor a fixed
        // amount.
        let next = (self.burst_share * request.work).max(self.burst_work);
        let outstanding = request.outstanding();
        if known {
            next.min(outstanding)
        } else {
            outstanding
        }
    }

    /// Seconds that a message may be late before its node counts as lost; absent until something
    /// has been seen. More of one that holds `several_frames`: all of them would be traced twice.
    pub(super) fn timeout_secs(&self, several_frames: bool) -> Option<f64> {
        let MeanDeviation { secs, messages } = self.first_deviation;
        let factor = if several_frames {
            LOST_FACTOR_SEVERAL
        } else {
            LOST_FACTOR
        };
        let secs_min = if messages < MESSAGES_MIN {
            LOST_SECS_MIN_NEW
        } else {
            LOST_SECS_MIN
        };
        let timeout_secs = (factor * secs).max(secs_min);
        // Without a message there is no deviation to multiply, and any bound would be a guess.
        (messages > 0).then_some(timeout_secs * (1.0 + self.timeout_backoff))
    }
}

/// Delay of a node's messages for its current frame, against what they take on average. What has come
/// in time will come in time again: with 1000 nodes on a local network the 99th percentile of frames
/// is 1.44 times the optimum instead of 1.53.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FrameDelay {
    frame: Option<FrameId>,
    secs: f64,
}

impl FrameDelay {
    /// Learns that a message is `secs` later than expected. `follows` says that it was expected from
    /// when the one before it came, whose own delay is then part of this one's.
    pub(super) fn observe(&mut self, frame: FrameId, secs: f64, follows: bool) {
        let before = if follows { self.secs(frame) } else { 0.0 };
        (self.frame, self.secs) = (Some(frame), before + secs);
    }

    /// Seconds by which messages for that frame are late; 0 if none has come.
    pub(super) fn secs(&self, frame: FrameId) -> f64 {
        if self.frame == Some(frame) {
            self.secs
        } else {
            0.0
        }
    }
}

/// Share of an error by which the mean deviation moves.
const DEVIATION_GAIN: f64 = 0.05;
/// The most that one message may count: so many deviations and so many seconds.
const OUTLIER: f64 = 4.0;
const OUTLIER_SECS: f64 = 1e-3;
/// Share of a new burst that is believed at once.
const BURST_GAIN: f64 = 0.25;
/// What is left of the usual work with each smaller request.
const USUAL_KEPT: f64 = 0.95;
/// A node is taken for lost when its next message is late by this many mean deviations: of
/// exponential delays one in a hundred is.
const LOST_FACTOR: f64 = 5.0;
/// The same where it costs more to be wrong: one in a thousand is.
const LOST_FACTOR_SEVERAL: f64 = 8.0;
/// … and by at least this many seconds.
pub(super) const LOST_SECS_MIN: f64 = 3e-3;
/// The same of one that has hardly been asked for anything: as others are lost it is turned to, and it may
/// be lost with them.
const LOST_SECS_MIN_NEW: f64 = 24e-3;
/// Bursts that are over before help comes. With 64 nodes on a local network, frames of 1.26 times
/// the optimum become 1.23, and the 99th percentile 1.4 instead of 1.6.
const UNMONITORED_BURSTS: f64 = 2.5;
/// A message with exponential delays is later than this many mean deviations one time in fifty.
const MARGIN_FACTOR: f64 = 4.0;
/// First messages of frames before their deviation counts.
pub(super) const MESSAGES_MIN: u32 = 8;
/// What is left of the back-off after each message.
const BACKOFF_KEPT: f64 = 0.998;
/// How much longer than others a node is waited for that has been taken for lost by mistake.
const BACKOFF_MAX: f64 = 8.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timeout_covers_late_first_messages() {
        let mut arrivals = ArrivalModel::default();
        for message in 0..200 {
            let is_first = message % 10 == 0;
            arrivals.observe(if is_first { 2e-3 } else { 0.0 }, is_first);
        }
        let timeout = |several_frames| arrivals.timeout_secs(several_frames).unwrap();
        assert!(timeout(false) > 0.9 * LOST_FACTOR * 2e-3);
        assert!(timeout(true) > 1.5 * timeout(false));
    }

    #[test]
    fn false_alarms_lengthen_the_timeout_within_a_bound() {
        let mut arrivals = ArrivalModel::default();
        (0..MESSAGES_MIN).for_each(|_| arrivals.observe(0.0, true));
        assert_eq!(arrivals.timeout_secs(false), Some(LOST_SECS_MIN));
        (0..20).for_each(|_| arrivals.back_off());
        let most = LOST_SECS_MIN * (1.0 + BACKOFF_MAX);
        assert_eq!(arrivals.timeout_secs(false), Some(most));
        (0..5000).for_each(|_| arrivals.observe(0.0, false));
        assert!(arrivals.timeout_secs(false).unwrap() < 1.01 * LOST_SECS_MIN);
    }

    #[test]
    fn delay_of_one_frame_does_not_carry_over() {
        let mut delay = FrameDelay::default();
        delay.observe(FrameId(3), 0.002, false);
        delay.observe(FrameId(3), 0.001, true);
        assert!((delay.secs(FrameId(3)) - 0.003).abs() < 1e-12);
        delay.observe(FrameId(3), 0.001, false);
        assert_eq!(delay.secs(FrameId(3)), 0.001);
        assert_eq!(delay.secs(FrameId(4)), 0.0);
    }
}
