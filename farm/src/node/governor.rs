//! Which precision a link carries: coarser when tiles keep waiting for it, finer when it would
//! carry more. Pure; `now` is an argument.

use std::time::Duration;

use carom_protocol::{Precision, PrecisionRange};

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
    precision: Precision,
    changed: Duration,
    /// Since when it has been counted.
    since: Duration,
    offered_bytes: usize,
    /// The least time that tiles have waited since then, and the rate.
    least: Option<(f64, f64)>,
}

impl Governor {
    pub(super) const fn new() -> Self {
        Self {
            precision: Precision::Exact,
            changed: Duration::ZERO,
            since: Duration::ZERO,
            offered_bytes: 0,
            least: None,
        }
    }

    /// The precision for the next tiles.
    pub(super) fn precision(&mut self, range: PrecisionRange) -> Precision {
        self.precision = range.nearest(self.precision);
        self.precision
    }

    /// Tiles have been encoded.
    pub(super) fn offer(&mut self, bytes: usize) {
        self.offered_bytes += bytes;
    }

    /// The transport has looked at its path.
    pub(super) fn measure(&mut self, now: Duration, link: LinkMeasure) {
        let wait = link.waiting_bytes as f64 / link.bytes_per_sec.max(1.0);
        let least = self.least.map_or(f64::INFINITY, |(wait, _)| wait);
        self.least = Some((wait.min(least), link.bytes_per_sec));
        let secs = now.saturating_sub(self.since).as_secs_f64();
        if secs < COUNTED_SECS {
            return;
        }
        let (least_wait, bytes_per_sec) = self.least.take().unwrap_or((wait, link.bytes_per_sec));
        let state = LinkState {
            bytes_per_sec,
            offered_bytes_per_sec: self.offered_bytes as f64 / secs,
            standing_wait_secs: least_wait,
            unchanged_secs: now.saturating_sub(self.changed).as_secs_f64(),
        };
        (self.since, self.offered_bytes) = (now, 0);
        let next = choose(self.precision, &state);
        if next != self.precision {
            (self.precision, self.changed) = (next, now);
        }
    }
}

/// What [`choose`] goes by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LinkState {
    /// What the link carries.
    pub(super) bytes_per_sec: f64,
    /// What is asked of it, at the present precision.
    pub(super) offered_bytes_per_sec: f64,
    /// The least time that tiles have waited for it lately: bursts come and go, a queue stays.
    pub(super) standing_wait_secs: f64,
    /// Since the last change.
    pub(super) unchanged_secs: f64,
}

/// The precision that a link should have next, given that of now. Tiles that keep waiting take it
/// at once to the finest stop of which the link carries [`COARSER_LOAD`]; a link that would carry
/// the next finer stop with room to spare gets it after [`FINER_AFTER_SECS`], so that the two do
/// not chase each other.
pub(super) fn choose(now: Precision, link: &LinkState) -> Precision {
    let offered = |precision| link.offered_bytes_per_sec * weight(precision) / weight(now);
    if link.standing_wait_secs > STANDING_WAIT_SECS {
        let coarser = Precision::ALL.into_iter().filter(|stop| *stop > now);
        let fits = |stop: &Precision| offered(*stop) <= COARSER_LOAD * link.bytes_per_sec;
        let coarsest = Precision::Lossy50;
        return coarser.clone().find(fits).unwrap_or(coarsest);
    }
    match now.finer() {
        Some(finer)
            if link.unchanged_secs >= FINER_AFTER_SECS
                && link.standing_wait_secs < 0.5 * STANDING_WAIT_SECS
                && offered(finer) <= FINER_LOAD * link.bytes_per_sec =>
        {
            finer
        }
        _ => now,
    }
}

/// Bytes of a converged frame of each precision over those of an exact one, as `carom-farm bench
/// codec` has them.
const fn weight(precision: Precision) -> f64 {
    match precision {
        Precision::Exact => 1.0,
        Precision::Within1 => 0.74,
        Precision::Within2 => 0.65,
        Precision::Lossy90 => 0.18,
        Precision::Lossy75 => 0.07,
        Precision::Lossy50 => 0.036,
    }
}

/// Six frames: shorter ones may hold a burst and no pause.
const COUNTED_SECS: f64 = 0.1;
/// A frame and a half is too long, and what a window of 46 ms holds is not yet a queue.
const STANDING_WAIT_SECS: f64 = 0.008;
const COARSER_LOAD: f64 = 0.8;
const FINER_LOAD: f64 = 0.6;
const FINER_AFTER_SECS: f64 = 1.0;

#[cfg(test)]
mod tests {
    use super::*;

    fn link(megabits: f64, offered: f64, wait_ms: f64, unchanged_secs: f64) -> LinkState {
        LinkState {
            bytes_per_sec: megabits * 125e3,
            offered_bytes_per_sec: offered * 125e3,
            standing_wait_secs: wait_ms * 1e-3,
            unchanged_secs,
        }
    }

    #[test]
    fn a_link_that_is_too_slow_gets_what_it_carries_at_once() {
        let next = |megabits| choose(Precision::Within1, &link(megabits, 383.0, 20.0, 0.1));
        assert_eq!(next(450.0), Precision::Within2);
        assert_eq!(next(130.0), Precision::Lossy90);
        assert_eq!(next(50.0), Precision::Lossy75);
        assert_eq!(next(5.0), Precision::Lossy50);
    }

    #[test]
    fn a_burst_or_a_link_that_keeps_up_changes_nothing() {
        for precision in Precision::ALL {
            assert_eq!(choose(precision, &link(100.0, 90.0, 1.0, 9.0)), precision);
        }
    }

    #[test]
    fn it_gets_finer_by_stops_with_room_to_spare_and_not_at_once() {
        let next = |offered, secs| choose(Precision::Lossy75, &link(400.0, offered, 0.0, secs));
        assert_eq!(next(36.0, 1.0), Precision::Lossy90);
        assert_eq!(next(36.0, 0.5), Precision::Lossy75);
        assert_eq!(next(150.0, 1.0), Precision::Lossy75);
    }

    /// The link carries so much; what does not fit waits. No chase between two stops.
    #[test]
    fn it_settles() {
        for megabits in [3.0, 25.0, 50.0, 100.0, 250.0, 400.0, 1000.0] {
            let mut governor = Governor::new();
            let (mut waiting, mut changes, mut before) = (0.0, 0, Precision::Exact);
            let range = PrecisionRange {
                finest: Precision::Exact,
                coarsest: Precision::Lossy50,
            };
            for frame in 0..1200 {
                let precision = governor.precision(range);
                if frame >= 600 {
                    changes += u32::from(precision != before);
                }
                before = precision;
                let bytes = 515e6 / 8.0 / 60.0 * weight(precision);
                governor.offer(bytes as usize);
                waiting = f64::max(waiting + bytes - megabits * 125e3 / 60.0, 0.0);
                let link = LinkMeasure {
                    bytes_per_sec: megabits * 125e3,
                    waiting_bytes: waiting as usize,
                };
                governor.measure(Duration::from_secs_f64(f64::from(frame) / 60.0), link);
            }
            assert!(changes <= 2, "{changes} changes at {megabits} Mbit/s");
            let settled = 515.0 * weight(before);
            assert!(
                settled <= megabits.max(19.0),
                "{before} at {megabits} Mbit/s"
            );
        }
    }
}
