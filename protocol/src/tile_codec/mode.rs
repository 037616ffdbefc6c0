//! What the numbers of a tile are.

/// What the numbers of a tile are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Mode {
    pub(crate) base: Base,
    pub(crate) colour: Colour,
}

/// What the numbers of red and blue are differences from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Colour {
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
pub(crate) enum Base {
    /// Neighbours in the tile.
    Neighbour,
    /// The reference.
    Reference,
    /// The reference, in the few pixels that are marked; the others are as they were.
    Marked,
}

impl Mode {
    /// What all tiles of a message without modes have.
    pub(crate) const USUAL: Self = Self {
        base: Base::Neighbour,
        colour: Colour::Green,
    };

    pub(crate) fn number(self) -> u8 {
        3 * self.base as u8 + self.colour as u8
    }

    pub(crate) fn of(number: u8) -> Result<Self, String> {
        let bases = [Base::Neighbour, Base::Reference, Base::Marked];
        let colours = [Colour::Green, Colour::Alone, Colour::Ratio];
        let base = bases.get(usize::from(number / 3));
        let base = *base.ok_or_else(|| format!("there is no mode {number}"))?;
        let colour = colours[usize::from(number % 3)];
        Ok(Self { base, colour })
    }
}
