//! Tiles told from those that the client holds, by their changed pixels alone.
//!
//! Where the camera stands still most pixels stay as they are, and those that change hardly look like
//! what zstd is made for: noise, whose size depends on what lies around. So each pixel's numbers are
//! coded by themselves, as likely as numbers were in such surroundings:
//!
//! - whether anything changes among eight pixels, and which of them do, from those that changed to
//!   the left, above and two rows above;
//! - green, from the median of the pixels to the left, above and before;
//! - red and blue, from the one of the pixels around that is nearest to it in green, at its colour:
//!   the light on a surface varies, its colour hardly does.
//!
//! This takes a third less than marks and planes of numbers under zstd, and about 0.08 µs a changed
//! pixel at either end (`carom-bench codec`): too slow where all pixels change.

use std::hint::select_unpredictable;

use crate::tile_codec::entropy::range_coder::{Bit, Coder};
use crate::tile_codec::transform::predict::in_ratio;

/// What has been learnt about the changes in a message.
#[derive(Debug)]
pub(crate) struct Changes {
    tile: Bit,
    groups: [Bit; 48],
    marks: [Bit; 36],
    green: [Number; 3 * CLASSES],
    red: [Number; 2 * CLASSES],
    blue: [Number; 2 * CLASSES],
    /// Of the present tile, a bit a pixel that has changed, with a margin of zeros: two rows above,
    /// and a byte at each side.
    changed: Vec<u8>,
    pixels: usize,
}

impl Changes {
    pub(crate) fn new() -> Self {
        Self {
            tile: Bit::NEW,
            groups: [Bit::NEW; 48],
            marks: [Bit::NEW; 36],
            green: [Number::NEW; 3 * CLASSES],
            red: [Number::NEW; 2 * CLASSES],
            blue: [Number::NEW; 2 * CLASSES],
            changed: Vec::new(),
            pixels: 0,
        }
    }

    /// Forgets all: each message is told by itself.
    pub(crate) fn begin(&mut self) {
        let changed = std::mem::take(&mut self.changed);
        *self = Self::new();
        self.changed = changed;
    }

    /// Pixels that have changed in this message.
    pub(crate) fn pixels(&self) -> usize {
        self.pixels
    }

    /// Whether a tile changes at all.
    pub(crate) fn changes(&mut self, coder: &mut impl Coder, changes: bool) -> bool {
        coder.bit(&mut self.tile, changes)
    }

    /// Makes the levels that a tile had those of `new`, which a decoder does not know. `step` is what
    /// they are multiples of.
    pub(crate) fn tile<C: Coder>(
        &mut self,
        coder: &mut C,
        width: usize,
        step: u8,
        levels: &mut [[u8; 3]],
        new: Option<&[[u8; 3]]>,
    ) {
        let groups = width.div_ceil(8);
        let stride = groups + 2;
        self.changed.clear();
        self.changed.resize(stride * (levels.len() / width + 2), 0);
        for row in 0..levels.len() / width {
            for group in 0..groups {
                let x = 8 * group;
                let part = Part {
                    x,
                    first: row * width + x,
                    length: 8.min(width - x),
                    width,
                    step,
                };
                let at = (row + 2) * stride + 1 + group;
                let near = Near::new(&self.changed, at, stride);
                self.changed[at] = self.group(coder, &part, near, levels, new);
            }
        }
    }

    /// Which pixels of a group have changed.
    #[inline(always)]
    fn group<C: Coder>(
        &mut self,
        coder: &mut C,
        part: &Part,
        mut near: Near,
        levels: &mut [[u8; 3]],
        new: Option<&[[u8; 3]]>,
    ) -> u8 {
        let range = part.first..part.first + part.length;
        let wanted = new.map_or(0, |new| differing(&levels[range.clone()], &new[range]));
        if !coder.bit(&mut self.groups[near.group()], wanted != 0) {
            return 0;
        }
        for bit in 0..part.length {
            let is_last_hope = bit + 1 == part.length && near.none_here();
            let model = &mut self.marks[near.pixel(bit)];
            if !is_last_hope && !coder.bit(model, wanted >> bit & 1 != 0) {
                continue;
            }
            let index = part.first + bit;
            let around = Around::new(levels, index, part.x + bit, part.width, near.beside(bit));
            let wanted = new.map_or([0; 3], |new| new[index]);
            levels[index] = self.pixel(coder, part.step, &around, wanted);
            near.mark(bit);
            self.pixels += 1;
        }
        near.here()
    }

    #[inline(always)]
    fn pixel<C: Coder>(
        &mut self,
        coder: &mut C,
        step: u8,
        around: &Around,
        wanted: [u8; 3],
    ) -> [u8; 3] {
        let class = |difference: u8| class(difference.saturating_mul(step));
        let Around {
            old, left, above, ..
        } = around;
        let [low, expected, high] = sorted([old, left, above].map(|pixel| pixel.green()));
        let [up, down] = [high - expected, expected - low].map(u16::from);
        let lean = usize::from(up > 2 * down) + 2 * usize::from(down > 2 * up);
        let number = &mut self.green[3 * class(high - low) + around.changed];
        let green = number.code(coder, lean, expected, wanted[1]).0;
        let (nearest, distance) = around.nearest(green);
        let same = usize::from(green == old.green());
        let expected = [0, 2].map(|channel| in_ratio(green, nearest[1], nearest[channel]));
        let number = &mut self.red[2 * class(distance) + same];
        let (red, error) = number.code(coder, 0, expected[0], wanted[0]);
        let number = &mut self.blue[2 * class(error.unsigned_abs().min(255) as u8) + same];
        let lean = usize::from(error < 0) + 2 * usize::from(error > 0);
        let blue = number.code(coder, lean, expected[1], wanted[2]).0;
        [red, green, blue]
    }
}

/// Up to eight pixels of a row.
struct Part {
    /// The first one's column and index.
    x: usize,
    first: usize,
    length: usize,
    width: usize,
    step: u8,
}

/// What has changed around eight pixels. Of each row bit 2 is the first pixel's.
#[derive(Clone, Copy)]
struct Near {
    here: u32,
    above: u32,
    above2: u32,
}

impl Near {
    #[inline(always)]
    fn new(changed: &[u8], at: usize, stride: usize) -> Self {
        let rows = &changed[at - 2 * stride..];
        let row = |middle: usize| {
            let [left, here, right] = [middle.wrapping_sub(1), middle, middle + 1]
                .map(|index| rows.get(index).copied().map_or(0, u32::from));
            left >> 6 | here << 2 | right << 10
        };
        Self {
            here: row(2 * stride) & 3,
            above: row(stride),
            above2: row(0) & 0x3fc,
        }
    }

    /// The model of whether anything changes here.
    #[inline(always)]
    fn group(self) -> usize {
        let above = u32::from(ONES_MAX3[usize::from((self.above >> 2) as u8)]);
        let here = (self.here & 1) + (self.here >> 1 & 1);
        let corners = u32::from(self.above & 0x402 != 0);
        let above2 = u32::from(self.above2 != 0);
        (((above * 3 + here) * 2 + above2) * 2 + corners) as usize
    }

    /// The model of whether a pixel changes.
    #[inline(always)]
    fn pixel(self, bit: usize) -> usize {
        let (here, above, above2) = (self.here >> bit, self.above >> bit, self.above2 >> bit);
        let corners = (above >> 1 & 1) + (above >> 3 & 1);
        let far = (here & 1) + (above2 >> 2 & 1);
        ((here >> 1 & 1) + 2 * (above >> 2 & 1) + 4 * corners + 12 * far) as usize
    }

    /// How many of the pixels to the left and above have changed.
    #[inline(always)]
    fn beside(self, bit: usize) -> usize {
        ((self.here >> bit >> 1 & 1) + (self.above >> bit >> 2 & 1)) as usize
    }

    #[inline(always)]
    fn mark(&mut self, bit: usize) {
        self.here |= 4 << bit;
    }

    #[inline(always)]
    fn none_here(self) -> bool {
        self.here < 4
    }

    #[inline(always)]
    fn here(self) -> u8 {
        (self.here >> 2) as u8
    }
}

/// A pixel's red, green and blue, the first lowest: one register instead of three.
#[derive(Clone, Copy)]
struct Packed(u32);

impl Packed {
    #[inline(always)]
    fn new([r, g, b]: [u8; 3]) -> Self {
        Self(u32::from_le_bytes([r, g, b, 0]))
    }

    #[inline(always)]
    fn green(self) -> u8 {
        (self.0 >> 8) as u8
    }
}

/// The pixels that say something about one that has changed; at an edge, itself as it was.
struct Around {
    old: Packed,
    left: Packed,
    above: Packed,
    above_right: Packed,
    /// How many of the pixels to the left and above have changed.
    changed: usize,
}

impl Around {
    #[inline(always)]
    fn new(levels: &[[u8; 3]], index: usize, x: usize, width: usize, changed: usize) -> Self {
        let old = Packed::new(levels[index]);
        let is_below = index >= width;
        let or_old = |is_there: bool, index: usize| match is_there {
            true => Packed::new(levels[index]),
            false => old,
        };
        Self {
            old,
            left: or_old(x > 0, index.wrapping_sub(1)),
            above: or_old(is_below, index.wrapping_sub(width)),
            above_right: or_old(is_below && x + 1 < width, (index + 1).wrapping_sub(width)),
            changed,
        }
    }

    /// The pixel that is nearest to a green, and how far it is.
    #[inline(always)]
    fn nearest(&self, green: u8) -> ([u8; 3], u8) {
        let pixels = [self.old, self.left, self.above, self.above_right];
        // Noise cannot be foreseen, and a branch that cannot costs more than all of this.
        let key = |(pixel, order): (Packed, u64)| {
            let distance = u64::from(pixel.green().abs_diff(green));
            distance << 32 | order << 24 | u64::from(pixel.0)
        };
        let keys = pixels.into_iter().zip(0..).map(key);
        let [r, g, b, _, distance, ..] = keys.min().unwrap_or(0).to_le_bytes();
        ([r, g, b], distance)
    }
}

/// A number near 0, as it was in like surroundings: 0 or not, the length of its binary form in unary,
/// the bits below the uppermost, and the sign.
#[derive(Clone, Copy, Debug)]
struct Number {
    other: Bit,
    longer: [Bit; 7],
    second: [Bit; 5],
    negative: [Bit; 3],
}

impl Number {
    const NEW: Self = Self {
        other: Bit::NEW,
        longer: [Bit::NEW; 7],
        second: [Bit::NEW; 5],
        negative: [Bit::NEW; 3],
    };

    /// Codes a value by its difference from what was expected; gives both. `lean` says of which sign
    /// the difference might be.
    #[inline(always)]
    fn code<C: Coder>(
        &mut self,
        coder: &mut C,
        lean: usize,
        expected: u8,
        wanted: u8,
    ) -> (u8, i16) {
        let difference = i16::from(wanted) - i16::from(expected);
        if !coder.bit(&mut self.other, difference != 0) {
            return (expected, 0);
        }
        let size = self.size(coder, u32::from(difference.unsigned_abs()));
        let is_negative = coder.bit(&mut self.negative[lean], difference < 0);
        let difference = select_unpredictable(is_negative, -size, size);
        (expected.wrapping_add_signed(difference as i8), difference)
    }

    /// A size of 1 to 255.
    #[inline(always)]
    fn size<C: Coder>(&mut self, coder: &mut C, wanted: u32) -> i16 {
        let below_top = wanted.checked_ilog2().unwrap_or(0);
        let mut length = 0;
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

/// A bit for each pixel that is not the same.
#[inline(always)]
fn differing(a: &[[u8; 3]], b: &[[u8; 3]]) -> u8 {
    if a == b {
        return 0;
    }
    let pairs = a.iter().zip(b).enumerate();
    pairs.fold(0, |bits, (bit, (a, b))| bits | u8::from(a != b) << bit)
}

#[inline(always)]
fn sorted([a, b, c]: [u8; 3]) -> [u8; 3] {
    let (low, high) = (a.min(b), a.max(b));
    [low.min(c), high.min(c).max(low), high.max(c)]
}

/// How large a difference is, in classes that are wider the larger it is.
#[inline(always)]
fn class(difference: u8) -> usize {
    usize::from(CLASS_OF[usize::from(difference)])
}

/// Set bits, 3 for more: processors of 2003 have no instruction for it.
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
const CLASSES: usize = 7;
/// The largest difference of each class but the last. More classes learnt no better.
const CLASS_MAX: [u8; CLASSES - 1] = [0, 1, 3, 8, 20, 48];
const CLASS_OF: [u8; 256] = {
    let mut classes = [0; 256];
    let mut difference = 0;
    while difference < classes.len() {
        let mut class = 0;
        while class < CLASS_MAX.len() && difference > CLASS_MAX[class] as usize {
            class += 1;
        }
        classes[difference] = class as u8;
        difference += 1;
    }
    classes
};
