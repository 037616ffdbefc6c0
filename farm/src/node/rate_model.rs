//! Model of the bytes that tiles take at each precision: a prior from measured pictures, corrected by the
//! actual messages.
//!
//! Delta-coded exact tiles cost as much as has changed in them, JPEG tiles nearly as much as without a
//! reference: while a few balls roll under a still camera, JPEG 90 may cost more than exact pixels. Which
//! precisions save bytes is therefore learned in use.

use carom_protocol::PixelPrecision;
use carom_protocol::tile_codec::DeltaStats;

/// Rates of the precisions, by index. A rate is relative to the bytes of an exact picture coded without
/// references.
#[derive(Clone, Debug, Default)]
pub(super) struct RateModel {
    /// Share of the pixels that change from frame to frame; `None` before the first message.
    changing: Option<f64>,
    history: [RateHistory; PRECISIONS],
}

/// Actual and expected bytes of one precision's messages, exponentially decayed.
#[derive(Clone, Copy, Debug, Default)]
struct RateHistory {
    messages: f64,
    bytes: f64,
    expected_bytes: f64,
}

/// An encoded message of tiles.
#[derive(Clone, Copy, Debug)]
pub(super) struct EncodedSample {
    pub(super) precision: PixelPrecision,
    pub(super) pixels: usize,
    pub(super) delta: DeltaStats,
    pub(super) bytes: usize,
}

/// Mixture of two precisions, by index.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Blend {
    pub(super) finer: usize,
    pub(super) coarser: usize,
    /// Share of messages that get the coarser one.
    pub(super) share: f64,
}

impl RateModel {
    /// Updates the model with an encoded message.
    pub(super) fn update(&mut self, message: EncodedSample) {
        let (index, delta) = (message.precision as usize, message.delta);
        if delta.referenced > 0 {
            let share = delta.changed as f64 / delta.referenced as f64;
            // Converted to changes of exact pixels, so that one number serves all precisions.
            let changing = (share * CHANGE_MASKING[index]).min(1.0);
            let before = self.changing.unwrap_or(changing);
            self.changing = Some(before + (changing - before) / CHANGING_MESSAGES);
        }
        for history in &mut self.history {
            let decay = 1.0 - 1.0 / HISTORY_MESSAGES;
            history.messages *= decay;
            history.bytes *= decay;
            history.expected_bytes *= decay;
        }
        let history = &mut self.history[index];
        history.messages += 1.0;
        history.bytes += message.bytes as f64;
        let inter = message.pixels.saturating_sub(delta.intra) as f64;
        let inter = inter * prior(index, self.changing.unwrap_or(1.0));
        let intra = INTRA_RATE[index] * delta.intra as f64;
        // By the prior alone, not by the corrected model: the ratio of actual to expected is the
        // correction, and must not feed back into itself.
        history.expected_bytes += EXACT_BYTES_PER_PIXEL * (inter + intra);
    }

    /// The rate at a level, a position between the precisions' indices.
    pub(super) fn rate(&self, level: f64) -> f64 {
        let rates = self.rates();
        let Blend {
            finer,
            coarser,
            share,
        } = blend(&rates, level);
        rates[finer] + share * (rates[coarser] - rates[finer])
    }

    /// The finest level with at most this rate; the coarsest if none has.
    pub(super) fn level_of(&self, rate: f64) -> f64 {
        let rates = self.rates();
        let mut before: Option<usize> = None;
        for index in useful(&rates) {
            if rates[index] <= rate {
                return before.map_or(0.0, |finer| {
                    // Linear interpolation between the two precisions that enclose the rate.
                    let share = (rates[finer] - rate) / (rates[finer] - rates[index]);
                    finer as f64 + share * (index - finer) as f64
                });
            }
            before = Some(index);
        }
        (PRECISIONS - 1) as f64
    }

    /// The precisions to use at a level.
    pub(super) fn blend(&self, level: f64) -> Blend {
        blend(&self.rates(), level)
    }

    fn rates(&self) -> [f64; PRECISIONS] {
        let changing = self.changing.unwrap_or(1.0);
        std::array::from_fn(|index| prior(index, changing) * self.model_error(index))
    }

    /// Actual over expected bytes: the geometric mean over all precisions, weighted by messages and by
    /// proximity, so that an unused precision is corrected by its neighbours.
    fn model_error(&self, index: usize) -> f64 {
        let (mut sum, mut weights) = (0.0, 0.0);
        for (other, history) in self.history.iter().enumerate() {
            let weight = history.messages * NEIGHBOUR_WEIGHT[index.abs_diff(other)];
            // Plus one byte on both sides: a precision without messages must not divide by zero.
            let ratio = (history.bytes + 1.0) / (history.expected_bytes + 1.0);
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

/// Prior rate where the share `changing` of the pixels has changed.
fn prior(index: usize, changing: f64) -> f64 {
    INTRA_RATE[index]
        .min(DELTA_RATE[index] * changing)
        .max(RATE_MIN)
}

/// The precisions that save bytes over every finer one.
fn useful(rates: &[f64; PRECISIONS]) -> impl Iterator<Item = usize> + '_ {
    // Scanned from fine to coarse: a coarser precision that saves nothing over a finer one is dominated.
    let mut least = f64::INFINITY;
    (0..PRECISIONS).filter(move |index| {
        let saves = rates[*index] < USEFUL_BELOW * least;
        if saves {
            least = rates[*index];
        }
        saves
    })
}

fn blend(rates: &[f64; PRECISIONS], level: f64) -> Blend {
    let (mut finer, mut next) = (0, None);
    for index in useful(rates) {
        if index as f64 <= level {
            finer = index;
        } else if next.is_none() {
            next = Some(index);
        }
    }
    let coarser = next.unwrap_or(finer);
    let share = (level - finer as f64) / (coarser - finer).max(1) as f64;
    Blend {
        finer,
        coarser,
        share: share.min(1.0),
    }
}

const PRECISIONS: usize = PixelPrecision::ALL.len();
/// Rate of a converged frame coded without references, measured by `bench codec`.
const INTRA_RATE: [f64; PRECISIONS] = [1.0, 0.74, 0.65, 0.18, 0.07, 0.036];
/// Rate per share of changed pixels where few have changed: with 10 % changed in a few places, JPEG takes
/// as much as for all.
const DELTA_RATE: [f64; PRECISIONS] = [2.8, 1.6, 1.25, 1.8, 0.7, 0.36];
/// Minimum rate: the header of a message.
const RATE_MIN: f64 = 0.005;
/// Bytes per pixel of the exact frame that rates are relative to.
const EXACT_BYTES_PER_PIXEL: f64 = 0.37;
/// Changed pixels per pixel seen to have changed at this precision: quantisation masks small changes. JPEG
/// compares exact pixels.
const CHANGE_MASKING: [f64; PRECISIONS] = [1.0, 1.6, 2.0, 1.0, 1.0, 1.0];
/// Averaging length of `changing` in messages: four frames of 16.
const CHANGING_MESSAGES: f64 = 64.0;
/// Averaging length of the correction in messages. Longer than [`CHANGING_MESSAGES`], as the
/// compressibility of pictures changes more slowly than the motion in them.
const HISTORY_MESSAGES: f64 = 1024.0;
/// Weight of a message for its own precision, the next one and those beyond. After a few thousand messages
/// without use, a precision is judged by its neighbours.
const NEIGHBOUR_WEIGHT: [f64; PRECISIONS] = [1.0, 0.02, 0.005, 0.00125, 0.0003, 0.0001];
/// Rate below which, relative to the finer ones, a precision is worth using: it must save a twentieth.
const USEFUL_BELOW: f64 = 0.95;

#[cfg(test)]
mod tests {
    use super::*;

    fn train(
        model: &mut RateModel,
        messages: u32,
        precision: PixelPrecision,
        changing: f64,
        bytes: usize,
    ) {
        for _ in 0..messages {
            model.update(EncodedSample {
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
    fn level_of_is_the_inverse_of_rate() {
        let mut model = RateModel::default();
        train(&mut model, 64, PixelPrecision::Exact, 1.0, 3000);
        for level in 0..=50 {
            let level = f64::from(level) / 10.0;
            let back = model.level_of(model.rate(level));
            assert!((back - level).abs() < 1e-9, "{level} {back}");
        }
        assert_eq!((model.level_of(2.0), model.level_of(0.0)), (0.0, 5.0));
    }

    #[test]
    fn unused_precisions_follow_their_neighbours() {
        let (mut model, prior) = (RateModel::default(), RateModel::default());
        train(&mut model, 200, PixelPrecision::Within2, 1.0, 4000);
        let rates = model.rates();
        let factor = 4000.0 / 8192.0 / EXACT_BYTES_PER_PIXEL / INTRA_RATE[2];
        for (now, before) in rates.iter().zip(prior.rates()) {
            assert!((now / before / factor - 1.0).abs() < 0.01, "{rates:?}");
        }
        // Each follows its nearest neighbour.
        train(&mut model, 200, PixelPrecision::Lossy75, 1.0, 100);
        let [now, before] = [model.rates(), rates];
        assert!((now[0] / before[0] - 1.0).abs() < 0.1, "{now:?}");
        assert!(now[5] < 0.3 * before[5], "{now:?}");
    }

    #[test]
    fn precisions_that_save_nothing_are_skipped() {
        let mut model = RateModel::default();
        let samples = [
            (PixelPrecision::Exact, 640),
            (PixelPrecision::Within2, 270),
            (PixelPrecision::Lossy90, 540),
        ];
        for (precision, bytes) in samples {
            train(
                &mut model,
                64,
                precision,
                0.05 / CHANGE_MASKING[precision as usize],
                bytes,
            );
        }
        train(&mut model, 64, PixelPrecision::Lossy75, 0.05, 240);
        let middle = Blend {
            finer: 2,
            coarser: 4,
            share: 0.5,
        };
        assert_eq!(model.blend(3.0), middle);
        let levels = (0..=50).map(|level| model.rate(f64::from(level) / 10.0));
        assert!(levels.is_sorted_by(|finer, coarser| finer >= coarser));
    }

    #[test]
    fn old_messages_lose_their_weight() {
        let mut model = RateModel::default();
        train(&mut model, 500, PixelPrecision::Lossy90, 1.0, 4000);
        let before = model.rates()[3];
        train(&mut model, 8000, PixelPrecision::Exact, 1.0, 3000);
        let now = model.rates()[3];
        assert!(now < 0.5 * before, "{before} {now}");
    }
}
