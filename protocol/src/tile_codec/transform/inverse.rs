//! Planes of small numbers back to sRGB bytes: the inverse of [`super::split`].

use carom_tracer::Tile;
use fearless_simd::{Level, dispatch};

use super::forward::Channels;
use super::predict::{add, in_ratio, plus, plus_neighbours, predict, sized};
use super::quantise::{self as levels, quantise};
use crate::tile_codec::mode::{Base, Colour, Mode};

/// The planes of a message, read tile after tile: the inverse of [`Numbers`].
pub(crate) struct Reader<'a> {
    marks: &'a [u8],
    channels: [&'a [u8]; 3],
    value: Channels,
    reference: Channels,
    level: Level,
}

impl<'a> Reader<'a> {
    /// Bytes of marks for a tile.
    pub(crate) fn mark_bytes(tile: Tile) -> usize {
        tile.pixels().div_ceil(8)
    }

    /// Planes that begin with so many bytes of marks; `None` if they are not as long as what is
    /// marked and `dense` pixels need.
    pub(crate) fn new(
        level: Level,
        planes: &'a [u8],
        mark_bytes: usize,
        dense: usize,
    ) -> Option<Self> {
        let (marks, rest) = planes.split_at_checked(mark_bytes)?;
        let length = dense + count(marks);
        (rest.len() == 3 * length).then(|| Self {
            marks,
            channels: [0, 1, 2].map(|channel| &rest[channel * length..][..length]),
            value: Channels::default(),
            reference: Channels::default(),
            level,
        })
    }

    /// Writes a tile's pixels. `None` if it is told from a reference that is not there, or marks
    /// pixels that it does not have.
    pub(crate) fn join(
        &mut self,
        pixels: &mut [[u8; 3]],
        mode: Mode,
        step: u8,
        tile: Tile,
        reference: Option<&[[u8; 3]]>,
    ) -> Option<()> {
        dispatch!(self.level, _ => self.join_wide(pixels, mode, step, tile, reference))
    }

    /// The compiler makes of it what the processor has.
    #[inline(always)]
    fn join_wide(
        &mut self,
        pixels: &mut [[u8; 3]],
        mode: Mode,
        step: u8,
        tile: Tile,
        reference: Option<&[[u8; 3]]>,
    ) -> Option<()> {
        let width = tile.width as usize;
        match mode.base {
            Base::Marked => {
                let (marks, rest) = self.marks.split_at(Self::mark_bytes(tile));
                self.marks = rest;
                let numbers = self.take(count(marks));
                pixels.copy_from_slice(&levels::of(step, width, reference?));
                join_marked(pixels, marks, numbers, mode.colour)?;
            }
            Base::Neighbour => self.add_to_neighbours(pixels, mode.colour, width),
            Base::Reference => {
                quantise(&mut self.reference, step, width, reference?);
                self.add_to_reference(mode.colour);
                self.write(pixels);
            }
        }
        levels::to_values(step, width, pixels);
        Some(())
    }

    #[inline(always)]
    fn add_to_reference(&mut self, colour: Colour) {
        let numbers = self.take(self.reference[0].len());
        let [green, others @ ..] = &mut self.value;
        plus(
            sized(green, numbers[0].len()),
            numbers[0],
            &self.reference[0],
        );
        for (channel, out) in others.iter_mut().enumerate() {
            let (number, base) = (numbers[1 + channel], &self.reference[1 + channel]);
            let out = sized(out, number.len());
            match colour {
                Colour::Ratio => {
                    predict(out, green, &self.reference[0], base);
                    add(out, number);
                }
                Colour::Alone => plus(out, number, base),
                Colour::Green => {
                    plus(out, number, base);
                    add(out, numbers[0]);
                }
            }
        }
    }

    #[inline(always)]
    fn add_to_neighbours(&mut self, pixels: &mut [[u8; 3]], colour: Colour, width: usize) {
        let numbers = self.take(pixels.len());
        match colour {
            Colour::Alone => return sum_rows(pixels, numbers, width, |_, number| number),
            Colour::Green => return sum_rows(pixels, numbers, width, u8::wrapping_add),
            Colour::Ratio => {}
        }
        let [green, others @ ..] = &mut self.value;
        plus_neighbours(sized(green, pixels.len()), numbers[0], width);
        for (out, number) in others.iter_mut().zip(&numbers[1..]) {
            let out = sized(out, pixels.len());
            plus(&mut out[..width], &number[..width], green);
            for start in (width..pixels.len()).step_by(width) {
                let (above, row) = out[start - width..].split_at_mut(width);
                let row = &mut row[..width];
                predict(row, &green[start..], &green[start - width..], above);
                add(row, &number[start..]);
            }
        }
        self.write(pixels);
    }

    #[inline(always)]
    fn write(&self, pixels: &mut [[u8; 3]]) {
        let [g, r, b] = &self.value;
        for (pixel, ((g, r), b)) in pixels.iter_mut().zip(g.iter().zip(r).zip(b)) {
            *pixel = [*r, *g, *b];
        }
    }

    #[inline(always)]
    fn take(&mut self, count: usize) -> [&'a [u8]; 3] {
        self.channels.each_mut().map(|channel| {
            let (taken, rest) = channel.split_at(count);
            *channel = rest;
            taken
        })
    }
}

/// Pixels that are marked.
#[inline(always)]
fn count(marks: &[u8]) -> usize {
    let counts = marks.iter().map(|marks| marks.count_ones() as usize);
    counts.sum()
}

/// Adds numbers to the left neighbour, in the first column to the one above; `other` is red's or blue's
/// by green's and its own. All channels at once: each alone waits for its sum.
#[inline(always)]
fn sum_rows(
    pixels: &mut [[u8; 3]],
    [g, r, b]: [&[u8]; 3],
    width: usize,
    other: impl Fn(u8, u8) -> u8,
) {
    let mut numbers = g.iter().zip(r).zip(b);
    let mut above = [0u8; 3];
    for row in pixels.chunks_mut(width) {
        let mut left = above;
        for (pixel, ((&g, &r), &b)) in row.iter_mut().zip(&mut numbers) {
            let [red, green, blue] = left;
            left = [
                red.wrapping_add(other(g, r)),
                green.wrapping_add(g),
                blue.wrapping_add(other(g, b)),
            ];
            *pixel = left;
        }
        above = row[0];
    }
}

/// `levels` are the reference's until then.
#[inline(always)]
fn join_marked(
    levels: &mut [[u8; 3]],
    marks: &[u8],
    [g, r, b]: [&[u8]; 3],
    colour: Colour,
) -> Option<()> {
    let mut numbers = g.iter().zip(r).zip(b);
    for (group, &marks) in levels.chunks_mut(8).zip(marks) {
        let mut marks = marks;
        while marks != 0 {
            let pixel = group.get_mut(marks.trailing_zeros() as usize)?;
            let ((&g, &r), &b) = numbers.next()?;
            let [red, green, blue] = *pixel;
            let value = green.wrapping_add(g);
            let bases = match colour {
                Colour::Green => [red, blue].map(|base| base.wrapping_add(g)),
                Colour::Alone => [red, blue],
                Colour::Ratio => [red, blue].map(|base| in_ratio(value, green, base)),
            };
            *pixel = [bases[0].wrapping_add(r), value, bases[1].wrapping_add(b)];
            marks &= marks - 1;
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::super::forward::{Numbers, Splitter};
    use super::*;

    /// Both ends may have other processors.
    #[test]
    fn each_width_of_processor_makes_the_same_numbers_and_pixels() {
        let tile = Tile {
            x: 0,
            y: 0,
            width: 37,
            height: 29,
        };
        let picture = |seed: u32| -> Vec<[u8; 3]> {
            let pixel = |index: u32| {
                let soft = 40 + index / 11;
                let noise = (index ^ seed).wrapping_mul(0x9e37_79b9) >> 27;
                [soft + noise, soft + noise / 2, soft / 2 + noise].map(|value| value as u8)
            };
            (0..tile.pixels() as u32).map(pixel).collect()
        };
        let (now, before) = (picture(1), picture(2));
        let levels = [Level::baseline(), Level::new()];
        for (step, reference) in [
            (1, None),
            (3, None),
            (5, Some(&before[..])),
            (1, Some(&before[..])),
        ] {
            let planes = levels.map(|level| {
                let mut numbers = Numbers::default();
                let mut splitter = Splitter::default();
                let (mode, _) = splitter.split(level, &mut numbers, step, tile, &now, reference);
                let mut planes = Vec::new();
                numbers.write(&mut planes);
                (mode, planes)
            });
            assert_eq!(planes[0], planes[1]);
            let (mode, planes) = &planes[0];
            let joined = levels.map(|level| {
                let mut reader = Reader::new(level, planes, 0, tile.pixels()).unwrap();
                let mut pixels = vec![[0; 3]; tile.pixels()];
                reader
                    .join(&mut pixels, mode.unwrap(), step, tile, reference)
                    .unwrap();
                pixels
            });
            assert_eq!(joined[0], joined[1]);
            assert_eq!(joined[0], *levels::rounded(step, 37, &now));
        }
    }
}
