//! The minimum speed at which a ball leaves an obstacle.

use glam::DVec3;

/// Minimum speed in m/s after an approach to a cushion that is slower than it, so that a ball that its
/// spin or weight presses against the cushion bounces a bounded number of times per second. It adds at
/// most ½ m (5 mm/s)², about 2 µJ ([`REBOUND_ENERGY_J`]).
pub const REBOUND_SPEED_M_S: f64 = 5e-3;

/// The most energy that [`REBOUND_SPEED_M_S`] can add to one contact of a pool ball.
pub const REBOUND_ENERGY_J: f64 = 0.5 * 0.170_097 * 5e-3 * 5e-3;

/// Velocity after a contact, away from it along `away` at [`REBOUND_SPEED_M_S`] at least if the
/// approach was slower than that, and in any case not into it.
pub(crate) fn kept_apart(away: DVec3, before: DVec3, after: DVec3) -> DVec3 {
    let least = if -before.dot(away) < REBOUND_SPEED_M_S {
        REBOUND_SPEED_M_S
    } else {
        0.0
    };
    after + (least - after.dot(away)).max(0.0) * away
}

/// Velocity of a ball wedged between two surfaces that push it along opposed `aways`. The component
/// tangential to both is kept, so that a ball can roll out between them. Between vertical surfaces it
/// keeps its vertical velocity only; otherwise it hops away from both at [`REBOUND_SPEED_M_S`].
pub(crate) fn wedged(aways: [DVec3; 2], after: DVec3) -> DVec3 {
    let [one, other] = aways;
    if one.z == 0.0 && other.z == 0.0 {
        return after.z * DVec3::Z;
    }
    let along = one.cross(other).normalize_or_zero();
    let out = (one + other).normalize_or_zero();
    after.dot(along) * along + REBOUND_SPEED_M_S * out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wedged_ball_leaves_both_surfaces_and_keeps_its_way_along_them() {
        let edge = DVec3::new(0.6, 0.8, 0.0);
        for rise in [0.01, 0.3, 0.8] {
            let level = (1.0f64 - rise * rise).sqrt();
            for turn in [-2.5f64, -1.7, 1.7, 2.5, 3.1] {
                let bed =
                    (level * edge.truncate().rotate(glam::DVec2::from_angle(turn))).extend(rise);
                let along = edge.cross(bed).normalize();
                let before = DVec3::new(-0.2, -0.3, 0.01);
                let after = wedged([bed, edge], before);
                assert!(after.dot(edge) > 0.0 && after.dot(bed) > 0.0, "{after}");
                assert!((after - before).dot(along).abs() < 1e-15);
                let gained = after.length_squared() - before.length_squared();
                assert!(gained <= REBOUND_SPEED_M_S.powi(2));
            }
        }
    }

    #[test]
    fn between_upright_surfaces_a_ball_falls() {
        let walls = [DVec3::X, DVec3::new(-0.8, 0.6, 0.0)];
        assert_eq!(wedged(walls, DVec3::splat(-0.4)), DVec3::Z * -0.4);
    }
}
