//! Planes of small numbers back to sRGB bytes: the inverse of [`super::split`].

use carom_tracer::Tile;

use super::levels::{self, quantise};
use super::mode::{Base, Colour, Mode};
use super::predict::{
    add, in_ratio, plus, plus_neighbours, plus_neighbours_in_place, predict, sized,
};
use super::split::Channels;

/// The planes of a message, read tile after tile: the inverse of [`Numbers`].
pub(super) struct Reader<'a> {
    marks: &'a [u8],
    channels: [&'a [u8]; 3],
    value: Channels,
    reference: Channels,
}

impl<'a> Reader<'a> {
    /// Bytes of marks for a tile.
    pub(super) fn mark_bytes(tile: Tile) -> usize {
        tile.pixels().div_ceil(8)
    }

    /// Planes that begin with so many bytes of marks; `None` if they are not as long as what is
    /// marked and `dense` pixels need.
    pub(super) fn new(planes: &'a [u8], mark_bytes: usize, dense: usize) -> Option<Self> {
        let (marks, rest) = planes.split_at_checked(mark_bytes)?;
        let length = dense + count(marks);
        (rest.len() == 3 * length).then(|| Self {
            marks,
            channels: [0, 1, 2].map(|channel| &rest[channel * length..][..length]),
            value: Channels::default(),
            reference: Channels::default(),
        })
    }

    /// Writes a tile's pixels. `None` if it is told from a reference that is not there, or marks
    /// pixels that it does not have.
    pub(super) fn join(
        &mut self,
        pixels: &mut [[u8; 3]],
        mode: Mode,
        step: u8,
        tile: Tile,
        reference: Option<&[[u8; 3]]>,
    ) -> Option<()> {
        let width = tile.width as usize;
        if mode.base == Base::Marked {
            let (marks, rest) = self.marks.split_at(Self::mark_bytes(tile));
            self.marks = rest;
            let numbers = self.take(count(marks));
            pixels.copy_from_slice(&levels::of(step, width, reference?));
            join_marked(pixels, marks, numbers, mode.colour)?;
        } else {
            if mode.base == Base::Neighbour {
                self.add_to_neighbours(pixels.len(), mode, width);
            } else {
                quantise(&mut self.reference, step, width, reference?);
                self.add_to_reference(mode);
            }
            let [g, r, b] = &self.value;
            for (pixel, ((g, r), b)) in pixels.iter_mut().zip(g.iter().zip(r).zip(b)) {
                *pixel = [*r, *g, *b];
            }
        }
        levels::to_values(step, width, pixels);
        Some(())
    }

    fn add_to_reference(&mut self, mode: Mode) {
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
            match mode.colour {
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

    fn add_to_neighbours(&mut self, pixels: usize, mode: Mode, width: usize) {
        let numbers = self.take(pixels);
        let [green, others @ ..] = &mut self.value;
        plus_neighbours(sized(green, pixels), numbers[0], width);
        for (out, number) in others.iter_mut().zip(&numbers[1..]) {
            let out = sized(out, pixels);
            match mode.colour {
                Colour::Ratio => {
                    plus(&mut out[..width], &number[..width], green);
                    for start in (width..pixels).step_by(width) {
                        let (above, row) = out[start - width..].split_at_mut(width);
                        let row = &mut row[..width];
                        predict(row, &green[start..], &green[start - width..], above);
                        add(row, &number[start..]);
                    }
                }
                Colour::Alone => plus_neighbours(out, number, width),
                Colour::Green => {
                    plus(out, number, numbers[0]);
                    plus_neighbours_in_place(out, width);
                }
            }
        }
    }

    fn take(&mut self, count: usize) -> [&'a [u8]; 3] {
        self.channels.each_mut().map(|channel| {
            let (taken, rest) = channel.split_at(count);
            *channel = rest;
            taken
        })
    }
}

/// Pixels that are marked.
fn count(marks: &[u8]) -> usize {
    let counts = marks.iter().map(|marks| marks.count_ones() as usize);
    counts.sum()
}

/// `levels` are the reference's until then.
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
