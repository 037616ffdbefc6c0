//! sRGB bytes to planes of small numbers, and back.
//!
//! Values are quantised first, each by itself, so that an error depends on nothing beside the
//! pixel. A tile's numbers are then the differences from the left neighbour, in the first column
//! from the one above, or from the same pixel of a tile that the client is known to hold; red and
//! blue either as they are or minus green's difference. Of these four the encoder takes the one
//! of the least sum of magnitudes. All sums are modulo 256.

use carom_tracer::Tile;

/// What the numbers of a tile are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Mode {
    pub(super) base: Base,
    pub(super) colour: Colour,
}

/// What the numbers of red and blue are differences from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Colour {
    /// What green's are from, and green's number beside.
    Green,
    /// What green's are from.
    Alone,
    /// Green's value times the ratio of the colours in the pixel above, or in the reference: the
    /// light on a surface varies, its colour hardly does.
    Ratio,
}

/// What a tile's numbers are differences from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Base {
    /// Neighbours in the tile.
    Neighbour,
    /// The reference.
    Reference,
    /// The reference, in the few pixels that are marked; the others are as they were.
    Marked,
}

/// The numbers of green, red and blue, tile after tile.
pub(super) type Channels = [Vec<u8>; 3];

/// The numbers of all tiles of a message.
#[derive(Debug, Default)]
pub(super) struct Numbers {
    /// A bit a pixel of tiles with [`Base::Marked`], the first the lowest; each tile begins a byte.
    marks: Vec<u8>,
    channels: Channels,
}

impl Numbers {
    pub(super) fn clear(&mut self) {
        self.marks.clear();
        self.channels.iter_mut().for_each(Vec::clear);
    }

    /// All planes, one behind the other.
    pub(super) fn write(&self, planes: &mut Vec<u8>) {
        planes.clear();
        planes.extend_from_slice(&self.marks);
        for channel in &self.channels {
            planes.extend_from_slice(channel);
        }
    }

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
pub(super) struct Splitter {
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
    /// is as its reference is.
    pub(super) fn split(
        &mut self,
        numbers: &mut Numbers,
        step: u8,
        tile: Tile,
        pixels: &[[u8; 3]],
        reference: Option<&[[u8; 3]]>,
    ) -> Option<Mode> {
        let levels = levels(step);
        quantise(&mut self.value, levels, pixels);
        let mut told = None;
        if let Some(reference) = reference {
            quantise(&mut self.reference, levels, reference);
            self.temporal
                .tell_from_reference(&self.value, &self.reference);
            let changed = changed(&self.temporal.differences);
            if changed == 0 {
                return None;
            }
            let (colour, cost) = self.temporal.cheapest();
            if changed * MARKED_PART <= pixels.len() {
                let base = Base::Marked;
                return Some(self.temporal.push(numbers, Mode { base, colour }));
            }
            told = Some((colour, cost));
        }
        self.spatial
            .tell_from_neighbours(&self.value, tile.width as usize);
        let (colour, cost) = self.spatial.cheapest();
        match told {
            Some((colour, less)) if less < cost => {
                let base = Base::Reference;
                Some(self.temporal.push(numbers, Mode { base, colour }))
            }
            _ => {
                let base = Base::Neighbour;
                Some(self.spatial.push(numbers, Mode { base, colour }))
            }
        }
    }
}

impl Candidate {
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
        match mode.base {
            Base::Marked => {
                let (marks, rest) = self.marks.split_at(Self::mark_bytes(tile));
                self.marks = rest;
                let numbers = self.take(count(marks));
                round(pixels, step, reference?);
                return join_marked(pixels, marks, numbers, mode.colour, step);
            }
            Base::Neighbour => self.add_to_neighbours(pixels.len(), mode, tile.width as usize),
            Base::Reference => {
                quantise(&mut self.reference, levels(step), reference?);
                self.add_to_reference(mode);
            }
        }
        let [g, r, b] = &self.value;
        for (pixel, ((g, r), b)) in pixels.iter_mut().zip(g.iter().zip(r).zip(b)) {
            *pixel = [r, g, b].map(|level| level.wrapping_mul(step));
        }
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

/// `pixels` have the reference's levels already.
fn join_marked(
    pixels: &mut [[u8; 3]],
    marks: &[u8],
    [g, r, b]: [&[u8]; 3],
    colour: Colour,
    step: u8,
) -> Option<()> {
    let mut numbers = g.iter().zip(r).zip(b);
    for (group, &marks) in pixels.chunks_mut(8).zip(marks) {
        let mut marks = marks;
        while marks != 0 {
            let pixel = group.get_mut(marks.trailing_zeros() as usize)?;
            let ((&g, &r), &b) = numbers.next()?;
            let [red, green, blue] = pixel.map(|value| value / step);
            let value = green.wrapping_add(g);
            let bases = match colour {
                Colour::Green => [red, blue].map(|base| base.wrapping_add(g)),
                Colour::Alone => [red, blue],
                Colour::Ratio => [red, blue].map(|base| in_ratio(value, green, base)),
            };
            let level = [bases[0].wrapping_add(r), value, bases[1].wrapping_add(b)];
            *pixel = level.map(|level| level.wrapping_mul(step));
            marks &= marks - 1;
        }
    }
    Some(())
}

/// `from`, each channel at the nearest level that `step` keeps.
pub(super) fn round(pixels: &mut [[u8; 3]], step: u8, from: &[[u8; 3]]) {
    if step == 1 {
        return pixels.copy_from_slice(from);
    }
    let levels = levels(step);
    for (pixel, from) in pixels.iter_mut().zip(from) {
        *pixel = from.map(|channel| levels[usize::from(channel)] * step);
    }
}

/// A copy by [`round`].
pub(super) fn rounded(step: u8, pixels: &[[u8; 3]]) -> Box<[[u8; 3]]> {
    let mut rounded: Box<[[u8; 3]]> = pixels.into();
    if step != 1 {
        round(&mut rounded, step, pixels);
    }
    rounded
}

/// The level of each value, in steps.
fn levels(step: u8) -> &'static [u8; 256] {
    match step {
        1 => const { &levels_of(1) },
        3 => const { &levels_of(3) },
        5 => const { &levels_of(5) },
        _ => unreachable!("no precision has steps of {step}"),
    }
}

const fn levels_of(step: u16) -> [u8; 256] {
    assert!(255 % step == 0, "black and white are levels");
    let mut levels = [0; 256];
    let mut value = 0;
    while value < 256 {
        levels[value as usize] = ((value + step / 2) / step) as u8;
        value += 1;
    }
    levels
}

fn quantise(planes: &mut Channels, levels: &[u8; 256], pixels: &[[u8; 3]]) {
    let [g, r, b] = planes.each_mut().map(|plane| sized(plane, pixels.len()));
    for (((pixel, g), r), b) in pixels.iter().zip(g).zip(r).zip(b) {
        *r = levels[usize::from(pixel[0])];
        *g = levels[usize::from(pixel[1])];
        *b = levels[usize::from(pixel[2])];
    }
}

fn minus_neighbour(out: &mut [u8], value: &[u8], width: usize) {
    let mut above = 0;
    for (out, row) in out.chunks_mut(width).zip(value.chunks(width)) {
        out[0] = row[0].wrapping_sub(above);
        above = row[0];
        minus(&mut out[1..], &row[1..], row);
    }
}

fn plus_neighbours(out: &mut [u8], number: &[u8], width: usize) {
    let mut above = 0;
    for (out, row) in out.chunks_mut(width).zip(number.chunks(width)) {
        let mut left = above;
        for (out, number) in out.iter_mut().zip(row) {
            left = number.wrapping_add(left);
            *out = left;
        }
        above = out[0];
    }
}

fn plus_neighbours_in_place(out: &mut [u8], width: usize) {
    let mut above = 0;
    for row in out.chunks_mut(width) {
        let mut left = above;
        for out in row.iter_mut() {
            left = out.wrapping_add(left);
            *out = left;
        }
        above = row[0];
    }
}

/// The value that stands to `green` as `base` to `base_green`. In f32, as processors divide four
/// and more of them at once: the product is exact and the quotient rounded, so that all agree.
fn in_ratio(green: u8, base_green: u8, base: u8) -> u8 {
    /// Added to a number below 2²², it leaves the nearest integer in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    let product = f32::from(green) * f32::from(base);
    let value = product / f32::from(base_green.max(1));
    (value.min(255.0) + ROUND).to_bits() as u8
}

fn predict(out: &mut [u8], green: &[u8], base_green: &[u8], base: &[u8]) {
    for (((out, green), base_green), base) in out.iter_mut().zip(green).zip(base_green).zip(base) {
        *out = in_ratio(*green, *base_green, *base);
    }
}

/// `value - out`.
fn subtract_from(out: &mut [u8], value: &[u8]) {
    for (out, value) in out.iter_mut().zip(value) {
        *out = value.wrapping_sub(*out);
    }
}

fn add(out: &mut [u8], number: &[u8]) {
    for (out, number) in out.iter_mut().zip(number) {
        *out = out.wrapping_add(*number);
    }
}

fn plus(out: &mut [u8], a: &[u8], b: &[u8]) {
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        *out = a.wrapping_add(*b);
    }
}

fn minus(out: &mut [u8], a: &[u8], b: &[u8]) {
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        *out = a.wrapping_sub(*b);
    }
}

fn sized(plane: &mut Vec<u8>, length: usize) -> &mut [u8] {
    plane.resize(length, 0);
    plane
}

fn magnitude(numbers: impl Iterator<Item = u8>) -> u32 {
    numbers
        .map(|number| u32::from(number.cast_signed().unsigned_abs()))
        .sum()
}

/// Pixels with a number that is not 0.
fn changed([green, red, blue]: &Channels) -> usize {
    let numbers = green.iter().zip(red).zip(blue);
    numbers.filter(|((g, r), b)| (*g | *r | *b) != 0).count()
}

/// Marks cost an eighth of a byte a pixel, and compress well where few are set.
const MARKED_PART: usize = 2;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ratio_rounds_to_the_nearest_and_keeps_what_has_not_changed() {
        for (green, base_green, base) in
            (0..=255).flat_map(|a| [(a, 7, 200), (91, a, 33), (3, 250, a)])
        {
            let exact = f64::from(green) * f64::from(base) / f64::from(base_green.max(1));
            let ratio = f64::from(in_ratio(green, base_green, base));
            assert!(
                (ratio - exact.min(255.0)).abs() <= 0.5001,
                "{green} {base_green} {base}"
            );
        }
        for (green, base) in (1..=255).flat_map(|green| (0..=255).map(move |base| (green, base))) {
            assert_eq!(in_ratio(green, green, base), base);
        }
    }

    #[test]
    fn a_level_is_within_half_a_step() {
        for step in [1, 3, 5] {
            let values: Vec<[u8; 3]> = (0..=255).map(|value| [value; 3]).collect();
            for (value, rounded) in values.iter().zip(rounded(step, &values)) {
                assert!(value[0].abs_diff(rounded[0]) <= step / 2, "{value:?}");
            }
            let again = rounded(step, &rounded(step, &values));
            assert_eq!(again, rounded(step, &values));
        }
    }
}
