//! Contact with a rounded jaw: a vertical cylinder cut off by its cushion's sloping top and by the
//! plane of the flat rail behind. The solid is convex, so that the second derivative of a ball's
//! distance from it is never below minus the ball's acceleration: [`JawSolid::reached`] relies on that.

use glam::{DVec2, DVec3};

use super::{
    clipped_contact::Crossings,
    contact_time::{QuadraticPath, RING_STEP_LEAST_SECS, RING_STEPS_MAX, RING_TOUCH_M},
    table::{Circle, JOINT_SLACK_M, Table},
};

/// The solid of a jaw below its two top planes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JawSolid {
    circle: Circle,
    /// Sloping top and flat top.
    tops: [TopPlane; 2],
}

/// A top plane: height over the circle's centre, and gradient.
#[derive(Clone, Copy, Debug)]
struct TopPlane {
    height_m: f64,
    slope: DVec2,
}

impl JawSolid {
    /// The solid of a table's jaw.
    pub(crate) fn of(table: &Table, index: usize) -> Self {
        let (circle, slope) = (table.jaws()[index], table.jaw_slopes()[index]);
        // The circle touches the nose line, where the top begins to rise, so that its centre is one
        // radius further up the slope.
        let height_m = table.nose_height_m() + circle.radius_m * slope.length();
        let flat = TopPlane {
            height_m: table.rail_height_m(),
            slope: DVec2::ZERO,
        };
        Self {
            circle,
            tops: [TopPlane { height_m, slope }, flat],
        }
    }

    /// Nearest point of the solid to a place outside, and whether it lies on a top face, not on an edge
    /// or the side. It is the farther of the nearest points of the two cylinders with one top each;
    /// where both tops meet at the edge this is inexact, and a ball can sink in by angle²/8 radii, 0.1
    /// mm.
    pub(crate) fn nearest(&self, place: DVec3) -> (DVec3, bool) {
        let [sloping, flat] = self.tops.map(|top| top.nearest(self.circle, place));
        if flat.0.distance_squared(place) > sloping.0.distance_squared(place) {
            flat
        } else {
            sloping
        }
    }

    /// First time in [0, `horizon`] at which a path comes within `distance` of it.
    ///
    /// Conservative advancement: each step ends where the distance cannot have fallen to the bound yet.
    /// The last steps converge quadratically, as Newton's do.
    pub(crate) fn reached(&self, path: &QuadraticPath, distance: f64, horizon: f64) -> Option<f64> {
        let acceleration = (2.0 * path.half_acceleration.length()).max(f64::MIN_POSITIVE);
        let reach = distance + horizon * (path.velocity.length() + 0.5 * horizon * acceleration);
        if path.position.distance(self.nearest(path.position).0) > reach {
            return None;
        }
        let mut t = 0.0;
        for _ in 0..RING_STEPS_MAX {
            let place = path.at(t);
            let out = place - self.nearest(place).0;
            let gap = out.length() - distance;
            let closing = -out.normalize_or_zero().dot(path.velocity_at(t));
            if gap <= RING_TOUCH_M && closing > 0.0 {
                return Some(t);
            }
            let gap = gap.max(0.0);
            // The second derivative of the distance to a convex body is at least −acceleration: the
            // distance reaches the bound no earlier than gap − closing·t − ½·acceleration·t² does. The
            // root is taken in the form that does not cancel for the sign of `closing`.
            let root = (2.0 * gap * acceleration + closing * closing).sqrt();
            let (step, least) = if closing > 0.0 {
                (2.0 * gap / (root + closing), f64::EPSILON)
            } else {
                ((root - closing) / acceleration, RING_STEP_LEAST_SECS)
            };
            t += step.max(least);
            if t > horizon {
                return None;
            }
        }
        None
    }

    /// Adds the times at which the nearest point may change between a top face and its edge.
    pub(crate) fn borders(&self, crossings: &mut Crossings) {
        let Circle { center, radius_m } = self.circle;
        for top in self.tops {
            let seen = |path: &QuadraticPath| {
                let foot = |v| top.foot(v).extend(0.0);
                path.mapped(center.extend(top.height_m), foot)
            };
            crossings.around(seen, radius_m);
        }
    }
}

impl TopPlane {
    /// Nearest point of the cylinder below this plane, and whether it lies on the plane.
    fn nearest(&self, circle: Circle, place: DVec3) -> (DVec3, bool) {
        let axis = circle.center.extend(self.height_m);
        let (seen, radius) = (place - axis, circle.radius_m);
        let from_axis = seen.truncate().length();
        let out = seen.truncate().normalize_or(DVec2::X);
        let side = radius * out;
        // Beside the cylinder and below the top's edge there: on the side.
        if from_axis >= radius && seen.z <= self.slope.dot(side) {
            return (axis + side.extend(seen.z), false);
        }
        // Over the top's ellipse: on its face; otherwise on its edge.
        let foot = self.foot(seen);
        if foot.length() < radius - JOINT_SLACK_M {
            let height = self.slope.dot(foot).min(seen.z);
            return (axis + foot.extend(height), true);
        }
        let edge = radius * self.edge_towards(seen, (foot.normalize_or(out), radius));
        (axis + edge.extend(self.slope.dot(edge)), false)
    }

    /// Horizontal coordinates of the orthogonal projection onto the plane, relative to the axis as
    /// `seen` is.
    fn foot(&self, seen: DVec3) -> DVec2 {
        let over = seen.z - self.slope.dot(seen.truncate());
        seen.truncate() + over / (1.0 + self.slope.length_squared()) * self.slope
    }

    /// Direction from the axis to the nearest point of the edge, an ellipse: Newton's method from a
    /// nearby direction.
    fn edge_towards(&self, seen: DVec3, (mut out, radius): (DVec2, f64)) -> DVec2 {
        for _ in 0..NEWTON_STEPS_MAX {
            let along = out.perp();
            let below = radius * self.slope.dot(out) - seen.z;
            let (climb, rise) = (self.slope.dot(along), self.slope.dot(out));
            // First and second derivative of half the squared distance by the angle, both over the
            // radius.
            let tangent = below * climb - seen.truncate().dot(along);
            let bend = seen.truncate().dot(out) + radius * climb * climb - below * rise;
            let turn = tangent / bend;
            if !(turn.is_finite() && turn.abs() > TURN_LEAST_RAD) {
                break;
            }
            out = (out - turn * along).normalize();
        }
        out
    }
}

/// Each step doubles the digits, from a start that is right to second order in the slope.
const NEWTON_STEPS_MAX: u32 = 8;
/// Smallest Newton step: the error of the distance is quadratic in that of the angle.
const TURN_LEAST_RAD: f64 = 1e-10;

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    /// Distance of a place from sample points all over the surface.
    fn sampled_distance(solid: &JawSolid, place: DVec3) -> f64 {
        let Circle { center, radius_m } = solid.circle;
        let height = |at: DVec2| {
            let tops = solid.tops.map(|top| top.height_m + top.slope.dot(at));
            tops[0].min(tops[1])
        };
        let mut least = f64::INFINITY;
        for turn in 0..20_000 {
            let out = DVec2::from_angle(f64::from(turn) * std::f64::consts::TAU / 20_000.0);
            let side = radius_m * out;
            let point = (center + side).extend(height(side).min(place.z));
            least = least.min(place.distance(point));
        }
        least
    }

    #[test]
    fn the_nearest_point_is_the_nearest() {
        let table = Table::built_in("snooker").unwrap();
        let solid = JawSolid::of(&table, 0);
        let Circle { center, radius_m } = solid.circle;
        let mut edges = 0;
        for step in 0..400 {
            let out = DVec2::from_angle(0.37 * f64::from(step));
            let away = radius_m + 0.01 + 0.0001 * f64::from(step);
            let height = table.nose_height_m() + 0.03 * (0.61 * f64::from(step)).sin();
            let place = (center + away * out).extend(height);
            let (nearest, on_top) = solid.nearest(place);
            let is_corner = solid.tops[1].slope == DVec2::ZERO && {
                let edge = nearest.truncate() - center;
                let over = solid.tops.map(|top| top.height_m + top.slope.dot(edge));
                (over[0] - over[1]).abs() < 0.006
            };
            let error = place.distance(nearest) - sampled_distance(&solid, place);
            assert!(!on_top && error < 1e-9, "{place}: {error}");
            let allowed = if is_corner { 2e-4 } else { 1e-6 };
            assert!(error > -allowed, "{place}: {error}");
            edges += u32::from(nearest.z < height);
        }
        assert!(edges > 100);
    }

    #[test]
    fn contact_is_at_a_distance_of_one_radius() {
        let table = Table::nine_foot();
        let solid = JawSolid::of(&table, 1);
        let above = table.nose_height_m() + 0.05;
        for step in 0..200 {
            let out = DVec2::from_angle(0.1 * f64::from(step));
            let side = 0.001 * f64::from(step % 30);
            let path = QuadraticPath {
                position: (solid.circle.center + 0.2 * out + side * out.perp()).extend(above),
                velocity: (-2.0 * out).extend(-0.3),
                half_acceleration: DVec3::new(0.0, 0.0, -4.905),
            };
            let gap = |t: f64| {
                let place = path.at(t);
                place.distance(solid.nearest(place).0) - 0.028
            };
            let end = solid.reached(&path, 0.028, 0.1);
            if let Some(t) = end {
                assert!(gap(t).abs() < 1e-10, "{step}: {}", gap(t));
            }
            let before = end.unwrap_or(0.1);
            for part in 0..200 {
                let t = before * f64::from(part) / 200.0;
                assert!(gap(t) > 0.0, "{step}: in it at {t} before {before}");
            }
        }
    }
}
