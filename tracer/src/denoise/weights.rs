//! Taps and weights of the filter's passes: the same numbers in Rust and, as text, in WGSL.

/// Pixels between the taps of each pass. Two passes of the eight taps nearest leave less error than
/// three of twelve with steps of 1, 2 and 4, for less than half the work and half the guard band.
pub(crate) const STEPS: [i32; 2] = [1, 3];

/// Offsets in steps and weights, a Gaussian of 1.5 steps, of the taps but the middle one.
pub(crate) const TAPS: [(i32, i32, f32); 8] = [
    (-1, -1, 0.641),
    (0, -1, 0.801),
    (1, -1, 0.641),
    (-1, 0, 0.801),
    (1, 0, 0.801),
    (-1, 1, 0.641),
    (0, 1, 0.801),
    (1, 1, 0.641),
];

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

/// A neighbour's distance is the sum of these factors times squared differences; from 1 on it does
/// not count. PrevVertex by search over pictures of the pool scene of 1 to 64 samples.
pub(crate) const NORMAL_FACTOR: f32 = 3.0;
pub(crate) const ALBEDO_FACTOR: f32 = 10.0;
/// Of the difference of inverse depths relative to the pixel's own.
pub(crate) const DEPTH_FACTOR: f32 = 1.0;

/// A neighbour's albedo and half its normal differ by more than this, squared, or its emission by more
/// than this share, where more rays are needed for a smooth edge.
pub(crate) const EDGE_MIN: f32 = 1e-4;
pub(crate) const BRIGHTNESS_SHARE: f32 = 0.05;

/// Where the first hits of more rays differ less than this, squared, from a pixel's own, its light
/// is not mixed.
pub(crate) const MIXED_MIN: f32 = 1e-6;

/// Variances by which light may differ in the pass of that index.
pub(crate) fn variances(samples: u32, pass: usize) -> f32 {
    match samples {
        // Of single samples only the scatter among neighbours is known, which says less.
        1 => [128.0, 24.0][pass],
        // Of few it is a bad estimate, and a dot in one half is all of it.
        2..=4 => [48.0, 24.0][pass],
        5..=64 => [24.0, 12.0][pass],
        // The halves of a Sobol sequence complement each other: the more samples, the less noise
        // their mean has than their difference tells, until nothing should be smoothed.
        _ => [24.0, 12.0][pass] * (64.0 / samples as f32).powi(2),
    }
}

/// How far the means of two halves of `samples` are apart for the variance of the whole: of n
/// samples the mean is a part from that of the first m, the two halves n/(n−m) times as far.
pub(crate) fn half_ratio(samples: u32) -> f32 {
    0.5 * samples as f32 / (samples - samples / 2) as f32
}
