//! Adaptive model of values that are mostly near a prediction.

use std::hint::select_unpredictable;

use super::range_coder::{BitModel, Coder};

/// Adaptive model of differences near 0, in the manner of an Exp-Golomb code: whether it is 0, the position
/// of the magnitude's top bit in unary, the bits below it, and the sign.
///
/// Only the position, the sign and the bit right below the top one are modelled; lower bits are nearly
/// equiprobable and are coded raw.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ValueModel {
    is_nonzero: BitModel,
    longer: [BitModel; 7],
    second: [BitModel; 5],
    negative: [BitModel; 3],
}

impl ValueModel {
    /// A model that has seen no value.
    pub(crate) const NEW: Self = Self {
        is_nonzero: BitModel::NEW,
        longer: [BitModel::NEW; 7],
        second: [BitModel::NEW; 5],
        negative: [BitModel::NEW; 3],
    };

    /// Codes `wanted`, which a decoder ignores, as a difference from the prediction `expected`.
    /// Returns the value and the difference. `lean` (0 to 2) selects the model of the sign.
    #[inline(always)]
    pub(crate) fn code<C: Coder>(
        &mut self,
        coder: &mut C,
        lean: usize,
        expected: u8,
        wanted: u8,
    ) -> (u8, i16) {
        let difference = i16::from(wanted) - i16::from(expected);
        if !coder.bit(&mut self.is_nonzero, difference != 0) {
            return (expected, 0);
        }
        let size = self.magnitude(coder, u32::from(difference.unsigned_abs()));
        let is_negative = coder.bit(&mut self.negative[lean], difference < 0);
        // The sign of noise is unpredictable for the branch predictor as well.
        let difference = select_unpredictable(is_negative, -size, size);
        // Truncation to 8 bits leaves the sum modulo 256 exact; a sum out of range, from hostile bytes,
        // wraps.
        (expected.wrapping_add_signed(difference as i8), difference)
    }

    /// Codes a magnitude of 1 to 255, and returns it.
    #[inline(always)]
    fn magnitude<C: Coder>(&mut self, coder: &mut C, wanted: u32) -> i16 {
        let below_top = wanted.checked_ilog2().unwrap_or(0);
        let mut length = 0;
        // A magnitude of at most 255 has its top bit at 7 or below, so a seventh 1 needs no terminating 0.
        while length < 7 && coder.bit(&mut self.longer[length as usize], length < below_top) {
            length += 1;
        }
        let mut size = 1;
        if length > 0 {
            let rest = length - 1;
            let model = &mut self.second[rest.min(4) as usize];
            size = 2 | u32::from(coder.bit(model, wanted >> rest & 1 != 0));
            if rest > 0 {
                size = size << rest | coder.raw(rest, wanted & ((1 << rest) - 1));
            }
        }
        size as i16
    }
}
