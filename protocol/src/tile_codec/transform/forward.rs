//! sRGB bytes to planes of small numbers.
//!
//! A tile's numbers are the differences from the left neighbour, in the first column from the one
//! above, or from the same pixel of a tile that the client is known to hold; red and blue as they
//! are, minus green's difference, or from what the ratio of the colours beside lets expect. Of these
//! the encoder takes the one of the least sum of magnitudes. All sums are modulo 256.

use carom_tracer::Tile;
use fearless_simd::{Level, dispatch};

use super::predict::{minus, minus_neighbour, predict, sized, subtract_from};
use super::quantise::quantise;
use crate::tile_codec::mode::{Base, Colour, Mode};

/// The numbers of green, red and blue, tile after tile.
pub(crate) type Channels = [Vec<u8>; 3];

/// The numbers of all tiles of a message.
#[derive(Debug, Default)]
pub(crate) struct Numbers {
    /// A bit a pixel of tiles with [`Base::Marked`], the first the lowest; each tile begins a byte.
    marks: Vec<u8>,
    channels: Channels,
}

impl Numbers {
    pub(crate) fn clear(&mut self) {
        self.marks.clear();
        self.channels.iter_mut().for_each(Vec::clear);
    }

    /// All planes, one behind the other.
    pub(crate) fn write(&self, planes: &mut Vec<u8>) {
        planes.clear();
        planes.extend_from_slice(&self.marks);
        for channel in &self.channels {
            planes.extend_from_slice(channel);
        }
    }

    #[inline(always)]
    fn push(&mut self, numbers: [&Vec<u8>; 3], mode: Mode) {
        let [green, others @ ..] = numbers;
        let start = self.channels[0].len();
        match mode.base {
            Base::Marked => self.push_marked(numbers),
            Base::Neighbour | Base::Reference => {
                self.channels[0].extend_from_slice(green);
                for (plane, channel) in self.channels[1..].iter_mut().zip(others) {
                    plane.extend_from_slice(channel);
                }
            }
        }
        if mode.colour == Colour::Green {
            let [green, red, blue] = &mut self.channels;
            for plane in [red, blue] {
                for (value, green) in plane[start..].iter_mut().zip(&green[start..]) {
                    *value = value.wrapping_sub(*green);
                }
            }
        }
    }

    #[inline(always)]
    fn push_marked(&mut self, [green, red, blue]: [&Vec<u8>; 3]) {
        let groups = green.chunks(8).zip(red.chunks(8)).zip(blue.chunks(8));
        for ((g, r), b) in groups {
            let mut marks = 0;
            for (bit, ((g, r), b)) in g.iter().zip(r).zip(b).enumerate() {
                if (g | r | b) != 0 {
                    marks |= 1 << bit;
                    self.channels[0].push(*g);
                    self.channels[1].push(*r);
                    self.channels[2].push(*b);
                }
            }
            self.marks.push(marks);
        }
    }
}

/// Turns tiles into numbers; its buffers are used again.
#[derive(Debug, Default)]
pub(crate) struct Splitter {
    value: Channels,
    reference: Channels,
    spatial: Candidate,
    temporal: Candidate,
}

/// A tile's numbers from one base.
#[derive(Debug, Default)]
struct Candidate {
    /// For [`Colour::Green`] and [`Colour::Alone`].
    differences: Channels,
    /// Of red and blue, for [`Colour::Ratio`].
    ratio: [Vec<u8>; 2],
}

impl Splitter {
    /// Appends a tile's numbers and says what they are; `None`, with nothing appended, if the tile
    /// is as its reference is. The second number is that of the pixels that are not.
    pub(crate) fn split(
        &mut self,
        level: Level,
        numbers: &mut Numbers,
        step: u8,
        tile: Tile,
        pixels: &[[u8; 3]],
        reference: Option<&[[u8; 3]]>,
    ) -> (Option<Mode>, usize) {
        dispatch!(level, _ => self.split_wide(numbers, step, tile, pixels, reference))
    }

    /// The compiler makes of it what the processor has.
    #[inline(always)]
    fn split_wide(
        &mut self,
        numbers: &mut Numbers,
        step: u8,
        tile: Tile,
        pixels: &[[u8; 3]],
        reference: Option<&[[u8; 3]]>,
    ) -> (Option<Mode>, usize) {
        let width = tile.width as usize;
        quantise(&mut self.value, step, width, pixels);
        let (mut told, mut changed) = (None, pixels.len());
        if let Some(reference) = reference {
            quantise(&mut self.reference, step, width, reference);
            self.temporal
                .tell_from_reference(&self.value, &self.reference);
            changed = count_changed(&self.temporal.differences);
            if changed == 0 {
                return (None, 0);
            }
            let (colour, cost) = self.temporal.cheapest();
            if changed * MARKED_PART <= pixels.len() {
                let base = Base::Marked;
                let mode = self.temporal.push(numbers, Mode { base, colour });
                return (Some(mode), changed);
            }
            told = Some((colour, cost));
        }
        self.spatial.tell_from_neighbours(&self.value, width);
        let (colour, cost) = self.spatial.cheapest();
        let mode = match told {
            Some((colour, less)) if less < cost => {
                let base = Base::Reference;
                self.temporal.push(numbers, Mode { base, colour })
            }
            _ => {
                let base = Base::Neighbour;
                self.spatial.push(numbers, Mode { base, colour })
            }
        };
        (Some(mode), changed)
    }
}

impl Candidate {
    #[inline(always)]
    fn tell_from_reference(&mut self, value: &Channels, reference: &Channels) {
        for (out, (value, base)) in self.differences.iter_mut().zip(value.iter().zip(reference)) {
            minus(sized(out, value.len()), value, base);
        }
        for (out, channel) in self.ratio.iter_mut().zip(1..) {
            let out = sized(out, value[0].len());
            predict(out, &value[0], &reference[0], &reference[channel]);
            subtract_from(out, &value[channel]);
        }
    }

    #[inline(always)]
    fn tell_from_neighbours(&mut self, value: &Channels, width: usize) {
        for (out, value) in self.differences.iter_mut().zip(value) {
            minus_neighbour(sized(out, value.len()), value, width);
        }
        let green = &value[0];
        for (out, channel) in self.ratio.iter_mut().zip(&value[1..]) {
            let out = sized(out, green.len());
            // Above the first row all is grey.
            out[..width].copy_from_slice(&green[..width]);
            predict(&mut out[width..], &green[width..], green, channel);
            subtract_from(out, channel);
        }
    }

    /// The colours of least cost, and the cost.
    #[inline(always)]
    fn cheapest(&self) -> (Colour, u32) {
        let [green, red, blue] = &self.differences;
        let from_green = |channel: &[u8]| {
            let differences = channel.iter().zip(green);
            magnitude(differences.map(|(value, green)| value.wrapping_sub(*green)))
        };
        let of = |plane: &[u8]| magnitude(plane.iter().copied());
        let costs = [
            (Colour::Green, from_green(red) + from_green(blue)),
            (Colour::Alone, of(red) + of(blue)),
            (Colour::Ratio, of(&self.ratio[0]) + of(&self.ratio[1])),
        ];
        let [mut best, others @ ..] = costs;
        for other in others {
            if other.1 < best.1 {
                best = other;
            }
        }
        (best.0, of(green) + best.1)
    }

    #[inline(always)]
    fn push(&self, numbers: &mut Numbers, mode: Mode) -> Mode {
        let [green, red, blue] = &self.differences;
        let planes = match mode.colour {
            Colour::Green | Colour::Alone => [green, red, blue],
            Colour::Ratio => [green, &self.ratio[0], &self.ratio[1]],
        };
        numbers.push(planes, mode);
        mode
    }
}

#[inline(always)]
fn magnitude(numbers: impl Iterator<Item = u8>) -> u32 {
    numbers
        .map(|number| u32::from(number.cast_signed().unsigned_abs()))
        .sum()
}

/// Pixels with a number that is not 0.
#[inline(always)]
fn count_changed([green, red, blue]: &Channels) -> usize {
    let numbers = green.iter().zip(red).zip(blue);
    numbers.filter(|((g, r), b)| (*g | *r | *b) != 0).count()
}

/// Marks cost an eighth of a byte a pixel, and compress well where few are set.
const MARKED_PART: usize = 2;
