//! Delta coder: a delta mask and the values of the marked pixels, range coded.
//!
//! Under a still camera most pixels stay as they are, and those that change are noise whose amplitude
//! depends on the surroundings. Each decision is therefore coded with an adaptive probability per
//! context:
//!
//! - whether any of eight pixels changes, and which of them, from [`MaskContext`];
//! - green, as a difference from the median of the pixels to the left, above and in the reference;
//! - red and blue, as differences from the neighbour that is nearest in green, shifted by the
//!   difference in green: light varies across a surface, its colour hardly does.

use super::delta_mask::{MaskContext, differing_pixels};
use super::neighbourhood::Neighbourhood;
use crate::tile_codec::entropy::range_coder::{BitModel, Coder};
use crate::tile_codec::entropy::value_model::ValueModel;

/// Delta coder of a message, with its adaptive models.
#[derive(Debug)]
pub(crate) struct DeltaCoder {
    tile: BitModel,
    groups: [BitModel; 48],
    pixels: [BitModel; 36],
    green: [ValueModel; 3 * CLASSES],
    red: [ValueModel; 2 * CLASSES],
    blue: [ValueModel; 2 * CLASSES],
    /// The mask of the tile being coded, with a margin of zeros: two rows above and a byte at each side.
    mask: Vec<u8>,
    changed: usize,
}

impl DeltaCoder {
    pub(crate) fn new() -> Self {
        Self {
            tile: BitModel::NEW,
            groups: [BitModel::NEW; 48],
            pixels: [BitModel::NEW; 36],
            green: [ValueModel::NEW; 3 * CLASSES],
            red: [ValueModel::NEW; 2 * CLASSES],
            blue: [ValueModel::NEW; 2 * CLASSES],
            mask: Vec::new(),
            changed: 0,
        }
    }

    /// Begins a message with fresh models: messages may be lost or overtaken, so none may depend on another.
    pub(crate) fn begin(&mut self) {
        let mask = std::mem::take(&mut self.mask);
        *self = Self::new();
        self.mask = mask;
    }

    /// Number of pixels of the message that differ from their references.
    pub(crate) fn changed_pixels(&self) -> usize {
        self.changed
    }

    /// Codes whether a tile differs from its reference.
    pub(crate) fn tile_changes(&mut self, coder: &mut impl Coder, changes: bool) -> bool {
        coder.bit(&mut self.tile, changes)
    }

    /// Codes a tile: turns `levels`, which are the reference's, into those of `new`, which is `None` in a
    /// decoder. `step` is the precision's quantisation step.
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
        self.mask.clear();
        // The margin spares the contexts every test for an edge: pixels beyond it count as unchanged.
        self.mask.resize(stride * (levels.len() / width + 2), 0);
        for row in 0..levels.len() / width {
            for group in 0..groups {
                let x = 8 * group;
                let part = PixelGroup {
                    x,
                    first: row * width + x,
                    length: 8.min(width - x),
                    width,
                    step,
                };
                let at = (row + 2) * stride + 1 + group;
                let context = MaskContext::new(&self.mask, at, stride);
                self.mask[at] = self.group(coder, &part, context, levels, new);
            }
        }
    }

    /// Codes a group of pixels and returns its mask.
    #[inline(always)]
    fn group<C: Coder>(
        &mut self,
        coder: &mut C,
        part: &PixelGroup,
        mut context: MaskContext,
        levels: &mut [[u8; 3]],
        new: Option<&[[u8; 3]]>,
    ) -> u8 {
        let range = part.first..part.first + part.length;
        let wanted = new.map_or(0, |new| {
            differing_pixels(&levels[range.clone()], &new[range])
        });
        if !coder.bit(&mut self.groups[context.group_context()], wanted != 0) {
            return 0;
        }
        for bit in 0..part.length {
            // The group has some changed pixel: if none before its last has changed, the last one must have.
            let is_implied = bit + 1 == part.length && context.is_empty();
            let model = &mut self.pixels[context.pixel_context(bit)];
            if !is_implied && !coder.bit(model, wanted >> bit & 1 != 0) {
                continue;
            }
            let index = part.first + bit;
            let around = Neighbourhood::new(levels, index, part.x + bit, part.width);
            let wanted = new.map_or([0; 3], |new| new[index]);
            let neighbours = context.changed_neighbours(bit);
            // Written in place: for the pixels after it this one is a causal neighbour with its new value, as
            // in the decoder.
            levels[index] = self.pixel(coder, part.step, &around, neighbours, wanted);
            context.mark(bit);
            self.changed += 1;
        }
        context.group_mask()
    }

    /// Codes a changed pixel, of whose left and upper neighbours `neighbours` (0 to 2) have changed too.
    #[inline(always)]
    fn pixel<C: Coder>(
        &mut self,
        coder: &mut C,
        step: u8,
        around: &Neighbourhood,
        neighbours: usize,
        wanted: [u8; 3],
    ) -> [u8; 3] {
        // Classes are of differences in pixel values, so that noise of one amplitude has one class at each
        // precision.
        let class = |difference: u8| class(difference.saturating_mul(step));
        let Neighbourhood {
            reference,
            left,
            above,
            ..
        } = around;
        let [low, median, high] = sorted([reference, left, above].map(|pixel| pixel.green()));
        // The median predicts green. If the largest or smallest of the three lies far from it, the error more
        // likely has its sign.
        let [up, down] = [high - median, median - low].map(u16::from);
        let lean = usize::from(up > 2 * down) + 2 * usize::from(down > 2 * up);
        let model = &mut self.green[3 * class(high - low) + neighbours];
        let green = model.code(coder, lean, median, wanted[1]).0;
        let (nearest, distance) = around.nearest(green);
        let same = usize::from(green == reference.green());
        // On a surface whose illumination varies, the differences between channels vary less than the
        // channels.
        let shift = i16::from(green) - i16::from(nearest[1]);
        let expected = |channel: usize| (i16::from(nearest[channel]) + shift).clamp(0, 255) as u8;
        let model = &mut self.red[2 * class(distance) + same];
        let (red, error) = model.code(coder, 0, expected(0), wanted[0]);
        // Blue's error correlates with red's, in magnitude and in sign.
        let model = &mut self.blue[2 * class(error.unsigned_abs().min(255) as u8) + same];
        let lean = usize::from(error < 0) + 2 * usize::from(error > 0);
        let blue = model.code(coder, lean, expected(2), wanted[2]).0;
        [red, green, blue]
    }
}

/// Group of up to eight pixels of a row, which share a byte of the mask.
struct PixelGroup {
    /// Column and index of the first pixel.
    x: usize,
    first: usize,
    length: usize,
    width: usize,
    step: u8,
}

#[inline(always)]
fn sorted([a, b, c]: [u8; 3]) -> [u8; 3] {
    let (low, high) = (a.min(b), a.max(b));
    [low.min(c), high.min(c).max(low), high.max(c)]
}

/// Class of an absolute difference. Classes widen with the difference.
#[inline(always)]
fn class(difference: u8) -> usize {
    usize::from(CLASS_OF[usize::from(difference)])
}

const CLASSES: usize = 7;
/// The largest difference of each class but the last. More classes dilute the statistics of each and
/// saved no bytes.
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
