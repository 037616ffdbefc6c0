//! The measured quantities of one break.

use glam::DVec3;

/// The outcome of one break.
#[derive(Clone, Copy, Debug)]
pub(super) struct BreakOutcome {
    pub(super) energy_kept: f64,
    pub(super) spread_m: f64,
    pub(super) pocketed: f64,
}

/// Root mean square distance of the balls from their centroid.
pub(super) fn spread_m(positions: &[DVec3]) -> f64 {
    let count = positions.len().max(1) as f64;
    let middle = positions.iter().sum::<DVec3>() / count;
    let square = positions
        .iter()
        .map(|p| p.distance_squared(middle))
        .sum::<f64>();
    (square / count).sqrt()
}
