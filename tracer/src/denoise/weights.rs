//! Taps and weights of the filter's passes, of CPU and GPU alike.

/// One pass: how far apart its taps are, and what they weigh.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PassWeights {
    /// Pixels between taps.
    pub(crate) step: i32,
    /// Weights of the four taps beside the middle one, and of the four at the corners; the middle one has 1.
    pub(crate) side: f32,
    pub(crate) corner: f32,
    /// A neighbour's distance is the sum of these factors times squared differences; from 1 on it does
    /// not count.
    pub(crate) normal: f32,
    pub(crate) albedo: f32,
    /// Of the difference of inverse depths relative to the pixel's own.
    pub(crate) depth: f32,
}

/// The passes in their order. Their numbers and those of [`variances`] are a minimum of FLIP, and of a seventh as much of relMSE,
/// over two views of the game's room of 1, 2, 4, 16 and 64 samples: gradient descent (Kingma and Ba, "Adam: A Method for Stochastic
/// Optimization", ICLR 2015) through a copy of the filter and the metric. The first pass, whose light is noise, goes by
/// where pixels lie, the later ones by what they show.
pub(crate) const PASSES: [PassWeights; 3] = [
    PassWeights {
        step: 1,
        side: 0.55,
        corner: 0.19,
        normal: 3.7,
        albedo: 35.0,
        depth: 0.29,
    },
    PassWeights {
        step: 2,
        side: 0.98,
        corner: 0.34,
        normal: 16.6,
        albedo: 96.0,
        depth: 47.0,
    },
    PassWeights {
        step: 4,
        side: 1.03,
        corner: 1.02,
        normal: 95.0,
        albedo: 59.0,
        depth: 149.0,
    },
];

impl PassWeights {
    /// The weight of one of [`NEIGHBOURS`] as a tap.
    pub(crate) const fn tap(&self, (dx, dy): (i32, i32)) -> f32 {
        if dx * dy == 0 { self.side } else { self.corner }
    }
}

/// The eight pixels around one.
pub(crate) const NEIGHBOURS: [(i32, i32); 8] = [
    (-1, -1),
    (0, -1),
    (1, -1),
    (-1, 0),
    (1, 0),
    (-1, 1),
    (0, 1),
    (1, 1),
];

/// Added to the albedo by which light is divided: what is black has light too, from its coat.
pub(crate) const ALBEDO_MIN: f32 = 0.02;

/// A neighbour's albedo and half its normal differ by more than this, squared, or its emission by more
/// than this share, where more rays are needed for a smooth edge.
pub(crate) const EDGE_MIN: f32 = 1e-3;
pub(crate) const BRIGHTNESS_SHARE: f32 = 0.05;

/// Where the first hits of more rays differ less than this, squared, from a pixel's own, its light
/// is not mixed.
pub(crate) const MIXED_MIN: f32 = 1e-6;

/// Variances by which light may differ in the pass of that index.
pub(crate) fn variances(samples: u32, pass: usize) -> f32 {
    match samples {
        // Of single samples only the scatter among neighbours is known, which says less.
        1 => [4600.0, 44.0, 29.0][pass],
        // Of few it is a bad estimate, and a dot in one half is all of it.
        2..=4 => [140.0, 19.0, 21.0][pass],
        5..=64 => [55.0, 47.0, 8.0][pass],
        // The halves of a Sobol sequence complement each other: the more samples, the less noise
        // their mean has than their difference tells, until nothing should be smoothed.
        _ => variances(64, pass) * (64.0 / samples as f32).powi(2),
    }
}

/// How far the means of two halves of `samples` are apart for the variance of the whole: of n
/// samples the mean is a part from that of the first m, the two halves n/(n−m) times as far.
pub(crate) fn half_ratio(samples: u32) -> f32 {
    0.5 * samples as f32 / (samples - samples / 2) as f32
}
