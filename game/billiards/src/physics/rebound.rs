//! The least speed at which a ball leaves what it has touched.

use glam::DVec3;

/// Approach to a cushion below this speed ends in a rebound at this speed at least, so that a ball
/// that its spin or weight presses against it bounces a bounded number of times per second. It adds
/// at most ½ m (5 mm/s)², about 2 µJ ([`REBOUND_ENERGY_J`]).
pub const REBOUND_SPEED_M_S: f64 = 5e-3;

/// The most energy that [`REBOUND_SPEED_M_S`] can add to one contact of a pool ball.
pub const REBOUND_ENERGY_J: f64 = 0.5 * 0.170_097 * 5e-3 * 5e-3;

/// Velocity after a contact, parting from it along `away` at [`REBOUND_SPEED_M_S`] at least if it
/// came slower than that, and in any case not going on into it.
pub(crate) fn kept_apart(away: DVec3, before: DVec3, after: DVec3) -> DVec3 {
    let least = if -before.dot(away) < REBOUND_SPEED_M_S {
        REBOUND_SPEED_M_S
    } else {
        0.0
    };
    after + (least - after.dot(away)).max(0.0) * away
}
