//! Bitrate control: chooses the pixel precision that a link can carry, coarser while tiles keep waiting,
//! finer as the link turns out to carry more. Pure; `now` is an argument.
//!
//! The level is a continuous position between the precisions. A link's capacity is known only while it is
//! saturated, so an unsaturated one is probed in steps: towards finer pixels until most of the known
//! bandwidth is used, further at intervals, and back at the first sign of a queue, which doubles the
//! interval until the next probe.

use std::time::Duration;

use carom_protocol::{PixelPrecision, PrecisionRange};

use super::rate_model::{EncodedSample, RateModel};

/// A transport's estimate of its path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkEstimate {
    /// Bytes per second that may be sent: congestion window over round-trip time.
    pub bytes_per_sec: f64,
    /// Bytes that have not been sent or acknowledged.
    pub waiting_bytes: usize,
}

/// Controller of one client's precision.
#[derive(Clone, Debug)]
pub(super) struct BitrateController {
    /// Position between the precisions' indices, 0 for the finest.
    level: f64,
    model: RateModel,
    last_change: Duration,
    /// Level before the current probe.
    probe_start: Option<f64>,
    /// Time without a change after which a probe starts.
    probe_interval: Duration,
    /// Time of the first estimate.
    start: Option<Duration>,
    /// Start of the current measurement interval.
    interval_start: Duration,
    /// Bytes encoded in this interval.
    offered_bytes: usize,
    /// Encoded bytes per second, smoothed over some frames.
    offered_bytes_per_sec: f64,
    /// Shortest wait in this interval in seconds, with the bandwidth at that time.
    min_wait: Option<(f64, f64)>,
    /// Shortest wait of the previous interval.
    last_wait_secs: f64,
}

impl BitrateController {
    pub(super) fn new() -> Self {
        Self {
            level: 0.0,
            model: RateModel::default(),
            last_change: Duration::ZERO,
            probe_start: None,
            probe_interval: FIRST_PROBE_INTERVAL,
            start: None,
            interval_start: Duration::ZERO,
            offered_bytes: 0,
            offered_bytes_per_sec: 0.0,
            min_wait: None,
            last_wait_secs: 0.0,
        }
    }

    /// The precision for the tiles of the message at index `place` in the picture.
    pub(super) fn precision(&mut self, range: PrecisionRange, place: u32) -> PixelPrecision {
        let (finest, coarsest) = (range.finest as usize, range.coarsest as usize);
        self.level = self.level.clamp(finest as f64, coarsest as f64);
        let blend = self.model.blend(self.level);
        // Chosen by place, so that a message keeps its precision from frame to frame: delta coding needs a
        // reference of the same kind.
        let is_coarser = dither(place) < blend.share;
        let index = if is_coarser {
            blend.coarser
        } else {
            blend.finer
        };
        PixelPrecision::ALL[index.clamp(finest, coarsest)]
    }

    /// Handles an encoded message.
    pub(super) fn on_encoded(&mut self, message: EncodedSample) {
        self.model.update(message);
        self.offered_bytes += message.bytes;
    }

    /// Handles the transport's estimate of its path.
    pub(super) fn on_estimate(&mut self, now: Duration, link: LinkEstimate) {
        if self.start.is_none() {
            (self.start, self.interval_start) = (Some(now), now);
        }
        // As a time: the same number of queued bytes is late on a slow link and harmless on a fast one.
        let wait = link.waiting_bytes as f64 / link.bytes_per_sec.max(1.0);
        if let Some(before) = self.probe_start
            && wait > STANDING_WAIT_SECS
        {
            // At once, not at the interval's end, as the probe itself has caused the queue.
            self.fail_probe(now, before);
        }
        // The minimum over an interval separates a standing queue from bursts, as in CoDel (Nichols and
        // Jacobson 2012).
        let min_wait = self.min_wait.map_or(f64::INFINITY, |(wait, _)| wait);
        self.min_wait = Some((wait.min(min_wait), link.bytes_per_sec));
        let elapsed = now.saturating_sub(self.interval_start);
        let interval = if wait > OVERLOAD_SECS {
            OVERLOAD_INTERVAL
        } else {
            INTERVAL
        };
        if elapsed < interval {
            return;
        }
        let (min_wait, bytes_per_sec) = self.min_wait.take().unwrap_or((wait, link.bytes_per_sec));
        let state = LinkState {
            bytes_per_sec,
            offered_bytes_per_sec: self.offered_bytes as f64 / elapsed.as_secs_f64(),
            standing_wait_secs: min_wait,
        };
        (self.interval_start, self.offered_bytes) = (now, 0);
        self.decide(now, elapsed, &state);
    }

    fn decide(&mut self, now: Duration, elapsed: Duration, link: &LinkState) {
        self.offered_bytes_per_sec +=
            // Smoothed only for steps to finer levels: those to coarser ones must not lag.
            OFFERED_GAIN * (link.offered_bytes_per_sec - self.offered_bytes_per_sec);
        let wait_before = std::mem::replace(&mut self.last_wait_secs, link.standing_wait_secs);
        let unchanged = now.saturating_sub(self.last_change);
        let start = self.start.unwrap_or(now);
        // At the start, a queue would be noticed only a round trip later, when all frames sent meanwhile
        // wait in it: no more is offered than the path is known to carry.
        let load = link.offered_bytes_per_sec / link.bytes_per_sec.max(1.0);
        let is_start = now.saturating_sub(start) < START && self.level < START_LEVEL;
        if is_start && load > COARSER_LOAD {
            let level = self.coarser_level(link).max(START_LEVEL);
            self.set_level(now, level);
            return;
        }
        // The present queue was encoded before the last change.
        if unchanged < SETTLING {
            return;
        }
        if link.standing_wait_secs > STANDING_WAIT_SECS {
            // A queue that drains fast enough needs no action: each coarser step costs quality.
            if link.standing_wait_secs > DRAINING * wait_before {
                self.set_level(now, self.coarser_level(link));
            }
        } else if link.standing_wait_secs < 0.5 * STANDING_WAIT_SECS && self.level > 0.0 {
            let is_carried = self.offered_bytes_per_sec < FINER_LOAD * link.bytes_per_sec;
            match self.probe_start {
                // A probe that has gained a whole level has succeeded: the next may start soon.
                Some(before) if before - self.level >= 1.0 => {
                    self.probe_interval = self.probe_interval.min(PROBE_INTERVAL_MIN);
                }
                None if !is_carried && unchanged < self.probe_interval => return,
                None if !is_carried => self.probe_start = Some(self.level),
                _ => {}
            }
            let is_first = self.probe_interval == FIRST_PROBE_INTERVAL;
            let levels_per_sec = if is_first { 2.0 } else { 1.0 } * LEVELS_PER_SEC;
            let step = levels_per_sec * elapsed.as_secs_f64();
            self.level = (self.level - step).max(0.0);
        }
    }

    /// The level for a link with a standing queue: the finest that loads it by [`COARSER_LOAD`] while the
    /// queue drains within [`DRAIN_SECS`].
    fn coarser_level(&self, link: &LinkState) -> f64 {
        let step = STEP_BACK + link.standing_wait_secs / STEP_BACK_SECS;
        // Draining a queue of w seconds within DRAIN_SECS takes the share w / DRAIN_SECS of the bandwidth
        // from the new tiles.
        let free = COARSER_LOAD - link.standing_wait_secs / DRAIN_SECS;
        let share = free * link.bytes_per_sec / link.offered_bytes_per_sec.max(1.0);
        let level = self.model.level_of(share * self.model.rate(self.level));
        // At least one step, in case the rate model is too optimistic.
        level.max(self.level + step)
    }

    /// Ends a probe that has caused a queue.
    fn fail_probe(&mut self, now: Duration, before: f64) {
        let interval = 2 * self.probe_interval;
        self.probe_interval = interval.clamp(PROBE_INTERVAL_MIN, PROBE_INTERVAL_MAX);
        self.set_level(now, (self.level + STEP_BACK).max(before));
    }

    fn set_level(&mut self, now: Duration, level: f64) {
        (self.level, self.last_change, self.probe_start) = (level, now, None);
        // The queued tiles were encoded at the previous level, so the measurement restarts.
        (self.interval_start, self.offered_bytes, self.min_wait) = (now, 0, None);
    }
}

/// State of a link over one interval.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LinkState {
    /// Bandwidth of the link.
    bytes_per_sec: f64,
    /// Load at the present level.
    offered_bytes_per_sec: f64,
    /// Shortest wait of tiles: bursts pass, a standing queue remains.
    standing_wait_secs: f64,
}

/// A number in [0, 1) for each place: multiples of 2³² / φ modulo 2³² (φ the golden ratio), a
/// low-discrepancy sequence, so that neighbours get distant values and any share is spread evenly.
fn dither(place: u32) -> f64 {
    f64::from(place.wrapping_mul(0x9e37_79b9)) / 4_294_967_296.0
}

/// Measurement interval of two frames: a shorter one may hold a burst and no gap.
const INTERVAL: Duration = Duration::from_millis(35);
/// Wait in seconds that shows a link to be far too slow: then the shorter [`OVERLOAD_INTERVAL`] applies, as
/// a second's worth of bytes may accumulate quickly.
const OVERLOAD_SECS: f64 = 0.033;
const OVERLOAD_INTERVAL: Duration = Duration::from_millis(5);
/// Standing wait in the session from which on the level gets coarser, in seconds; tiles that the transport
/// has accepted wait for some 20 ms more.
const STANDING_WAIT_SECS: f64 = 0.006;
/// Duration of the start phase: ten round trips of the longest playable paths.
const START: Duration = Duration::from_millis(500);
/// Finest level for a link that is overloaded in the start phase, when it is not known how the pixels
/// compress: of noise, JPEG 90 takes more bytes than quantised pixels, JPEG 75 few.
const START_LEVEL: f64 = PixelPrecision::Lossy75 as usize as f64;
/// Time after a change during which tiles encoded before it are still being sent.
const SETTLING: Duration = Duration::from_millis(50);
/// Rate of the steps to finer levels; doubled before the first failed probe.
const LEVELS_PER_SEC: f64 = 0.5;
/// Gain per interval of the smoothed load: a time constant of some six frames.
const OFFERED_GAIN: f64 = 0.3;
/// Share of the known bandwidth up to which finer levels need no probe.
const FINER_LOAD: f64 = 0.85;
/// Minimum step to a coarser level: the queue that a failed probe has built must drain as well.
const STEP_BACK: f64 = 0.25;
/// Wait in seconds per further level of a coarser step: pixels may compress worse than the model predicts.
const STEP_BACK_SECS: f64 = 0.02;
/// Probe interval before the first probe, as the start may have been too careful …
const FIRST_PROBE_INTERVAL: Duration = Duration::from_millis(250);
/// … its minimum afterwards …
const PROBE_INTERVAL_MIN: Duration = Duration::from_secs(2);
/// … and its maximum after failed probes: one late frame in two thousand.
const PROBE_INTERVAL_MAX: Duration = Duration::from_secs(32);
/// Target load of a coarser level, as a share of the bandwidth.
const COARSER_LOAD: f64 = 0.9;
/// Factor per interval by which a queue must shrink to need no coarser level.
const DRAINING: f64 = 0.8;
/// Time in seconds in which a coarser level is to drain the queue.
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

    fn at(level: f64) -> BitrateController {
        BitrateController {
            level,
            ..BitrateController::new()
        }
    }

    #[test]
    fn a_slow_link_gets_what_it_carries_at_once() {
        for (megabits, offered) in [(450.0, 515.0), (130.0, 383.0), (50.0, 383.0), (25.0, 31.0)] {
            let controller = at(1.0);
            let level = controller.coarser_level(&link(megabits, offered, 5.0));
            let rate = |level| controller.model.rate(level);
            let next = offered * rate(level) / rate(1.0);
            let share = next / megabits;
            assert!((0.5..0.86).contains(&share), "{share} of {megabits} Mbit/s");
        }
        assert_eq!(at(1.0).coarser_level(&link(5.0, 383.0, 10.0)), 5.0);
    }

    #[test]
    fn longer_waits_ask_for_coarser_levels() {
        let next = |wait_ms| at(0.0).coarser_level(&link(100.0, 110.0, wait_ms));
        assert!(next(9.0) < next(40.0) && next(40.0) < next(120.0));
    }

    const ANY: PrecisionRange = PrecisionRange {
        finest: PixelPrecision::Exact,
        coarsest: PixelPrecision::Lossy50,
    };

    #[test]
    fn messages_keep_one_of_two_precisions() {
        let mut controller = at(3.3);
        let mut chosen = || -> Vec<_> {
            (0..100)
                .map(|place| controller.precision(ANY, place))
                .collect()
        };
        let first = chosen();
        let coarse = first
            .iter()
            .filter(|precision| **precision == PixelPrecision::Lossy75);
        let fine = first
            .iter()
            .filter(|precision| **precision == PixelPrecision::Lossy90);
        let [fine, coarse] = [fine.count(), coarse.count()];
        assert!(
            fine + coarse == 100 && fine.abs_diff(70) < 3,
            "{fine} {coarse}"
        );
        assert_eq!(chosen(), first);
        let only = PrecisionRange::only(PixelPrecision::Within2);
        assert!((0..9).all(|place| controller.precision(only, place) == PixelPrecision::Within2));
    }

    /// The rate of a message at a precision, in a frame and after the precision of the message
    /// before it, and the share of its pixels that seem to change.
    type Content = fn(frame: u32, index: usize, before: Option<usize>) -> (f64, f64);

    /// Whether a message can be delta-coded against the one before.
    fn is_delta(index: usize, before: Option<usize>) -> bool {
        before.is_some_and(|before| index >= 3 || before < 3)
    }

    /// All changes at once.
    fn turning(_: u32, index: usize, _: Option<usize>) -> (f64, f64) {
        ([1.0, 0.74, 0.65, 0.18, 0.07, 0.036][index], 1.0)
    }

    /// A few balls roll under a still camera: 20 Mbit/s of exact pixels and 30 of JPEG 90. After
    /// JPEG, exact pixels have no reference.
    fn few_balls(_: u32, index: usize, before: Option<usize>) -> (f64, f64) {
        let changed = [0.05, 0.03, 0.025, 0.05, 0.05, 0.05][index];
        match is_delta(index, before) {
            true => ([0.039, 0.022, 0.017, 0.058, 0.021, 0.015][index], changed),
            false => (turning(0, index, before).0, changed),
        }
    }

    /// A frame as it was sent.
    struct SentFrame {
        /// Bytes as a share of what the link carries in a frame.
        share: f64,
        /// Seconds that its last tile waits.
        wait: f64,
        /// Messages of each precision.
        messages: [u32; 6],
    }

    /// A link that carries `megabits` at a frame's moment, 515 Mbit/s of exact pixels at 60 Hz of a
    /// turning camera, and what does not fit waits until it is two frames old.
    fn drive(megabits: impl Fn(u32) -> f64, content: Content, frames: u32) -> Vec<SentFrame> {
        let mut controller = BitrateController::new();
        let (mut before, mut current, mut step) = (0.0, 0.0, 0);
        let mut precisions = [None; 16];
        let mut message = |frame: u32, rate: f64, place: usize, messages: &mut [u32; 6]| {
            if place == 0 {
                (before, current) = (current, 0.0);
            }
            let precision = controller.precision(ANY, place as u32);
            let index = precision as usize;
            messages[index] += 1;
            let last = precisions[place].replace(index);
            let (rate_share, changed) = content(frame, index, last);
            let pixels = 515e6 / 8.0 / 960.0 / 0.37;
            let bytes = 0.37 * pixels * rate_share;
            let referenced = if last.is_some() { pixels } else { 0.0 };
            let intra = if is_delta(index, last) { 0.0 } else { pixels };
            controller.on_encoded(EncodedSample {
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
            let link = LinkEstimate {
                bytes_per_sec: rate,
                waiting_bytes: (before + current) as usize,
            };
            controller.on_estimate(Duration::from_secs_f64(f64::from(step) / 960.0), link);
            step += 1;
            (bytes, (before + current) / rate)
        };
        let frame = |frame| {
            let rate = megabits(frame) * 125e3;
            let mut messages = [0; 6];
            let (mut bytes, mut wait) = (0.0, 0.0);
            for place in 0..16 {
                let sent = message(frame, rate, place, &mut messages);
                (bytes, wait) = (bytes + sent.0, sent.1);
            }
            let share = bytes * 60.0 / rate;
            SentFrame {
                share,
                wait,
                messages,
            }
        };
        (0..frames).map(frame).collect()
    }

    #[test]
    fn it_settles_within_ten_frames_and_fills_the_link() {
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
    fn a_still_camera_gets_exact_pixels_where_they_fit() {
        let frames = drive(|_| 25.0, few_balls, 1800);
        let lossy = |sent: &SentFrame| sent.messages[3..].iter().sum::<u32>();
        let last = frames.iter().rposition(|frame| lossy(frame) > 0);
        assert!(last.is_none_or(|last| last < 300), "JPEG in frame {last:?}");
        let settled = &frames[600..];
        assert!(settled.iter().all(|frame| frame.messages[0] == 16));
        assert!(settled.iter().all(|frame| frame.wait < 0.0167));
    }

    #[test]
    fn a_turning_camera_gets_coarser_until_it_stops() {
        let content: Content = |frame, index, before| match frame {
            600..1200 => turning(frame, index, before),
            _ => few_balls(frame, index, before),
        };
        let frames = drive(|_| 25.0, content, 2400);
        let late = frames[610..1200].iter().filter(|frame| frame.wait > 0.0333);
        assert!(late.count() < 10);
        assert!(frames[700..1200].iter().all(|frame| frame.share < 1.1));
        assert!(frames[1800..].iter().all(|frame| frame.messages[0] == 16));
        // Up and down again only as the camera starts and messages.
        let level = |sent: &SentFrame| {
            (0..6)
                .map(|index| index as u32 * sent.messages[index])
                .sum::<u32>()
        };
        let levels: Vec<u32> = frames[640..1200].iter().map(level).collect();
        let turns = levels
            .windows(2)
            .filter(|pair| pair[1] > pair[0] + 4)
            .count();
        assert!(turns < 5, "{turns} steps down");
    }

    /// Nothing waits yet, as the first congestion window takes it all.
    #[test]
    fn the_start_offers_what_the_path_is_known_to_carry() {
        for (megabits, is_coarser) in [(20.0, true), (100.0, false)] {
            let mut controller = BitrateController::new();
            for message in 0..48u32 {
                controller.on_encoded(EncodedSample {
                    precision: PixelPrecision::Exact,
                    pixels: 1352,
                    delta: DeltaStats::default(),
                    bytes: 4061,
                });
                let link = LinkEstimate {
                    bytes_per_sec: megabits * 125e3,
                    waiting_bytes: 0,
                };
                let now = Duration::from_secs(3) + message * Duration::from_micros(1042);
                controller.on_estimate(now, link);
            }
            assert_eq!(controller.level > 0.0, is_coarser, "{megabits} Mbit/s");
        }
    }

    #[test]
    fn a_burst_changes_nothing() {
        let mut controller = BitrateController::new();
        for step in 0..6000u32 {
            let waiting_bytes = if step % 8 < 4 { 200_000 } else { 0 };
            let link = LinkEstimate {
                bytes_per_sec: 12.5e6,
                waiting_bytes,
            };
            controller.on_estimate(Duration::from_millis(2 * u64::from(step)), link);
        }
        assert_eq!(controller.level, 0.0);
    }
}
