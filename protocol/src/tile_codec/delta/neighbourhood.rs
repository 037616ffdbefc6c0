//! Neighbourhood of a changed pixel, from which its value is predicted.

/// A pixel's red, green and blue from the lowest byte up: one register instead of three.
#[derive(Clone, Copy)]
pub(crate) struct PackedPixel(u32);

impl PackedPixel {
    #[inline(always)]
    fn new([r, g, b]: [u8; 3]) -> Self {
        Self(u32::from_le_bytes([r, g, b, 0]))
    }

    #[inline(always)]
    pub(crate) fn green(self) -> u8 {
        (self.0 >> 8) as u8
    }
}

/// The reference's pixel and the causal neighbours, which a decoder has already. A neighbour beyond the
/// edge of the tile is replaced by the reference's pixel.
pub(crate) struct Neighbourhood {
    pub(crate) reference: PackedPixel,
    pub(crate) left: PackedPixel,
    pub(crate) above: PackedPixel,
    above_right: PackedPixel,
}

impl Neighbourhood {
    /// The neighbourhood of the pixel `index` in column `x`. `levels` holds new pixels before `index`, and
    /// the reference's from it on.
    #[inline(always)]
    pub(crate) fn new(levels: &[[u8; 3]], index: usize, x: usize, width: usize) -> Self {
        let reference = PackedPixel::new(levels[index]);
        let has_above = index >= width;
        let or_reference = |exists: bool, index: usize| match exists {
            true => PackedPixel::new(levels[index]),
            false => reference,
        };
        Self {
            reference,
            left: or_reference(x > 0, index.wrapping_sub(1)),
            above: or_reference(has_above, index.wrapping_sub(width)),
            above_right: or_reference(has_above && x + 1 < width, (index + 1).wrapping_sub(width)),
        }
    }

    /// The pixel whose green is nearest to `green`, and the distance.
    #[inline(always)]
    pub(crate) fn nearest(&self, green: u8) -> ([u8; 3], u8) {
        let pixels = [self.reference, self.left, self.above, self.above_right];
        // The minimum of keys that hold distance, order and pixel in one integer: comparisons with branches
        // are mispredicted on noise, and one misprediction costs more than all of this.
        let key = |(pixel, order): (PackedPixel, u64)| {
            let distance = u64::from(pixel.green().abs_diff(green));
            // The order breaks ties by position, so that they do not depend on red and blue.
            distance << 32 | order << 24 | u64::from(pixel.0)
        };
        let keys = pixels.into_iter().zip(0..).map(key);
        let [r, g, b, _, distance, ..] = keys.min().unwrap_or(0).to_le_bytes();
        ([r, g, b], distance)
    }
}
