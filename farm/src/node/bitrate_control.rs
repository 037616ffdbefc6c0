//! Which precision a link carries: coarser when tiles keep waiting for it, finer when it turns out
//! to carry more. Pure; `now` is an argument.
//!
//! From one stop to the next, bytes may fall to a third: so the dial has places between them, at
//! which messages are of the one or the other: always the same ones, as a tile can be told only from one of its own
//! kind. What stops weigh is learnt ([`Weights`]), and those that weigh more than finer ones are left out.
//!
//! What a link carries is known only while it is full: a window that is never full says nothing of
//! what more would do. So the dial is turned slowly towards finer stops until most of that is used,
//! further now and then, back at the first sign of a queue, and then it is left alone for twice as
//! long as before.
//!
//! At the start a queue would be seen too late: a round trip after the first frames all those between
//! wait in it already. So for half a second no more is asked of a link than it is known to carry.

use std::time::Duration;

use carom_protocol::{PixelPrecision, PrecisionRange};

use super::rate_model::{Weighed, Weights};

/// What a transport knows of its path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkMeasure {
    /// Bytes per second that may leave: the congestion window over the round trip.
    pub bytes_per_sec: f64,
    /// Bytes that have not been sent or not been acknowledged.
    pub waiting_bytes: usize,
}

/// The precision of one client's tiles.
#[derive(Clone, Debug)]
pub(super) struct Governor {
    /// A place among the stops, 0 for the finest.
    level: f64,
    weights: Weights,
    changed: Duration,
    /// The level before, while finer ones are tried.
    on_trial: Option<f64>,
    /// How long a level is kept before finer ones are tried.
    patience: Duration,
    /// When the first tiles had been encoded.
    began: Option<Duration>,
    /// Since when it has been counted.
    since: Duration,
    offered_bytes: usize,
    /// Bytes per second, over some frames.
    offered_per_sec: f64,
    /// The least time that tiles have waited since then, and the rate.
    least: Option<(f64, f64)>,
    /// The least time when it was last decided.
    waited_secs: f64,
}

impl Governor {
    pub(super) const fn new() -> Self {
        Self {
            level: 0.0,
            weights: Weights::new(),
            changed: Duration::ZERO,
            on_trial: None,
            patience: PATIENCE_FIRST,
            began: None,
            since: Duration::ZERO,
            offered_bytes: 0,
            offered_per_sec: 0.0,
            least: None,
            waited_secs: 0.0,
        }
    }

    /// The precision for the tiles of the message at `place` in the picture.
    pub(super) fn precision(&mut self, range: PrecisionRange, place: u32) -> PixelPrecision {
        let (finest, coarsest) = (range.finest as usize, range.coarsest as usize);
        self.level = self.level.clamp(finest as f64, coarsest as f64);
        let stops = self.weights.between(self.level);
        let is_coarser = drawn(place) < stops.share;
        let stop = if is_coarser {
            stops.coarser
        } else {
            stops.finer
        };
        PixelPrecision::ALL[stop.clamp(finest, coarsest)]
    }

    /// Tiles have been encoded.
    pub(super) fn offer(&mut self, message: Weighed) {
        self.weights.learn(message);
        self.offered_bytes += message.bytes;
    }

    /// The transport has looked at its path.
    pub(super) fn measure(&mut self, now: Duration, link: LinkMeasure) {
        if self.began.is_none() {
            (self.began, self.since) = (Some(now), now);
        }
        let wait = link.waiting_bytes as f64 / link.bytes_per_sec.max(1.0);
        if let Some(before) = self.on_trial
            && wait > STANDING_WAIT_SECS
        {
            self.take_back(now, before);
        }
        let least = self.least.map_or(f64::INFINITY, |(wait, _)| wait);
        self.least = Some((wait.min(least), link.bytes_per_sec));
        let counted = now.saturating_sub(self.since);
        let enough = if wait > HURRY_SECS { HURRIED } else { COUNTED };
        if counted < enough {
            return;
        }
        let (least_wait, bytes_per_sec) = self.least.take().unwrap_or((wait, link.bytes_per_sec));
        let state = LinkState {
            bytes_per_sec,
            offered_bytes_per_sec: self.offered_bytes as f64 / counted.as_secs_f64(),
            standing_wait_secs: least_wait,
        };
        (self.since, self.offered_bytes) = (now, 0);
        self.decide(now, counted, &state);
    }

    fn decide(&mut self, now: Duration, counted: Duration, link: &LinkState) {
        self.offered_per_sec += OFFERED_GAIN * (link.offered_bytes_per_sec - self.offered_per_sec);
        let waited_before = std::mem::replace(&mut self.waited_secs, link.standing_wait_secs);
        let unchanged = now.saturating_sub(self.changed);
        let began = self.began.unwrap_or(now);
        let asked = link.offered_bytes_per_sec / link.bytes_per_sec.max(1.0);
        let is_start = now.saturating_sub(began) < START && self.level < START_LEVEL;
        if is_start && asked > COARSER_LOAD {
            let level = self.coarser(link).max(START_LEVEL);
            self.change(now, level);
            return;
        }
        if unchanged < SETTLES {
            return;
        }
        if link.standing_wait_secs > STANDING_WAIT_SECS {
            if link.standing_wait_secs > DRAINS * waited_before {
                self.change(now, self.coarser(link));
            }
        } else if link.standing_wait_secs < 0.5 * STANDING_WAIT_SECS && self.level > 0.0 {
            let is_known = self.offered_per_sec < FINER_LOAD * link.bytes_per_sec;
            match self.on_trial {
                Some(before) if before - self.level >= 1.0 => {
                    self.patience = self.patience.min(PATIENCE_MIN);
                }
                None if !is_known && unchanged < self.patience => return,
                None if !is_known => self.on_trial = Some(self.level),
                _ => {}
            }
            let is_first = self.patience == PATIENCE_FIRST;
            let stops_per_sec = if is_first { 2.0 } else { 1.0 } * STOPS_PER_SEC;
            let step = stops_per_sec * counted.as_secs_f64();
            self.level = (self.level - step).max(0.0);
        }
    }

    /// The level for a link on which tiles keep waiting: the finest of which it carries [`COARSER_LOAD`]
    /// beside what waits, within [`DRAIN_SECS`].
    fn coarser(&self, link: &LinkState) -> f64 {
        let step = STEP_BACK + link.standing_wait_secs / STEP_BACK_SECS;
        let free = COARSER_LOAD - link.standing_wait_secs / DRAIN_SECS;
        let share = free * link.bytes_per_sec / link.offered_bytes_per_sec.max(1.0);
        let level = self
            .weights
            .level_of(share * self.weights.weight(self.level));
        level.max(self.level + step)
    }

    /// Ends a trial that has failed.
    fn take_back(&mut self, now: Duration, before: f64) {
        self.patience = (2 * self.patience).clamp(PATIENCE_MIN, PATIENCE_MAX);
        self.change(now, (self.level + STEP_BACK).max(before));
    }

    fn change(&mut self, now: Duration, level: f64) {
        (self.level, self.changed, self.on_trial) = (level, now, None);
        // What waits now was encoded before: it says nothing of this level.
        (self.since, self.offered_bytes, self.least) = (now, 0, None);
    }
}

/// What [`Governor::coarser`] goes by.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LinkState {
    /// What the link carries.
    bytes_per_sec: f64,
    /// What is asked of it, at the present level.
    offered_bytes_per_sec: f64,
    /// The least time that tiles have waited for it lately: bursts come and go, a queue stays.
    standing_wait_secs: f64,
}

/// A number from 0 to 1 for each place, those of neighbours far from each other: multiples of the golden
/// ratio.
fn drawn(place: u32) -> f64 {
    f64::from(place.wrapping_mul(0x9e37_79b9)) / 4_294_967_296.0
}

/// Two frames: shorter ones may hold a burst and no pause.
const COUNTED: Duration = Duration::from_millis(35);
/// A link that is far too slow: a second of its bytes may come in a moment.
const HURRY_SECS: f64 = 0.033;
const HURRIED: Duration = Duration::from_millis(5);
/// What the transport has taken waits for some 20 ms already then.
const STANDING_WAIT_SECS: f64 = 0.006;
/// Half a second: ten round trips of the longest paths that are played over.
const START: Duration = Duration::from_millis(500);
/// How these pixels compress is not known yet: of noise JPEG 90 takes more bytes than levels do, and 75
/// few.
const START_LEVEL: f64 = PixelPrecision::Lossy75 as usize as f64;
/// After a change, tiles that had been encoded before still leave for so long.
const SETTLES: Duration = Duration::from_millis(50);
/// Towards finer levels; twice as fast before any has turned out too fine.
const STOPS_PER_SEC: f64 = 0.5;
/// Some six frames.
const OFFERED_GAIN: f64 = 0.3;
/// What is known to be carried is used up to here; more is tried.
const FINER_LOAD: f64 = 0.85;
/// From a level that was too fine: what has come to wait meanwhile must go as well.
const STEP_BACK: f64 = 0.25;
/// Pixels may be worse to compress than is known: the longer they wait, the longer the step.
const STEP_BACK_SECS: f64 = 0.02;
/// Before finer levels are tried the first time, when the start may have been too careful ...
const PATIENCE_FIRST: Duration = Duration::from_millis(250);
/// ... after some that held ...
const PATIENCE_MIN: Duration = Duration::from_secs(2);
/// ... and after many that did not: a frame late in two thousand.
const PATIENCE_MAX: Duration = Duration::from_secs(32);
const COARSER_LOAD: f64 = 0.9;
/// A queue that gets shorter so fast needs no coarser level.
const DRAINS: f64 = 0.8;
const DRAIN_SECS: f64 = 0.1;

#[cfg(test)]
mod tests {
    use carom_protocol::tile_codec::DeltaStats;

    use super::*;

    fn link(megabits: f64, offered: f64, wait_ms: f64) -> LinkState {
        LinkState {
            bytes_per_sec: megabits * 125e3,
            offered_bytes_per_sec: offered * 125e3,
            standing_wait_secs: wait_ms * 1e-3,
        }
    }

    fn at(level: f64) -> Governor {
        Governor {
            level,
            ..Governor::new()
        }
    }

    #[test]
    fn a_link_that_is_too_slow_gets_what_it_carries_at_once() {
        for (megabits, offered) in [(450.0, 515.0), (130.0, 383.0), (50.0, 383.0), (25.0, 31.0)] {
            let governor = at(1.0);
            let level = governor.coarser(&link(megabits, offered, 5.0));
            let weight = |level| governor.weights.weight(level);
            let next = offered * weight(level) / weight(1.0);
            let share = next / megabits;
            assert!((0.5..0.86).contains(&share), "{share} of {megabits} Mbit/s");
        }
        assert_eq!(at(1.0).coarser(&link(5.0, 383.0, 10.0)), 5.0);
    }

    #[test]
    fn what_waits_already_asks_for_coarser_levels() {
        let next = |wait_ms| at(0.0).coarser(&link(100.0, 110.0, wait_ms));
        assert!(next(9.0) < next(40.0) && next(40.0) < next(120.0));
    }

    const ANY: PrecisionRange = PrecisionRange {
        finest: PixelPrecision::Exact,
        coarsest: PixelPrecision::Lossy50,
    };

    #[test]
    fn between_two_stops_messages_are_of_the_one_or_the_other_and_stay_so() {
        let mut governor = at(3.3);
        let mut chosen = || -> Vec<_> {
            (0..100)
                .map(|place| governor.precision(ANY, place))
                .collect()
        };
        let first = chosen();
        let coarse = first
            .iter()
            .filter(|stop| **stop == PixelPrecision::Lossy75);
        let fine = first
            .iter()
            .filter(|stop| **stop == PixelPrecision::Lossy90);
        let [fine, coarse] = [fine.count(), coarse.count()];
        assert!(
            fine + coarse == 100 && fine.abs_diff(70) < 3,
            "{fine} {coarse}"
        );
        assert_eq!(chosen(), first);
        let only = PrecisionRange::only(PixelPrecision::Within2);
        assert!((0..9).all(|place| governor.precision(only, place) == PixelPrecision::Within2));
    }

    /// What a message weighs at a stop, in a frame and after what was sent there before: bytes over those
    /// of an exact one of a turning camera, and the share of its pixels that changes to the eye.
    type Content = fn(frame: u32, stop: usize, before: Option<usize>) -> (f64, f64);

    /// Whether a message can be told from the one before.
    fn is_told(stop: usize, before: Option<usize>) -> bool {
        before.is_some_and(|before| stop >= 3 || before < 3)
    }

    /// All changes at once.
    fn turning(_: u32, stop: usize, _: Option<usize>) -> (f64, f64) {
        ([1.0, 0.74, 0.65, 0.18, 0.07, 0.036][stop], 1.0)
    }

    /// A few balls roll under a still camera: 20 Mbit/s of exact pixels and 30 of JPEG 90. What was JPEG before is told
    /// from nothing.
    fn few_balls(_: u32, stop: usize, before: Option<usize>) -> (f64, f64) {
        let changed = [0.05, 0.03, 0.025, 0.05, 0.05, 0.05][stop];
        match is_told(stop, before) {
            true => ([0.039, 0.022, 0.017, 0.058, 0.021, 0.015][stop], changed),
            false => (turning(0, stop, before).0, changed),
        }
    }

    /// A frame as it was sent.
    struct Sent {
        /// Of what the link carries in a frame.
        share: f64,
        /// Seconds that its last tile waits.
        wait: f64,
        /// Messages of each stop.
        stops: [u32; 6],
    }

    /// A link that carries `megabits` at a frame's moment, 515 Mbit/s of exact pixels at 60 Hz of a
    /// turning camera, and what does not fit waits until it is two frames old.
    fn drive(megabits: impl Fn(u32) -> f64, content: Content, frames: u32) -> Vec<Sent> {
        let mut governor = Governor::new();
        let (mut before, mut current, mut step) = (0.0, 0.0, 0);
        let mut held = [None; 16];
        let mut message = |frame: u32, rate: f64, place: usize, stops: &mut [u32; 6]| {
            if place == 0 {
                (before, current) = (current, 0.0);
            }
            let precision = governor.precision(ANY, place as u32);
            let stop = precision as usize;
            stops[stop] += 1;
            let last = held[place].replace(stop);
            let (weight, changed) = content(frame, stop, last);
            let pixels = 515e6 / 8.0 / 960.0 / 0.37;
            let bytes = 0.37 * pixels * weight;
            let referenced = if last.is_some() { pixels } else { 0.0 };
            let intra = if is_told(stop, last) { 0.0 } else { pixels };
            governor.offer(Weighed {
                precision,
                pixels: pixels as usize,
                delta: DeltaStats {
                    referenced: referenced as usize,
                    changed: (referenced * changed) as usize,
                    intra: intra as usize,
                },
                bytes: bytes as usize,
            });
            let carried = rate / 960.0;
            let first = f64::min(before, carried);
            (before, current) = (
                before - first,
                f64::max(current + bytes - carried + first, 0.0),
            );
            let link = LinkMeasure {
                bytes_per_sec: rate,
                waiting_bytes: (before + current) as usize,
            };
            governor.measure(Duration::from_secs_f64(f64::from(step) / 960.0), link);
            step += 1;
            (bytes, (before + current) / rate)
        };
        let frame = |frame| {
            let rate = megabits(frame) * 125e3;
            let mut stops = [0; 6];
            let (mut bytes, mut wait) = (0.0, 0.0);
            for place in 0..16 {
                let sent = message(frame, rate, place, &mut stops);
                (bytes, wait) = (bytes + sent.0, sent.1);
            }
            let share = bytes * 60.0 / rate;
            Sent { share, wait, stops }
        };
        (0..frames).map(frame).collect()
    }

    #[test]
    fn it_settles_within_ten_frames_and_uses_the_link() {
        for megabits in [22.0, 25.0, 50.0, 100.0, 250.0, 400.0, 500.0, 1000.0] {
            let frames = drive(|_| megabits, turning, 1800);
            let slow = frames.iter().filter(|frame| frame.wait > 0.0333).count();
            assert!(slow < 10, "{slow} slow frames at {megabits} Mbit/s");
            let longest = frames[60..].iter().map(|frame| frame.wait);
            let longest = longest.fold(0.0, f64::max);
            assert!(longest < 0.0167, "{longest} s at {megabits} Mbit/s");
            let settled = &frames[600..];
            let used = settled.iter().map(|frame| frame.share).sum::<f64>() / settled.len() as f64;
            let most = f64::min(515.0 / megabits, 1.0);
            assert!(used > 0.8 * most, "{used} of {megabits} Mbit/s");
        }
    }

    #[test]
    fn a_link_that_gets_faster_is_used() {
        let megabits = |frame| if frame < 600 { 25.0 } else { 1000.0 };
        let frames = drive(megabits, turning, 4800);
        assert!(frames[599].share <= 1.1, "{}", frames[599].share);
        assert!(frames[4799].share > 0.51, "{}", frames[4799].share);
    }

    /// JPEG only while the first picture comes.
    #[test]
    fn a_still_camera_gets_exact_pixels_where_they_fit_though_jpeg_weighs_more() {
        let frames = drive(|_| 25.0, few_balls, 1800);
        let lossy = |sent: &Sent| sent.stops[3..].iter().sum::<u32>();
        let last = frames.iter().rposition(|frame| lossy(frame) > 0);
        assert!(last.is_none_or(|last| last < 300), "JPEG in frame {last:?}");
        let settled = &frames[600..];
        assert!(settled.iter().all(|frame| frame.stops[0] == 16));
        assert!(settled.iter().all(|frame| frame.wait < 0.0167));
    }

    #[test]
    fn a_camera_that_begins_to_turn_gets_coarser_and_back_to_exact_when_it_stops() {
        let content: Content = |frame, stop, before| match frame {
            600..1200 => turning(frame, stop, before),
            _ => few_balls(frame, stop, before),
        };
        let frames = drive(|_| 25.0, content, 2400);
        let late = frames[610..1200].iter().filter(|frame| frame.wait > 0.0333);
        assert!(late.count() < 10);
        assert!(frames[700..1200].iter().all(|frame| frame.share < 1.1));
        assert!(frames[1800..].iter().all(|frame| frame.stops[0] == 16));
        // Up and down again only as the camera starts and stops.
        let level = |sent: &Sent| {
            (0..6)
                .map(|stop| stop as u32 * sent.stops[stop])
                .sum::<u32>()
        };
        let levels: Vec<u32> = frames[640..1200].iter().map(level).collect();
        let turns = levels
            .windows(2)
            .filter(|pair| pair[1] > pair[0] + 4)
            .count();
        assert!(turns < 5, "{turns} steps down");
    }

    /// Nothing waits yet, as the first window takes it all.
    #[test]
    fn at_the_start_no_more_is_asked_of_a_link_than_it_is_known_to_carry() {
        for (megabits, is_coarser) in [(20.0, true), (100.0, false)] {
            let mut governor = Governor::new();
            for message in 0..48u32 {
                governor.offer(Weighed {
                    precision: PixelPrecision::Exact,
                    pixels: 1352,
                    delta: DeltaStats::default(),
                    bytes: 4061,
                });
                let link = LinkMeasure {
                    bytes_per_sec: megabits * 125e3,
                    waiting_bytes: 0,
                };
                let now = Duration::from_secs(3) + message * Duration::from_micros(1042);
                governor.measure(now, link);
            }
            assert_eq!(governor.level > 0.0, is_coarser, "{megabits} Mbit/s");
        }
    }

    #[test]
    fn a_burst_changes_nothing() {
        let mut governor = Governor::new();
        for step in 0..6000u32 {
            let waiting_bytes = if step % 8 < 4 { 200_000 } else { 0 };
            let link = LinkMeasure {
                bytes_per_sec: 12.5e6,
                waiting_bytes,
            };
            governor.measure(Duration::from_millis(2 * u64::from(step)), link);
        }
        assert_eq!(governor.level, 0.0);
    }
}
