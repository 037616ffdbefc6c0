//! How far nodes are with what they have been asked for, and when each part of it should come.
//!
//! A node works on one run after the other, of the oldest frame first, and sends tiles as they finish,
//! so that what it has sent tells how late the rest will be, long before the end.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use carom_protocol::{FrameId, RequestId};

use super::node_state::Node;
use super::open_request::Run;
use crate::balancer::Estimate;

/// A run that is still wanted, as it should go on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Prospect {
    pub(super) run: RequestId,
    pub(super) frame: FrameId,
    /// When the first of its missing work begins to count, by the client's clock: the last missing
    /// tile comes at `begin + pace · outstanding`.
    pub(super) begin: f64,
    /// The same if what is late is merely late on its way.
    pub(super) soonest: f64,
    /// Seconds per unit of work.
    pub(super) pace: f64,
    pub(super) outstanding: f64,
}

impl Prospect {
    pub(super) fn finish(&self) -> f64 {
        self.begin + self.pace * self.outstanding
    }
}

/// How a node's messages come.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rhythm {
    /// The most work that comes at once, and the same as a share of its run: a GPU delivers a whole
    /// run at its end, a processor a few tiles at a time.
    burst_work: f64,
    burst_share: f64,
    /// The most work of the last runs.
    usual_work: f64,
    /// Of all messages.
    lateness: Lateness,
    /// Of the first ones of frames: what is late then is on its way, or its node pauses.
    first_lateness: Lateness,
    /// Grows when the node was taken for lost and was not.
    caution: f64,
}

/// Mean deviation of messages from when they were expected.
#[derive(Clone, Copy, Debug, Default)]
struct Lateness {
    deviation_secs: f64,
    messages: u32,
}

impl Lateness {
    fn observe(&mut self, secs: f64) {
        let most = OUTLIER * self.deviation_secs + OUTLIER_SECS;
        let error = secs.abs().min(most);
        self.messages = self.messages.saturating_add(1);
        let gain = DEVIATION_GAIN.max(1.0 / f64::from(self.messages));
        self.deviation_secs += gain * (error - self.deviation_secs);
    }
}

impl Rhythm {
    /// Takes note of how far a message was from when it was expected, the first of a frame or another.
    pub(super) fn observe(&mut self, lateness_secs: f64, is_first: bool) {
        self.lateness.observe(lateness_secs);
        if is_first {
            self.first_lateness.observe(lateness_secs);
        }
        self.caution *= CAUTION_KEPT;
    }

    /// Takes note of a run that came whole.
    pub(super) fn end(&mut self, run: &Run) {
        self.usual_work = run.work.max(USUAL_KEPT * self.usual_work);
        if run.work < 0.5 * self.usual_work {
            return; // a small run comes at once whatever its node does
        }
        let share = (run.burst_max / run.work).min(1.0);
        if self.burst_work == 0.0 {
            (self.burst_work, self.burst_share) = (run.burst_max, share);
        }
        self.burst_work += BURST_GAIN * (run.burst_max - self.burst_work);
        self.burst_share += BURST_GAIN * (share - self.burst_share);
    }

    /// Work of which nothing is heard before it is too late for others to help: what comes in one
    /// message, and as much again and a half, for help takes time too.
    pub(super) fn unmonitored_work(&self) -> f64 {
        MUTE_BURSTS * self.burst_work
    }

    /// Seconds by which a message may well be late.
    pub(super) fn guard_secs(&self) -> f64 {
        GUARD_FACTOR * self.lateness.deviation_secs
    }

    /// Takes note that the node was not lost after all.
    pub(super) fn false_alarm(&mut self) {
        self.caution = (self.caution + 1.0).min(CAUTION_MAX);
    }

    /// Work that should come with a run's next message.
    fn next_work(&self, run: &Run) -> f64 {
        let known = self.burst_work > 0.0;
        let next = (self.burst_share * run.work).max(self.burst_work);
        let outstanding = run.outstanding();
        if known {
            next.min(outstanding)
        } else {
            outstanding
        }
    }

    /// Seconds that a message may be late before its node counts as lost; absent until something
    /// has been seen. More of one that holds `several_frames`: all of them would be traced twice.
    fn patience_secs(&self, several_frames: bool) -> Option<f64> {
        let Lateness {
            deviation_secs,
            messages,
        } = self.first_lateness;
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
        let secs = (factor * deviation_secs).max(secs_min);
        (messages > 0).then_some(secs * (1.0 + self.caution))
    }
}

/// How late a node's messages for a frame are, against what they take on average. What has come in time
/// will come in time again: with 1000 nodes on a local network the 99th percentile of frames is 1.44
/// times the optimum instead of 1.53.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Drift {
    frame: Option<FrameId>,
    secs: f64,
}

impl Drift {
    /// Takes note that a message is `secs` later than expected. `follows` says that it was expected
    /// from when the one before it came.
    pub(super) fn observe(&mut self, frame: FrameId, secs: f64, follows: bool) {
        let before = if follows { self.of(frame) } else { 0.0 };
        (self.frame, self.secs) = (Some(frame), before + secs);
    }

    /// Seconds by which messages for that frame are late; 0 if none has come.
    pub(super) fn of(&self, frame: FrameId) -> f64 {
        if self.frame == Some(frame) {
            self.secs
        } else {
            0.0
        }
    }
}

/// Among runs in the order of their frames, the place of the one that a node turns to when it is
/// through with all before at `free`: of those that have reached it by then the oldest frame's, else
/// the one that reaches it first.
fn served_next(waiting: &[(&RequestId, &Run)], line: Estimate, free: Option<f64>) -> usize {
    let is_there =
        |(_, run): &(&RequestId, &Run)| free.is_some_and(|free| run.begins(line) <= free);
    let sooner = |a: &usize, b: &usize| earlier(waiting[*a].1, waiting[*b].1, line);
    let there = waiting.iter().position(is_there);
    let first = || (0..waiting.len()).min_by(sooner);
    there.or_else(first).unwrap_or(0)
}

/// Which run of a node counts from earlier on; what it has begun comes first.
fn earlier(a: &Run, b: &Run, line: Estimate) -> Ordering {
    let waits = |run: &Run| run.tiles_received == 0;
    let begins = a.begins(line).total_cmp(&b.begins(line));
    begins.then(waits(a).cmp(&waits(b)))
}

/// When that which is asked for a frame would begin to count if it could from `asked` on and its node
/// has that to do: a node turns to the oldest frame first, but ends what it has begun.
pub(super) fn begins_after(prospects: &[Prospect], frame: FrameId, asked: f64) -> f64 {
    prospects.iter().fold(asked, |begin, before| {
        if before.frame <= frame || before.begin < begin {
            begin.max(before.finish())
        } else {
            begin
        }
    })
}

impl Node {
    /// What it still has to do, in the order in which it does it. `newcomer` is assumed of a node
    /// that has delivered nothing.
    pub(super) fn prospects(&self, now: f64, newcomer: Option<Estimate>) -> Vec<Prospect> {
        let Some(line) = self.delivered().or(newcomer) else {
            return Vec::new();
        };
        let wanted = self.runs.iter().filter(|(_, run)| run.outstanding() > 0.0);
        let mut waiting: Vec<(&RequestId, &Run)> = wanted.collect();
        waiting.sort_by_key(|(_, run)| run.frame);
        let mut prospects: Vec<Prospect> = Vec::with_capacity(waiting.len());
        let (mut pace, mut soonest) = (line.secs_per_work, f64::NEG_INFINITY);
        while !waiting.is_empty() {
            let before = prospects.last().map(Prospect::finish);
            let (id, run) = waiting.remove(served_next(&waiting, line, before));
            let asked = run.begins(line);
            let seen = run.pace(self.rhythm.guard_secs());
            if seen > SLOWED * pace {
                pace = seen;
            }
            let mut begin = before.map_or(asked, |before| before.max(asked));
            soonest = asked.max(soonest);
            if before.is_none() {
                // What is late is taken to be late by as much again.
                let next = begin + pace * self.rhythm.next_work(run);
                begin += 2.0 * (now - next).max(0.0);
            }
            prospects.push(Prospect {
                run: *id,
                frame: run.frame,
                begin,
                soonest,
                pace,
                outstanding: run.outstanding(),
            });
            soonest += pace * run.outstanding();
        }
        prospects
    }

    /// When its next message should come; absent if nothing is asked of it or known about it.
    pub(super) fn next_message(&self, newcomer: Option<Estimate>) -> Option<f64> {
        let line = self.delivered().or(newcomer)?;
        let (_, run) = self.next_run(line)?;
        Some(run.begins(line) + line.secs_per_work * self.rhythm.next_work(run))
    }

    /// The run that it is at, as far as can be told from what has come.
    pub(super) fn next_run(&self, line: Estimate) -> Option<(RequestId, &Run)> {
        let wanted = self.runs.iter().filter(|(_, run)| run.outstanding() > 0.0);
        let (id, run) = wanted.min_by(|(_, a), (_, b)| {
            let order = earlier(a, b, line);
            order.then(a.frame.cmp(&b.frame))
        })?;
        Some((*id, run))
    }

    /// When it counts as lost if nothing comes, by its own rhythm.
    pub(super) fn patience_ends(&self) -> Option<f64> {
        Some(self.next_message(None)? + self.patience_secs()?)
    }

    /// The same for each frame that it still holds, by when its first message for that one should
    /// come: most pauses end, and meanwhile what it is asked for later waits its turn.
    pub(super) fn patience_ends_by_frame(&self) -> Option<BTreeMap<FrameId, f64>> {
        let patience_secs = self.patience_secs()?;
        let mut ends = BTreeMap::new();
        for prospect in self.prospects(0.0, None) {
            let run = &self.runs[&prospect.run];
            let next = prospect.soonest + prospect.pace * self.rhythm.next_work(run);
            if !run.lost {
                ends.entry(run.frame).or_insert(next + patience_secs);
            }
        }
        Some(ends)
    }

    fn patience_secs(&self) -> Option<f64> {
        let mut frames = self.runs.values().map(|run| run.frame);
        let first = frames.next();
        let several_frames = frames.any(|frame| Some(frame) != first);
        self.rhythm.patience_secs(several_frames)
    }
}

/// How many times as long as before a node must take for what comes to be taken to have slowed down.
const SLOWED: f64 = 2.0;
/// Share of an error by which the mean deviation moves.
const DEVIATION_GAIN: f64 = 0.05;
/// The most that one message may count: so many deviations and so many seconds.
const OUTLIER: f64 = 4.0;
const OUTLIER_SECS: f64 = 1e-3;
/// Share of a new burst that is believed at once.
const BURST_GAIN: f64 = 0.25;
/// What is left of the usual work with each smaller run.
const USUAL_KEPT: f64 = 0.95;
/// A node is taken for lost when its next message is late by this many mean deviations: of
/// exponential delays one in a hundred is.
const LOST_FACTOR: f64 = 5.0;
/// The same where it costs more to be wrong: one in a thousand is.
const LOST_FACTOR_SEVERAL: f64 = 8.0;
/// … and by at least this many seconds.
const LOST_SECS_MIN: f64 = 3e-3;
/// The same of one that has hardly been asked for anything: as others are lost it is turned to, and it may
/// be lost with them.
const LOST_SECS_MIN_NEW: f64 = 24e-3;
/// Bursts that are over before help comes. With 64 nodes on a local network, frames of 1.26 times
/// the optimum become 1.23, and the 99th percentile 1.4 instead of 1.6.
const MUTE_BURSTS: f64 = 2.5;
/// A message with exponential delays is later than this many mean deviations one time in fifty.
const GUARD_FACTOR: f64 = 4.0;
/// First messages of frames before a rhythm counts.
const MESSAGES_MIN: u32 = 8;
/// What is left of caution after each message.
const CAUTION_KEPT: f64 = 0.998;
/// How much longer than others a node is waited for that has been taken for lost by mistake.
const CAUTION_MAX: f64 = 8.0;

#[cfg(test)]
mod tests {
    use carom_tracer::{ImageSize, TileGrid, TileRange};

    use super::super::sample_passes::Passes;
    use super::*;
    use crate::balancer::Observation;

    const FIXED_SECS: f64 = 0.01;
    const PACE: f64 = 0.001;

    /// A node with a known line that has been asked for runs of ten tiles, of `frames`, at `issued`.
    fn node(asked: &[(u64, f64)]) -> Node {
        let mut node = Node::new(String::new());
        node.estimator.observe(&Observation {
            work: 100.0,
            response_secs: FIXED_SECS + 100.0 * PACE,
            queue_secs: 0.0,
            busy_secs: 100.0 * PACE,
            round_trip_secs: Some(FIXED_SECS),
        });
        let passes = Passes::one(TileGrid::new(ImageSize::new(40, 1), 1), 1);
        for (id, (frame, issued)) in asked.iter().enumerate() {
            let tiles = TileRange {
                first: 0,
                count: 10,
            };
            let run = Run::new(*issued, FrameId(*frame), passes, tiles, 10.0);
            node.ask(*issued, RequestId(id as u64), run);
        }
        node
    }

    fn order(node: &Node, now: f64) -> Vec<u64> {
        let prospects = node.prospects(now, None);
        prospects.iter().map(|prospect| prospect.run.0).collect()
    }

    #[test]
    fn what_is_asked_again_of_an_old_frame_comes_before_what_waits_of_later_ones() {
        let mut node = node(&[(1, 0.0), (1, 0.0), (1, 0.0), (0, 0.002)]);
        // It arrives when the first is being traced, which is ended.
        assert_eq!(order(&node, 0.002), [0, 3, 1, 2]);
        let [first, again, ..] = node.prospects(0.002, None)[..] else {
            unreachable!()
        };
        assert!((again.begin - first.finish()).abs() < 1e-12);
        // A message of the first tells that the others have waited.
        node.hear(0.015, RequestId(0), FrameId(1));
        assert!(
            node.runs
                .values()
                .skip(1)
                .all(|run| run.others_until == 0.015)
        );
        let wait = |frame| node.wait_secs(0.002, FrameId(frame));
        assert!(wait(2) > wait(0) + 19.0 * PACE, "{} {}", wait(2), wait(0));
    }

    #[test]
    fn what_reaches_a_node_too_late_does_not_come_first() {
        let node = node(&[(1, 0.0), (1, 0.0), (0, 0.015)]);
        assert_eq!(order(&node, 0.015), [0, 1, 2]);
    }

    #[test]
    fn a_pause_before_a_frame_is_not_taken_for_slowness_but_later_gaps_are() {
        let mut node = node(&[(0, 0.0), (1, 0.0)]);
        let line = node.delivered();
        let eight = |first| TileRange { first, count: 8 };
        let run = node.runs.get_mut(&RequestId(1)).unwrap();
        run.others_until = 0.02;
        let paused = run.clone();
        let receive = |run: &mut Run, now, is_first| {
            run.receive(now, eight(0), 8.0, 0.008, line, is_first);
        };
        receive(run, 0.048, true);
        assert_eq!(run.pace(0.0), 0.0);
        let mut slow = paused;
        receive(&mut slow, 0.048, false);
        assert!((slow.pace(0.0) - 3.5 * PACE).abs() < 1e-12);
    }

    #[test]
    fn a_node_is_waited_for_as_long_as_the_first_messages_of_frames_may_be_late() {
        let mut rhythm = Rhythm::default();
        for message in 0..200 {
            let is_first = message % 10 == 0;
            rhythm.observe(if is_first { 2e-3 } else { 0.0 }, is_first);
        }
        let patience = |several_frames| rhythm.patience_secs(several_frames).unwrap();
        assert!(patience(false) > 0.9 * LOST_FACTOR * 2e-3);
        assert!(patience(true) > 1.5 * patience(false));
    }

    #[test]
    fn a_silent_node_keeps_what_it_should_not_have_come_to_yet() {
        let mut node = node(&[(0, 0.0), (0, 0.0), (1, 0.016)]);
        for _ in 0..MESSAGES_MIN {
            node.rhythm.observe(0.0, true);
        }
        let lost = |node: &Node| -> Vec<bool> { node.runs.values().map(|run| run.lost).collect() };
        // The first message of frame 0 is due at 20 ms, that of frame 1 at 40.
        let first = FIXED_SECS + 10.0 * PACE + LOST_SECS_MIN;
        assert!(!node.falls_silent(first - 1e-6, true));
        assert!(node.falls_silent(first + 1e-6, true));
        assert_eq!(lost(&node), [true, true, false]);
        // Work that it is asked for while it is silent is not relied on.
        let more = node.runs[&RequestId(2)].clone();
        node.ask(first, RequestId(3), more);
        assert_eq!(lost(&node), [true, true, false, true]);
        let second = first + 20.0 * PACE;
        assert!(!node.falls_silent(second - 1e-6, true));
        assert!(node.falls_silent(second + 1e-6, true));
        assert_eq!(lost(&node), [true; 4]);
        assert!(node.hear(second + 1e-3, RequestId(0), FrameId(0)));
        assert_eq!(lost(&node), [false; 4]);
    }

    #[test]
    fn an_unhedged_node_loses_all_at_once() {
        let mut node = node(&[(0, 0.0), (1, 0.016)]);
        for _ in 0..MESSAGES_MIN {
            node.rhythm.observe(0.0, true);
        }
        assert!(node.falls_silent(10.0, false));
        assert!(node.runs.values().all(|run| run.lost));
    }

    #[test]
    fn what_is_asked_of_a_node_whose_messages_are_early_is_expected_early() {
        let mut node = node(&[(0, 0.0), (1, 0.0)]);
        node.drift.observe(FrameId(0), -0.003, false);
        // Frame 0 ends at 20 ms; asked for at 12, more of it is there just before that.
        let asked = 0.012;
        let begins = asked + FIXED_SECS - 0.003 + node.wait_secs(asked, FrameId(0));
        assert!((begins - 0.020).abs() < 1e-12, "{begins}");
        let mut more = node.runs[&RequestId(0)].clone();
        (more.issued, more.drift_secs) = (asked, node.drift.of(FrameId(0)));
        node.ask(asked, RequestId(2), more);
        let prospects = node.prospects(asked, None);
        assert_eq!(prospects[1].run, RequestId(2));
        assert!((prospects[1].begin - begins).abs() < 1e-12);
    }
}
