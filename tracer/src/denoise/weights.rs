//! Taps and weights of the filter's passes, shared by CPU and GPU.

/// Parameters of one pass: distance and weights of its taps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PassWeights {
    /// Pixels between taps.
    pub(crate) step: i32,
    /// Weights of the four taps at the sides and of the four at the corners, relative to 1 for the
    /// centre.
    pub(crate) side: f32,
    pub(crate) corner: f32,
    /// Factors of squared differences, whose sum is a tap's distance; taps at a distance of 1 or
    /// more have no weight.
    pub(crate) normal: f32,
    pub(crate) albedo: f32,
    /// Factor for the difference of inverse depths, relative to the pixel's own inverse depth.
    pub(crate) depth: f32,
}

/// The passes in their order. These numbers and those of [`variances`] minimise FLIP plus a seventh
/// of relMSE over two views of the game's room at 1, 2, 4, 16 and 64 samples. They were found by
/// gradient descent through a copy of the filter and the metric (Kingma and Ba, "Adam: A Method for
/// Stochastic Optimization", ICLR 2015). The first pass, in which light is mostly noise, weights
/// taps mainly by their position, the later ones by their features.
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
    /// The spatial weight of the tap at one of the offsets [`NEIGHBOURS`].
    pub(crate) const fn tap(&self, (dx, dy): (i32, i32)) -> f32 {
        if dx * dy == 0 { self.side } else { self.corner }
    }
}

/// Offsets of the eight pixels around a pixel.
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

/// Added to the albedo that light is divided by, as black surfaces reflect light too, from their
/// coat.
pub(crate) const ALBEDO_MIN: f32 = 0.02;

/// Thresholds of an edge between two pixels, which needs further rays: on the squared difference of
/// albedo and half the normal, and on the difference of emission relative to the brighter one.
pub(crate) const EDGE_MIN: f32 = 1e-3;
pub(crate) const BRIGHTNESS_SHARE: f32 = 0.05;

/// Squared difference between the appearance of the further rays' hits and the pixel's own (scaled
/// by the rays' share) up to which its light is not mixed.
pub(crate) const MIXED_MIN: f32 = 1e-6;

/// Factor of the variance in the distance of light, in the pass with index `pass`.
pub(crate) fn variances(samples: u32, pass: usize) -> f32 {
    match samples {
        // From single samples only the scatter among neighbouring pixels is known, which says less.
        1 => [4600.0, 44.0, 29.0][pass],
        // From few samples the estimate is poor: an outlier in one half dominates it.
        2..=4 => [140.0, 19.0, 21.0][pass],
        5..=64 => [55.0, 47.0, 8.0][pass],
        // The two halves of a Sobol sequence complement each other: the more samples, the less
        // noise their mean has than their difference suggests, until nothing should be smoothed.
        _ => variances(64, pass) * (64.0 / samples as f32).powi(2),
    }
}

/// Factor from the difference between the mean of the first m = ⌊n/2⌋ samples and the mean of all n
/// to the standard error of the latter. The difference of the two halves' means is n/(n−m) times as
/// large, and half of it estimates the standard error.
pub(crate) fn half_ratio(samples: u32) -> f32 {
    0.5 * samples as f32 / (samples - samples / 2) as f32
}
