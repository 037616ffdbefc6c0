//! What tiles weigh at each precision: what is known of pictures beforehand, and by how much it was
//! wrong of late.
//!
//! Told from the frame before, exact tiles weigh what has changed in them, JPEG tiles nearly what they
//! weigh whole: with a few balls that roll under a still camera JPEG 90 may weigh more than exact
//! pixels. So which stops are worth anything is found as they are used.

use carom_protocol::PixelPrecision;
use carom_protocol::tile_codec::DeltaStats;

/// What tiles weigh at each stop.
#[derive(Clone, Debug)]
pub(super) struct Weights {
    /// Share of the pixels that are not as they were before; `None` before any have been seen.
    changing: Option<f64>,
    seen: [Seen; STOPS],
}

/// What tiles weighed at a stop and what was expected, the older the less.
#[derive(Clone, Copy, Debug)]
struct Seen {
    messages: f64,
    bytes: f64,
    expected_bytes: f64,
}

/// A message of tiles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weighed {
    pub(super) precision: PixelPrecision,
    pub(super) pixels: usize,
    pub(super) delta: DeltaStats,
    pub(super) bytes: usize,
}

/// Two stops, and the share of messages that get the coarser.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Between {
    pub(super) finer: usize,
    pub(super) coarser: usize,
    pub(super) share: f64,
}

impl Weights {
    pub(super) const fn new() -> Self {
        let nothing = Seen {
            messages: 0.0,
            bytes: 0.0,
            expected_bytes: 0.0,
        };
        Self {
            changing: None,
            seen: [nothing; STOPS],
        }
    }

    /// Takes note of a message.
    pub(super) fn learn(&mut self, message: Weighed) {
        let (stop, delta) = (message.precision as usize, message.delta);
        if delta.referenced > 0 {
            let share = delta.changed as f64 / delta.referenced as f64;
            let changing = (share * HIDDEN[stop]).min(1.0);
            let before = self.changing.unwrap_or(changing);
            self.changing = Some(before + (changing - before) / CHANGING_MESSAGES);
        }
        for seen in &mut self.seen {
            let kept = 1.0 - 1.0 / SEEN_MESSAGES;
            seen.messages *= kept;
            seen.bytes *= kept;
            seen.expected_bytes *= kept;
        }
        let seen = &mut self.seen[stop];
        seen.messages += 1.0;
        seen.bytes += message.bytes as f64;
        let told = message.pixels.saturating_sub(delta.intra) as f64;
        let told = told * expected(stop, self.changing.unwrap_or(1.0));
        seen.expected_bytes += EXACT_BYTES * (told + WHOLE[stop] * delta.intra as f64);
    }

    /// Bytes at a place among the stops over those of an exact picture without a reference.
    pub(super) fn weight(&self, level: f64) -> f64 {
        let weights = self.all();
        let Between {
            finer,
            coarser,
            share,
        } = between(&weights, level);
        weights[finer] + share * (weights[coarser] - weights[finer])
    }

    /// The finest place with at most this weight; the coarsest, if none has.
    pub(super) fn level_of(&self, weight: f64) -> f64 {
        let weights = self.all();
        let mut before: Option<usize> = None;
        for stop in useful(&weights) {
            if weights[stop] <= weight {
                return before.map_or(0.0, |finer| {
                    let (heavy, light) = (weights[finer], weights[stop]);
                    let share = (heavy - weight) / (heavy - light);
                    finer as f64 + share * (stop - finer) as f64
                });
            }
            before = Some(stop);
        }
        (STOPS - 1) as f64
    }

    /// The stops to use at a place.
    pub(super) fn between(&self, level: f64) -> Between {
        between(&self.all(), level)
    }

    fn all(&self) -> [f64; STOPS] {
        let changing = self.changing.unwrap_or(1.0);
        std::array::from_fn(|stop| expected(stop, changing) * self.wrong_by(stop))
    }

    /// The factor by which bytes were other than expected: the stop's own, and its neighbours' the more
    /// the less it has been used.
    fn wrong_by(&self, stop: usize) -> f64 {
        let (mut sum, mut weights) = (0.0, 0.0);
        for (other, seen) in self.seen.iter().enumerate() {
            let weight = seen.messages * SAYS[stop.abs_diff(other)];
            // A message has a header.
            let ratio = (seen.bytes + 1.0) / (seen.expected_bytes + 1.0);
            sum += weight * ratio.ln();
            weights += weight;
        }
        if weights > 0.0 {
            (sum / weights).exp()
        } else {
            1.0
        }
    }
}

/// What is expected of a stop where this share of the pixels has changed.
fn expected(stop: usize, changing: f64) -> f64 {
    WHOLE[stop].min(CHANGED[stop] * changing).max(UNCHANGED)
}

/// The stops that take less than each finer one.
fn useful(weights: &[f64; STOPS]) -> impl Iterator<Item = usize> + '_ {
    let mut least = f64::INFINITY;
    (0..STOPS).filter(move |stop| {
        let is_lighter = weights[*stop] < LIGHTER * least;
        if is_lighter {
            least = weights[*stop];
        }
        is_lighter
    })
}

fn between(weights: &[f64; STOPS], level: f64) -> Between {
    let (mut finer, mut next) = (0, None);
    for stop in useful(weights) {
        if stop as f64 <= level {
            finer = stop;
        } else if next.is_none() {
            next = Some(stop);
        }
    }
    let coarser = next.unwrap_or(finer);
    let share = (level - finer as f64) / (coarser - finer).max(1) as f64;
    Between {
        finer,
        coarser,
        share: share.min(1.0),
    }
}

const STOPS: usize = PixelPrecision::ALL.len();
/// Bytes of a converged frame of each precision over those of an exact one, as `carom-bench
/// codec` has them ...
const WHOLE: [f64; STOPS] = [1.0, 0.74, 0.65, 0.18, 0.07, 0.036];
/// ... and, where not all pixels have changed, for each that has: of 10 %, that lie in a few places,
/// JPEG takes as much as of all.
const CHANGED: [f64; STOPS] = [2.8, 1.6, 1.25, 1.8, 0.7, 0.36];
/// A message's header and a bit.
const UNCHANGED: f64 = 0.005;
/// Bytes a pixel of that exact frame.
const EXACT_BYTES: f64 = 0.37;
/// Of pixels that have changed, for each that has at this precision. JPEG is given exact pixels.
const HIDDEN: [f64; STOPS] = [1.0, 1.6, 2.0, 1.0, 1.0, 1.0];
/// Four frames of 16 messages.
const CHANGING_MESSAGES: f64 = 64.0;
/// How pictures compress changes more slowly than what moves in them.
const SEEN_MESSAGES: f64 = 1024.0;
/// What a message says of its stop, of the next one and of those beyond: once a stop has not been used for
/// a few thousand messages, it is what its neighbours weigh that counts.
const SAYS: [f64; STOPS] = [1.0, 0.02, 0.005, 0.00125, 0.0003, 0.0001];
/// A stop that takes hardly less than a finer one is worth nothing.
const LIGHTER: f64 = 0.95;

#[cfg(test)]
mod tests {
    use super::*;

    fn learn(
        weights: &mut Weights,
        messages: u32,
        precision: PixelPrecision,
        changing: f64,
        bytes: usize,
    ) {
        for _ in 0..messages {
            weights.learn(Weighed {
                precision,
                pixels: 8192,
                delta: DeltaStats {
                    referenced: 8192,
                    changed: (8192.0 * changing) as usize,
                    intra: 0,
                },
                bytes,
            });
        }
    }

    #[test]
    fn levels_and_weights_are_each_other() {
        let mut weights = Weights::new();
        learn(&mut weights, 64, PixelPrecision::Exact, 1.0, 3000);
        for level in 0..=50 {
            let level = f64::from(level) / 10.0;
            let back = weights.level_of(weights.weight(level));
            assert!((back - level).abs() < 1e-9, "{level} {back}");
        }
        assert_eq!((weights.level_of(2.0), weights.level_of(0.0)), (0.0, 5.0));
    }

    #[test]
    fn a_stop_never_tried_is_scaled_by_what_its_neighbours_turned_out_to_weigh() {
        let (mut weights, prior) = (Weights::new(), Weights::new());
        learn(&mut weights, 200, PixelPrecision::Within2, 1.0, 4000);
        let all = weights.all();
        let factor = 4000.0 / 8192.0 / EXACT_BYTES / WHOLE[2];
        for (now, before) in all.iter().zip(prior.all()) {
            assert!((now / before / factor - 1.0).abs() < 0.01, "{all:?}");
        }
        // Each is nearest to what was seen nearest to it.
        learn(&mut weights, 200, PixelPrecision::Lossy75, 1.0, 100);
        let [now, before] = [weights.all(), all];
        assert!((now[0] / before[0] - 1.0).abs() < 0.1, "{now:?}");
        assert!(now[5] < 0.3 * before[5], "{now:?}");
    }

    #[test]
    fn a_stop_that_weighs_more_than_a_finer_one_is_passed_over() {
        let mut weights = Weights::new();
        let seen = [
            (PixelPrecision::Exact, 640),
            (PixelPrecision::Within2, 270),
            (PixelPrecision::Lossy90, 540),
        ];
        for (precision, bytes) in seen {
            learn(
                &mut weights,
                64,
                precision,
                0.05 / HIDDEN[precision as usize],
                bytes,
            );
        }
        learn(&mut weights, 64, PixelPrecision::Lossy75, 0.05, 240);
        let middle = Between {
            finer: 2,
            coarser: 4,
            share: 0.5,
        };
        assert_eq!(weights.between(3.0), middle);
        let levels = (0..=50).map(|level| weights.weight(f64::from(level) / 10.0));
        assert!(levels.is_sorted_by(|finer, coarser| finer >= coarser));
    }

    #[test]
    fn what_was_seen_long_ago_counts_no_more() {
        let mut weights = Weights::new();
        learn(&mut weights, 500, PixelPrecision::Lossy90, 1.0, 4000);
        let before = weights.all()[3];
        learn(&mut weights, 8000, PixelPrecision::Exact, 1.0, 3000);
        let now = weights.all()[3];
        assert!(now < 0.5 * before, "{before} {now}");
    }
}
