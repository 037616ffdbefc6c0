//! Delta masks: a bit for each pixel that differs from the reference, and the contexts that predict it.
//!
//! Changes are clustered: a pixel is more likely to change if those to its left, above it and two rows
//! above have changed.

/// The changed pixels around a group of eight, as bits. In each row, bit 2 is the group's first pixel, so
/// that the two pixels to its left are bits 0 and 1.
#[derive(Clone, Copy)]
pub(crate) struct MaskContext {
    row: u32,
    above: u32,
    above2: u32,
}

impl MaskContext {
    /// Context of the group at byte `at` of a mask whose rows are `stride` bytes long.
    #[inline(always)]
    pub(crate) fn new(mask: &[u8], at: usize, stride: usize) -> Self {
        let rows = &mask[at - 2 * stride..];
        let row = |middle: usize| {
            let [left, here, right] = [middle.wrapping_sub(1), middle, middle + 1]
                .map(|index| rows.get(index).copied().map_or(0, u32::from));
            // The last two pixels of the byte to the left, the group's eight, and the byte to the right, of
            // which contexts read the first pixel.
            left >> 6 | here << 2 | right << 10
        };
        Self {
            // Of the group's own row the decoder knows only what lies to the left.
            row: row(2 * stride) & 3,
            above: row(stride),
            above2: row(0) & 0x3fc,
        }
    }

    /// Context of whether any pixel of the group changes, below 48.
    #[inline(always)]
    pub(crate) fn group_context(self) -> usize {
        let above = u32::from(ONES_MAX3[usize::from((self.above >> 2) as u8)]);
        let here = (self.row & 1) + (self.row >> 1 & 1);
        // Bits 1 and 10: the pixels in the row above that adjoin the group on either side.
        let corners = u32::from(self.above & 0x402 != 0);
        let above2 = u32::from(self.above2 != 0);
        // A number in mixed radix: 4 · 3 · 2 · 2 contexts.
        (((above * 3 + here) * 2 + above2) * 2 + corners) as usize
    }

    /// Context of whether one pixel changes, below 36: its left and upper neighbours, the two diagonal ones
    /// above, and the pixels two to the left and two above.
    #[inline(always)]
    pub(crate) fn pixel_context(self, bit: usize) -> usize {
        let (here, above, above2) = (self.row >> bit, self.above >> bit, self.above2 >> bit);
        let corners = (above >> 1 & 1) + (above >> 3 & 1);
        let far = (here & 1) + (above2 >> 2 & 1);
        // A number in mixed radix: 2 · 2 · 3 · 3 contexts.
        ((here >> 1 & 1) + 2 * (above >> 2 & 1) + 4 * corners + 12 * far) as usize
    }

    /// Number of the left and upper neighbours that have changed, 0 to 2.
    #[inline(always)]
    pub(crate) fn changed_neighbours(self, bit: usize) -> usize {
        ((self.row >> bit >> 1 & 1) + (self.above >> bit >> 2 & 1)) as usize
    }

    /// Marks a pixel as changed.
    #[inline(always)]
    pub(crate) fn mark(&mut self, bit: usize) {
        self.row |= 4 << bit;
    }

    /// Whether no pixel of the group has changed so far.
    #[inline(always)]
    pub(crate) fn is_empty(self) -> bool {
        self.row < 4
    }

    /// The mask of the group; the first pixel is the lowest bit.
    #[inline(always)]
    pub(crate) fn group_mask(self) -> u8 {
        (self.row >> 2) as u8
    }
}

/// Mask of up to eight pixels that differ between `a` and `b`; the first pixel is the lowest bit.
#[inline(always)]
pub(crate) fn differing_pixels(a: &[[u8; 3]], b: &[[u8; 3]]) -> u8 {
    if a == b {
        return 0;
    }
    let pairs = a.iter().zip(b).enumerate();
    pairs.fold(0, |bits, (bit, (a, b))| bits | u8::from(a != b) << bit)
}

/// Number of set bits of a byte, at most 3: baseline x86-64 has no population count instruction.
const ONES_MAX3: [u8; 256] = {
    let mut counts = [0; 256];
    let mut bits = 1;
    while bits < counts.len() {
        let count = counts[bits / 2] + (bits % 2) as u8;
        counts[bits] = if count < 3 { count } else { 3 };
        bits += 1;
    }
    counts
};
