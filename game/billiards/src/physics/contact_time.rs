//! Contact times: the first instants at which a distance, a polynomial in time, falls to zero.
//!
//! Within one phase every ball moves with constant acceleration, so the squared distance of two
//! balls, or of a ball and a jaw or pocket, is a quartic in time and the distance to a straight
//! cushion a quadratic. The roots are bracketed between the extrema of the polynomial (the roots of
//! its derivative, found likewise), where it is monotone, and refined to the last bit by Newton
//! steps that bisection keeps inside the bracket: no root is missed between brackets and none is
//! invented by cancellation, as closed formulas for quartics do near grazing contacts.

use glam::{DVec2, DVec3};

use super::{motion::Motion, table::Nose};

/// A polynomial of degree 4 at most, lowest power first.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Quartic([f64; 5]);

/// Position, velocity and half the acceleration from a common instant on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct QuadraticPath {
    pub(crate) position: DVec3,
    pub(crate) velocity: DVec3,
    pub(crate) half_acceleration: DVec3,
}

impl QuadraticPath {
    /// The path of a motion, with its time origin `t` after the motion's start.
    pub(crate) fn after(motion: &Motion, t: f64) -> Self {
        Self {
            position: motion.position_at(t),
            velocity: motion.velocity_at(t),
            half_acceleration: 0.5 * motion.acceleration,
        }
    }

    /// The same path with its time origin at `t`.
    pub(crate) fn from(&self, t: f64) -> Self {
        Self {
            position: self.at(t),
            velocity: self.velocity_at(t),
            ..*self
        }
    }

    pub(crate) fn relative_to(&self, other: &Self) -> Self {
        Self {
            position: self.position - other.position,
            velocity: self.velocity - other.velocity,
            half_acceleration: self.half_acceleration - other.half_acceleration,
        }
    }

    /// The horizontal part of the path, relative to a fixed point.
    pub(crate) fn flat_from(&self, point: DVec2) -> Self {
        Self {
            position: (self.position.truncate() - point).extend(0.0),
            velocity: self.velocity.with_z(0.0),
            half_acceleration: self.half_acceleration.with_z(0.0),
        }
    }

    /// The path in the plane across an edge through `point`, along two unit vectors: the first
    /// coordinate is the distance in front of the edge, the second the height above it.
    pub(crate) fn across_edge(&self, point: DVec3, [across, up]: [DVec3; 2]) -> Self {
        self.mapped(point, |v| DVec3::new(across.dot(v), up.dot(v), 0.0))
    }

    /// The path relative to a fixed point, under a linear map.
    pub(crate) fn mapped(&self, point: DVec3, project: impl Fn(DVec3) -> DVec3) -> Self {
        Self {
            position: project(self.position - point),
            velocity: project(self.velocity),
            half_acceleration: project(self.half_acceleration),
        }
    }

    pub(crate) fn at(&self, t: f64) -> DVec3 {
        self.position + t * (self.velocity + t * self.half_acceleration)
    }

    pub(crate) fn velocity_at(&self, t: f64) -> DVec3 {
        self.velocity + 2.0 * t * self.half_acceleration
    }

    /// Whether it can come within `distance` of the origin before `horizon`, by the triangle
    /// inequality: most pairs are rejected here.
    fn can_reach(&self, distance: f64, horizon: f64) -> bool {
        let reach = horizon * (self.velocity.length() + horizon * self.half_acceleration.length());
        self.position.length() <= distance + reach
    }
}

/// First time in [0, `horizon`] at which the path, relative to a point, comes within `distance` of it.
/// Serves ball–ball (relative path, sum of radii), jaws, edges and pockets. A path that is already
/// within and still approaching touches at 0.
pub(crate) fn reaches_point(path: &QuadraticPath, distance: f64, horizon: f64) -> Option<f64> {
    if !path.can_reach(distance, horizon) {
        return None;
    }
    squared_distance(path, distance).first_fall_below_zero(horizon, f64::INFINITY)
}

/// First time in [0, `horizon`] at which the path, relative to a point, reaches `distance` from it
/// outwards, or continues outwards from beyond.
pub(crate) fn leaves_circle(path: &QuadraticPath, distance: f64, horizon: f64) -> Option<f64> {
    let inside = Quartic(squared_distance(path, distance).0.map(|c| -c));
    inside.first_fall_below_zero(horizon, f64::INFINITY)
}

/// Squared distance from the origin less the square of `distance`.
fn squared_distance(path: &QuadraticPath, distance: f64) -> Quartic {
    let QuadraticPath {
        position: p,
        velocity: v,
        half_acceleration: a,
    } = *path;
    let gap = p.length() - distance;
    Quartic([
        // p² − d² factorised: near a contact the two squares agree in nearly all of their digits.
        gap * (p.length() + distance),
        2.0 * p.dot(v),
        v.dot(v) + 2.0 * p.dot(a),
        2.0 * v.dot(a),
        a.dot(a),
    ])
}

/// First time in [0, `horizon`] at which the path comes down to a plane through `point` with the unit
/// `normal`, from above or from within `depth` below it.
pub(crate) fn reaches_plane(
    path: &QuadraticPath,
    (point, normal): (DVec3, DVec3),
    depth: f64,
    horizon: f64,
) -> Option<f64> {
    let distance = Quartic([
        normal.dot(path.position - point),
        normal.dot(path.velocity),
        normal.dot(path.half_acceleration),
        0.0,
        0.0,
    ]);
    distance.first_fall_below_zero(horizon, depth)
}

/// First time in [0, `horizon`] at which a ball touches the straight cushion from its front.
pub(crate) fn reaches_nose(
    path: &QuadraticPath,
    nose: &Nose,
    radius: f64,
    horizon: f64,
) -> Option<f64> {
    // The plane of the centre at contact; the normal is horizontal, so that heights do not count.
    let touching = nose.from() + radius * nose.normal();
    let plane = (touching.extend(0.0), nose.normal().extend(0.0));
    let t = reaches_plane(path, plane, radius, horizon)?;
    nose.spans(path.at(t).truncate()).then_some(t)
}

/// First time in [0, `horizon`] at which the path crosses the outline of the table.
pub(crate) fn leaves_outline(
    path: &QuadraticPath,
    (low, high): (DVec2, DVec2),
    horizon: f64,
) -> Option<f64> {
    let sides = [
        (DVec3::X, low),
        (DVec3::Y, low),
        (DVec3::NEG_X, high),
        (DVec3::NEG_Y, high),
    ];
    let crossings = sides.into_iter().filter_map(|(inward, corner)| {
        // At any depth: a centre beyond the outline that continues outwards leaves at once.
        reaches_plane(path, (corner.extend(0.0), inward), f64::INFINITY, horizon)
    });
    crossings.min_by(f64::total_cmp)
}

/// First time in [0, `horizon`] at which the path enters a rectangle from outside.
pub(crate) fn enters_rectangle(
    path: &QuadraticPath,
    (low, high): (DVec2, DVec2),
    horizon: f64,
) -> Option<f64> {
    let sides = [
        (DVec3::NEG_X, low),
        (DVec3::NEG_Y, low),
        (DVec3::X, high),
        (DVec3::Y, high),
    ];
    let crossings = sides.into_iter().filter_map(|(outward, corner)| {
        // No depth: a ball that lies in the rectangle does not enter it again.
        let t = reaches_plane(path, (corner.extend(0.0), outward), 0.0, horizon)?;
        let place = path.at(t).truncate();
        let inside = place.cmpge(low - JOINT_M).all() && place.cmple(high + JOINT_M).all();
        inside.then_some(t)
    });
    crossings.min_by(f64::total_cmp)
}

/// First time in [0, `horizon`] at which the path comes within `distance` of a horizontal circle.
///
/// The distance to a circle is no polynomial of low degree. Conservative advancement: each step ends
/// where the distance cannot have fallen to the bound yet. Its second derivative is bounded below by
/// the acceleration and by the curvature of the circle, so that steps grow with the gap and the last
/// ones converge as Newton's do.
pub(crate) fn reaches_ring(
    path: &QuadraticPath,
    (center, ring_radius): (DVec3, f64),
    distance: f64,
    horizon: f64,
) -> Option<f64> {
    let mut t = 0.0;
    for _ in 0..RING_STEPS_MAX {
        let seen = path.at(t) - center;
        let velocity = path.velocity_at(t);
        let from_axis = seen.truncate().length();
        // In the half-plane of the axis and the ball the ring is a point.
        let offset = DVec2::new(from_axis - ring_radius, seen.z);
        let gap = offset.length() - distance;
        let outward = seen.truncate().normalize_or_zero();
        let closing = -(offset.x * outward.dot(velocity.truncate()) + offset.y * velocity.z)
            / offset.length().max(f64::MIN_POSITIVE);
        if gap <= RING_TOUCH_M && closing > 0.0 {
            return Some(t);
        }
        let speed = velocity.length() + 2.0 * path.half_acceleration.length() * RING_STEP_SECS;
        // The distance from anything changes no faster than the ball moves.
        let by_speed = gap.max(0.0) / speed.max(f64::MIN_POSITIVE);
        // As long as the distance from the axis stays above half of its present value, `curving` bounds
        // the distance's second derivative.
        let calm = (0.5 * from_axis / speed.max(f64::MIN_POSITIVE)).min(RING_STEP_SECS);
        let curving = 2.0 * path.half_acceleration.length()
            + 2.0 * speed * speed / from_axis.max(f64::MIN_POSITIVE);
        let root = (2.0 * gap.max(0.0) * curving + closing * closing).sqrt();
        let by_curve = if closing > 0.0 {
            // The first root of gap − closing·t − ½·curving·t², in the form that does not cancel for this
            // sign of `closing`.
            2.0 * gap.max(0.0) / (root + closing)
        } else {
            (root - closing) / curving
        };
        let step = by_speed.min(RING_STEP_SECS).max(by_curve.min(calm));
        // The search has to leave a contact that separates again, but must not pass one that
        // approaches.
        let least = if gap <= RING_TOUCH_M {
            RING_STEP_LEAST_SECS
        } else {
            f64::EPSILON
        };
        t += step.max(least);
        if t > horizon {
            return None;
        }
    }
    None
}

impl Quartic {
    fn at(&self, t: f64) -> f64 {
        self.0.iter().rev().fold(0.0, |sum, c| sum * t + c)
    }

    fn derivative(&self) -> Self {
        let c = &self.0;
        Self([c[1], 2.0 * c[2], 3.0 * c[3], 4.0 * c[4], 0.0])
    }

    fn degree(&self) -> usize {
        self.0.iter().rposition(|&c| c != 0.0).unwrap_or(0)
    }

    /// The first time in [0, end] at which the polynomial falls below zero. Where it is already
    /// below but by no more than `depth`, and falling, that is at once: a contact that round-off
    /// placed a little inside must not be missed.
    fn first_fall_below_zero(&self, end: f64, depth: f64) -> Option<f64> {
        // Each derivative has one degree less, so that the recursion ends at a straight line after
        // three.
        let extrema = self.derivative().roots(end);
        let mut start = (0.0, self.at(0.0));
        for &t in extrema.as_slice().iter().chain([&end]) {
            let stop = (t, self.at(t));
            // Monotone between extrema: it falls through zero here if the ends have opposite signs.
            if stop.1 < start.1 && stop.1 < 0.0 {
                if start.1 > 0.0 {
                    return Some(self.refine(start, stop));
                }
                // It began at or slightly below zero: a contact, unless it rises first and separates.
                if start.1 >= -depth {
                    return Some(start.0);
                }
            }
            start = stop;
        }
        None
    }

    /// All roots in (0, end) at which the sign changes, ascending.
    fn roots(&self, end: f64) -> Roots {
        let mut roots = Roots::default();
        match self.degree() {
            0 => return roots,
            1 => {
                roots.push_within(-self.0[0] / self.0[1], end);
                return roots;
            }
            _ => {}
        }
        let extrema = self.derivative().roots(end);
        let mut start = (0.0, self.at(0.0));
        for &t in extrema.as_slice().iter().chain([&end]) {
            let stop = (t, self.at(t));
            if (start.1 < 0.0) != (stop.1 < 0.0) {
                roots.push_within(self.refine(start, stop), end);
            }
            start = stop;
        }
        roots
    }

    /// The root between two points of opposite sign, where the polynomial is monotone.
    fn refine(&self, start: (f64, f64), stop: (f64, f64)) -> f64 {
        let slope = self.derivative();
        let falls = start.1 > stop.1;
        let (mut low, mut high) = (start.0, stop.0);
        // Starts where the chord crosses zero; the clamp is for differences that round to 0.
        let mut t = low + (high - low) * (start.1 / (start.1 - stop.1)).clamp(0.0, 1.0);
        for _ in 0..REFINEMENTS_MAX {
            let value = self.at(t);
            if (value > 0.0) == falls {
                low = t;
            } else {
                high = t;
            }
            // Newton's step, but never out of the bracket: next to a double root it would jump to
            // another root or to infinity (Press et al., Numerical Recipes, `rtsafe`).
            let newton = t - value / slope.at(t);
            let next = if newton > low && newton < high {
                newton
            } else {
                0.5 * (low + high)
            };
            if next == t || next <= low || next >= high {
                return next;
            }
            let step = (next - t).abs();
            t = next;
            if step <= f64::EPSILON * t {
                return t;
            }
        }
        t
    }
}

/// Up to four roots, without allocation.
#[derive(Clone, Copy, Debug, Default)]
struct Roots {
    times: [f64; 4],
    count: usize,
}

impl Roots {
    fn push_within(&mut self, t: f64, end: f64) {
        if t > 0.0 && t < end && self.count < self.times.len() {
            self.times[self.count] = t;
            self.count += 1;
        }
    }

    fn as_slice(&self) -> &[f64] {
        &self.times[..self.count]
    }
}

/// Bisection alone halves any bracket of the simulation to one bit in fewer steps.
const REFINEMENTS_MAX: u32 = 128;

/// The unit vector from one point to another; +x where they coincide.
pub(crate) fn direction(from: DVec3, to: DVec3) -> DVec3 {
    (to - from).try_normalize().unwrap_or(DVec3::X)
}

/// Tolerance in m for round-off at a boundary.
const JOINT_M: f64 = 1e-6;
/// Gap in m below which a ring is touched.
pub(crate) const RING_TOUCH_M: f64 = 1e-11;
/// Longest step along a path near a ring.
const RING_STEP_SECS: f64 = 0.02;
/// Shortest step out of a contact: in it a ball sinks into the ring by less than [`RING_TOUCH_M`].
pub(crate) const RING_STEP_LEAST_SECS: f64 = 1e-7;
/// Maximum steps near a grazed ring: as many of the longest steps are 80 s.
pub(crate) const RING_STEPS_MAX: u32 = 4096;

#[cfg(test)]
mod tests {
    use super::*;

    fn path(position: [f64; 2], velocity: [f64; 2], acceleration: [f64; 2]) -> QuadraticPath {
        QuadraticPath {
            position: DVec2::from(position).extend(0.0),
            velocity: DVec2::from(velocity).extend(0.0),
            half_acceleration: 0.5 * DVec2::from(acceleration).extend(0.0),
        }
    }

    #[test]
    fn all_four_roots_are_found_also_when_close() {
        for gap in [1e-3, 1e-6] {
            let r = [0.5, 0.5 + gap, 1.5, 2.0];
            let e1 = r.iter().sum::<f64>();
            let e4 = r.iter().product::<f64>();
            let mut e2 = 0.0;
            let mut e3 = 0.0;
            for i in 0..4 {
                for j in 0..i {
                    e2 += r[i] * r[j];
                    for k in 0..j {
                        e3 += r[i] * r[j] * r[k];
                    }
                }
            }
            let found = Quartic([e4, -e3, e2, -e1, 1.0]).roots(3.0);
            assert_eq!(found.count, 4, "gap {gap}: {found:?}");
            for (a, b) in found.as_slice().iter().zip(r) {
                assert!((a - b).abs() < 1e-9 / gap.sqrt(), "{a} {b}");
            }
        }
    }

    #[test]
    fn contact_is_on_the_circle_and_first() {
        let way = path([1.0, 0.02], [-2.0, 0.05], [0.3, -0.4]);
        let t = reaches_point(&way, 0.06, 3.0).expect("it comes near");
        // One bit of a squared distance of 1 m², over twice the distance of contact.
        assert!((way.at(t).length() - 0.06).abs() < 1e-14);
        for step in 0..1000 {
            assert!(way.at(t * f64::from(step) / 1000.0).length() > 0.06);
        }
    }

    #[test]
    fn a_graze_by_a_nanometre_is_decided_rightly() {
        let touch = path([1.0, 0.06 - 1e-9], [-1.0, 0.0], [0.0; 2]);
        let miss = path([1.0, 0.06 + 1e-9], [-1.0, 0.0], [0.0; 2]);
        assert!(reaches_point(&touch, 0.06, 3.0).is_some());
        assert!(reaches_point(&miss, 0.06, 3.0).is_none());
    }

    #[test]
    fn balls_in_touch_meet_again_only_when_they_come_back() {
        let parting = path([0.06, 0.0], [0.1, 0.0], [-1.0, 0.0]);
        let t = reaches_point(&parting, 0.06, 3.0).expect("they come back");
        assert!((t - 0.2).abs() < 1e-12);
        let pressed = path([0.06, 0.0], [0.0, 0.0], [-1.0, 0.0]);
        assert_eq!(reaches_point(&pressed, 0.06, 3.0), Some(0.0));
        let apart = path([0.06, 0.0], [0.1, 0.0], [0.0, 0.0]);
        assert_eq!(reaches_point(&apart, 0.06, 3.0), None);
    }
}
