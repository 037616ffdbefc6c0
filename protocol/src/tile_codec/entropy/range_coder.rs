//! Adaptive binary range coder.
//!
//! Range coding: Martin, "Range encoding: an algorithm for removing redundancy from a digitised
//! message" (1979), with the probabilities of a binary arithmetic coder such as CABAC (ITU-T H.264,
//! 9.3) that adapt to the bits that were coded. Encoder and decoder are one trait, [`Coder`], so
//! that a syntax is written once for both.

use std::hint::select_unpredictable;

/// One end of a bit stream.
pub(crate) trait Coder {
    /// Codes one bit: an encoder writes `bit`, a decoder ignores it. Returns the bit; the model adapts.
    fn bit(&mut self, model: &mut BitModel, bit: bool) -> bool;

    /// Codes up to 8 bits of equal probability at once, without a model.
    fn raw(&mut self, count: u32, bits: u32) -> u32;
}

/// Adaptive probability of a bit in one context: an average over all bits at first, later an exponential one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BitModel {
    /// Probability of 0, in units of 2⁻¹⁶.
    zero: u16,
    /// Number of bits seen, at most [`SEEN_MAX`].
    seen: u16,
}

impl BitModel {
    /// 0 and 1 equally likely.
    pub(crate) const NEW: Self = Self {
        zero: 1 << 15,
        seen: 0,
    };

    #[inline(always)]
    fn learn(&mut self, bit: bool) {
        let target = select_unpredictable(bit, PROBABILITY_MIN, (1 << 16) - PROBABILITY_MIN);
        let error = target - i32::from(self.zero);
        // Integers alone: encoder and decoder must agree to the last bit on every machine. The shift rounds
        // towards −∞, and the targets lie strictly between 0 and 2¹⁶, so no probability ever becomes 0.
        self.zero = (i32::from(self.zero) + ((error * RATES[usize::from(self.seen)]) >> 16)) as u16;
        self.seen = (self.seen + 1).min(SEEN_MAX);
    }
}

/// Encoder of a message, which is a binary fraction from 0 to below 1.
#[derive(Debug)]
pub(crate) struct RangeEncoder {
    /// The last 64 bits of the fraction so far, not yet written.
    low: u64,
    /// Width of the interval above `low`, which each bit divides in proportion to the probabilities.
    range: u64,
    bytes: Vec<u8>,
}

impl RangeEncoder {
    /// An encoder that appends to `bytes`.
    pub(crate) fn new(bytes: Vec<u8>) -> Self {
        let (low, range) = (0, u64::MAX);
        Self { low, range, bytes }
    }

    /// The bytes from before and the message, as short as possible: `low` is rounded up to a multiple of the
    /// largest power of two not above `range`, whose trailing zero bytes are not written.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        // A power of two not above the width of an interval has a multiple in it.
        let zeros = (1 << self.range.ilog2()) - 1;
        // −low modulo the power of two is the distance to its next multiple.
        self.add(self.low.wrapping_neg() & zeros);
        let last = &self.low.to_be_bytes()[..last_bytes(self.range)];
        self.bytes.extend_from_slice(last);
        self.bytes
    }

    #[inline(always)]
    fn add(&mut self, part: u64) {
        let (low, carries) = self.low.overflowing_add(part);
        self.low = low;
        if carries {
            self.carry();
        }
    }

    /// Propagates a carry into bytes already written. It never passes the first byte of the message, since
    /// the fraction is below 1.
    fn carry(&mut self) {
        for byte in self.bytes.iter_mut().rev() {
            *byte = byte.wrapping_add(1);
            if *byte != 0 {
                break;
            }
        }
    }

    #[inline(always)]
    fn shift(&mut self) {
        if self.range < RANGE_MIN {
            let word = (self.low >> 32) as u32;
            self.bytes.extend_from_slice(&word.to_be_bytes());
            // One shift is enough: a bit leaves at least 32 / 2¹⁶ of a range of 2³² or more, eight raw bits
            // 1/256.
            self.low <<= 32;
            self.range <<= 32;
        }
    }
}

impl Coder for RangeEncoder {
    #[inline(always)]
    fn bit(&mut self, model: &mut BitModel, bit: bool) -> bool {
        // `shift` keeps the range at 2³² or more, so that 16 or more bits of it are divided and neither part
        // is empty.
        let zeros = (self.range >> 16) * u64::from(model.zero);
        if bit {
            self.add(zeros);
            self.range -= zeros;
        } else {
            self.range = zeros;
        }
        model.learn(bit);
        self.shift();
        bit
    }

    #[inline(always)]
    fn raw(&mut self, count: u32, bits: u32) -> u32 {
        self.range >>= count;
        self.add(self.range * u64::from(bits));
        self.shift();
        bits
    }
}

/// Decoder of a message, which is followed by zeros without end.
#[derive(Debug)]
pub(crate) struct RangeDecoder<'a> {
    /// Offset of the message's fraction above the interval's lower end, on the scale of `range`.
    code: u64,
    range: u64,
    rest: &'a [u8],
    /// Number of bytes read after the end.
    lacking: usize,
}

impl<'a> RangeDecoder<'a> {
    pub(crate) fn new(message: &'a [u8]) -> Self {
        let mut decoder = Self {
            code: 0,
            range: u64::MAX,
            rest: message,
            lacking: 0,
        };
        decoder.read();
        decoder.read();
        decoder
    }

    /// Whether the message ends where its encoder would have ended it.
    pub(crate) fn is_at_end(&self) -> bool {
        self.lacking == 8 - last_bytes(self.range)
    }

    #[inline(always)]
    fn read(&mut self) {
        let word = match self.rest.split_first_chunk() {
            Some((word, rest)) => {
                self.rest = rest;
                *word
            }
            None => self.read_end(),
        };
        self.code = self.code << 32 | u64::from(u32::from_be_bytes(word));
    }

    #[cold]
    fn read_end(&mut self) -> [u8; 4] {
        let mut word = [0; 4];
        word[..self.rest.len()].copy_from_slice(self.rest);
        self.lacking += word.len() - self.rest.len();
        self.rest = &[];
        word
    }

    #[inline(always)]
    fn shift(&mut self) {
        if self.range < RANGE_MIN {
            self.range <<= 32;
            self.read();
        }
    }
}

impl Coder for RangeDecoder<'_> {
    #[inline(always)]
    fn bit(&mut self, model: &mut BitModel, _: bool) -> bool {
        let zeros = (self.range >> 16) * u64::from(model.zero);
        let bit = self.code >= zeros;
        // Selection without branches: mispredicted ones on noise made decoding a sixth slower.
        self.code -= select_unpredictable(bit, zeros, 0);
        self.range = select_unpredictable(bit, self.range - zeros, zeros);
        model.learn(bit);
        self.shift();
        bit
    }

    #[inline(always)]
    fn raw(&mut self, count: u32, _: u32) -> u32 {
        self.range >>= count;
        // Above the maximum only for bytes that no encoder wrote.
        let bits = (self.code / self.range).min((1 << count) - 1);
        self.code -= bits * self.range;
        self.shift();
        bits as u32
    }
}

/// Number of leading bytes of `low` that must be written at the end: the interval contains a multiple of the
/// largest power of two not above `range`, and the decoder reads zeros after it.
fn last_bytes(range: u64) -> usize {
    (64 - range.ilog2()).div_ceil(8) as usize
}

/// Below this width the next 32 bits are shifted in, so that a 16-bit probability has at least 16 bits of it
/// to divide.
const RANGE_MIN: u64 = 1 << 32;
/// Minimum probability of either value, in units of 2⁻¹⁶: 1 / 2048.
const PROBABILITY_MIN: i32 = 32;
/// Number of bits after which their weight stays constant. Twice as many made tiles 1 % larger.
const SEEN_MAX: u16 = 30;
/// Weight of the next bit after n bits, in units of 2⁻¹⁶: 1 / (n + 2.5), which makes the probability the mean
/// of the bits and of a prior of ½ that weighs as much as 1.5 bits.
const RATES: [i32; SEEN_MAX as usize + 1] = {
    let mut rates = [0; SEEN_MAX as usize + 1];
    let mut seen = 0;
    while seen < rates.len() {
        rates[seen] = (1 << 17) / (2 * seen as i32 + 5);
        seen += 1;
    }
    rates
};

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Symbol to code: a model's index and a bit, or a number of raw bits.
    #[derive(Clone, Copy, Debug)]
    enum Step {
        Bit(usize, bool),
        Raw(u32, u32),
    }

    fn code(coder: &mut impl Coder, steps: &[Step]) -> Vec<Step> {
        let mut models = [BitModel::NEW; 4];
        let code = |step: &Step| match *step {
            Step::Bit(model, bit) => Step::Bit(model, coder.bit(&mut models[model], bit)),
            Step::Raw(count, bits) => Step::Raw(count, coder.raw(count, bits)),
        };
        steps.iter().map(code).collect()
    }

    fn unknown(step: &Step) -> Step {
        match *step {
            Step::Bit(model, _) => Step::Bit(model, false),
            Step::Raw(count, _) => Step::Raw(count, 0),
        }
    }

    fn same(a: &[Step], b: &[Step]) -> bool {
        format!("{a:?}") == format!("{b:?}")
    }

    fn steps() -> impl Strategy<Value = Vec<Step>> {
        // The first model's bits are nearly always 1 and the second's 0: both ends of the probability range.
        let bit = (0..4usize, any::<u8>()).prop_map(|(model, random)| {
            let bit = match model {
                0 => random != 0,
                1 => random == 0,
                _ => random & 1 != 0,
            };
            Step::Bit(model, bit)
        });
        let raw = (1..=8u32, any::<u32>())
            .prop_map(|(count, random)| Step::Raw(count, random & ((1 << count) - 1)));
        prop::collection::vec(prop_oneof![4 => bit, 1 => raw], 0..2000)
    }

    proptest! {
        #[test]
        fn decoding_inverts_encoding_and_finds_the_end(steps in steps()) {
            let mut encoder = RangeEncoder::new(vec![7]);
            code(&mut encoder, &steps);
            let message = encoder.finish();
            prop_assert_eq!(message[0], 7);
            let message = &message[1..];
            let asked: Vec<Step> = steps.iter().map(unknown).collect();
            let mut decoder = RangeDecoder::new(message);
            prop_assert!(same(&code(&mut decoder, &asked), &steps));
            prop_assert!(decoder.is_at_end());
            for other in [&message[..message.len() - 1], &[message, &[0]].concat()] {
                let mut decoder = RangeDecoder::new(other);
                let read = code(&mut decoder, &asked);
                prop_assert!(!decoder.is_at_end() || !same(&read, &steps));
            }
        }

        #[test]
        fn decoding_any_bytes_does_not_panic(bytes: Vec<u8>, steps in steps()) {
            code(&mut RangeDecoder::new(&bytes), &steps);
        }
    }

    #[test]
    fn carries_propagate_through_all_bytes() {
        let steps = vec![Step::Raw(8, 255); 40];
        let mut encoder = RangeEncoder::new(Vec::new());
        code(&mut encoder, &steps);
        encoder.bit(&mut BitModel::NEW.clone(), true);
        let message = encoder.finish();
        let mut decoder = RangeDecoder::new(&message);
        assert!(same(
            &code(&mut decoder, &vec![Step::Raw(8, 0); 40]),
            &steps
        ));
        assert!(decoder.bit(&mut BitModel::NEW.clone(), false));
    }

    #[test]
    fn likely_bits_cost_little() {
        let mut encoder = RangeEncoder::new(Vec::new());
        let mut model = BitModel::NEW;
        for index in 0..8000 {
            encoder.bit(&mut model, index % 20 == 0);
        }
        // A bit of probability 1/20 has 0.286 bits of entropy; one in a regular sequence has none.
        let bytes = encoder.finish().len();
        assert!(bytes < 8000 * 35 / 100 / 8, "{bytes}");
    }
}
