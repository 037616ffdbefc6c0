//! Boxes with subtracted solids (constructive solid geometry).
//!
//! A ray enters the box, and leaves in turn each subtraction that it is inside of; where it is inside none,
//! it has hit the body. A point counts as inside a subtraction if it is closer to it than a margin, so that
//! a ray that leaves a subtraction's surface does not hit that surface again by rounding.

use glam::{DVec2, DVec3, Vec3Swizzles as _};

use super::ray::{Ray, vector};
use crate::CompiledScene;
use crate::compiled::{
    CSG_FACE_APEX_CONE, CSG_FACE_CONE_X, CSG_FACE_CONE_Y, CSG_FACE_CONE_Z, CSG_FACE_CYLINDER,
    CSG_FACE_PLANE, CsgBoxData, CsgFaceData,
};
use crate::scene::validate::CSG_MARGIN_M;

const MARGIN: f64 = CSG_MARGIN_M as f64;

/// Hit of a ray on a CSG box: distance, normal and face. A ray that leaves the body (`is_left`) may hit
/// it again across a subtraction, after [`CSG_MARGIN_M`] at least. From within the body nothing is hit.
pub(super) fn intersect_csg_box(
    scene: &CompiledScene,
    csg_box: &CsgBoxData,
    ray: &Ray,
    is_left: bool,
) -> Option<(f64, DVec3, u32)> {
    let (enter, leave) = slabs(vector(csg_box.min), vector(csg_box.max), ray);
    let start = enter.0.max(if is_left { MARGIN } else { 0.0 });
    if start >= leave.0 || leave.0.is_infinite() {
        return None;
    }
    let first = csg_box.first_face;
    let subtractions = first + 1..first + csg_box.face_count;
    let (mut t, mut n, mut face) = (start, enter.1, first);
    // Leaving one subtraction may lead into another. Each iteration raises `t`; all subtractions except a
    // cone's exterior are convex and left for good, so that iterations are few.
    loop {
        let before = t;
        for index in subtractions.clone() {
            let subtraction = &scene.csg_faces[index as usize];
            if !contains(subtraction, ray.origin + t * ray.direction) {
                continue;
            }
            let (exit, normal) = exit(subtraction, ray, t);
            if exit > t {
                (t, n, face) = (exit, normal, index);
            }
            if t >= leave.0 {
                return None;
            }
        }
        if t == before {
            break;
        }
    }
    let is_within = face == first && (is_left || enter.0 <= 0.0);
    (!is_within).then_some((t, n, face))
}

/// Distance and normal.
type Side = (f64, DVec3);

/// Entry into and exit from a box, each with the normal on the side from which the ray comes.
fn slabs(min: DVec3, max: DVec3, ray: &Ray) -> (Side, Side) {
    let mut enter = (f64::NEG_INFINITY, DVec3::Z);
    let mut leave = (f64::INFINITY, DVec3::Z);
    for axis in 0..3 {
        let (origin, direction) = (ray.origin[axis], ray.direction[axis]);
        if direction == 0.0 {
            if origin < min[axis] || origin > max[axis] {
                return ((f64::INFINITY, DVec3::Z), (f64::NEG_INFINITY, DVec3::Z));
            }
            continue;
        }
        let (a, b) = (
            (min[axis] - origin) / direction,
            (max[axis] - origin) / direction,
        );
        let n = -direction.signum() * DVec3::AXES[axis];
        if a.min(b) > enter.0 {
            enter = (a.min(b), n);
        }
        if a.max(b) < leave.0 {
            leave = (a.max(b), n);
        }
    }
    (enter, leave)
}

/// Whether a subtraction, enlarged by the margin, contains a point.
fn contains(subtraction: &CsgFaceData, p: DVec3) -> bool {
    let (a, b) = (vector(subtraction.a), vector(subtraction.b));
    match subtraction.kind {
        CSG_FACE_PLANE => a.dot(p) > b.x - MARGIN,
        CSG_FACE_CYLINDER => (p - a).truncate().length() < b.x + MARGIN,
        kind @ (CSG_FACE_CONE_X | CSG_FACE_CONE_Y | CSG_FACE_CONE_Z) => {
            let p = axis_last(kind, p);
            let (from_axis, beyond) = ((p - a).truncate(), DVec2::new(b.y, b.z));
            from_axis.length() > a.z + b.x * p.z - MARGIN
                && from_axis.dot(beyond) >= beyond.length_squared() - MARGIN * beyond.length()
        }
        CSG_FACE_APEX_CONE => {
            let (slope, along, aside) = about_axis(b, p - a);
            aside.length() > slope * along - MARGIN
        }
        _ => p.cmpgt(a - MARGIN).all() && p.cmplt(b + MARGIN).all(),
    }
}

/// Exit of a ray that is inside a subtraction at `t`, with the normal of the body's surface there; ∞ if it
/// does not leave.
fn exit(subtraction: &CsgFaceData, ray: &Ray, t: f64) -> Side {
    let (a, b) = (vector(subtraction.a), vector(subtraction.b));
    match subtraction.kind {
        CSG_FACE_PLANE => {
            let slope = a.dot(ray.direction);
            if slope >= 0.0 {
                return (f64::INFINITY, a);
            }
            ((b.x - a.dot(ray.origin)) / slope, a)
        }
        CSG_FACE_CYLINDER => {
            let (from_axis, d) = ((ray.origin - a).truncate(), ray.direction.truncate());
            let d2 = d.length_squared();
            if d2 == 0.0 {
                return (f64::INFINITY, DVec3::Z);
            }
            // r² d² − (q × d)²: a quarter of the quadratic's discriminant in a form that does not cancel
            // for distant origins.
            let miss = from_axis.perp_dot(d);
            let half = (d2 * b.x * b.x - miss * miss).max(0.0).sqrt();
            let t = (half - from_axis.dot(d)) / d2;
            let n = -(from_axis + t * d).normalize();
            (t, n.extend(0.0))
        }
        kind @ (CSG_FACE_CONE_X | CSG_FACE_CONE_Y | CSG_FACE_CONE_Z) => {
            let (origin, direction) = (axis_last(kind, ray.origin), axis_last(kind, ray.direction));
            let (t, normal) = exit_cone_exterior(a, b, &Ray { origin, direction }, t);
            (t, axis_in_place(kind, normal))
        }
        CSG_FACE_APEX_CONE => {
            let (slope, along, from_axis) = about_axis(b, ray.origin - a);
            let (_, advance, d) = about_axis(b, ray.direction);
            match meet_cone(from_axis, d, slope * along, slope * advance, t) {
                Some(met) => {
                    let outward = (from_axis + met * d).normalize() - b;
                    (met, outward.normalize())
                }
                None => (f64::INFINITY, DVec3::Z),
            }
        }
        _ => slabs(a, b, ray).1,
    }
}

/// Coordinates of a vector permuted so that the axis of a cone's exterior becomes the third.
fn axis_last(kind: u32, v: DVec3) -> DVec3 {
    match kind {
        CSG_FACE_CONE_X => v.yzx(),
        CSG_FACE_CONE_Y => v.zxy(),
        _ => v,
    }
}

/// The inverse of [`axis_last`].
fn axis_in_place(kind: u32, v: DVec3) -> DVec3 {
    match kind {
        CSG_FACE_CONE_X => v.zxy(),
        CSG_FACE_CONE_Y => v.yzx(),
        _ => v,
    }
}

/// Exit from a cone's exterior: where the ray meets the round body, or goes back over the bounding plane.
/// The ray is outside the body at `t`; the body lies ahead while the ray still approaches it, or if it is
/// steeper than the body's side.
fn exit_cone_exterior(a: DVec3, b: DVec3, ray: &Ray, t: f64) -> Side {
    let (from_axis, d) = ((ray.origin - a).truncate(), ray.direction.truncate());
    let (taper, beyond) = (b.x, DVec2::new(b.y, b.z));
    let radius = a.z + taper * ray.origin.z;
    let growth = taper * ray.direction.z;
    let slope = d.dot(beyond);
    let back = if slope < 0.0 {
        (beyond.length_squared() - from_axis.dot(beyond)) / slope
    } else {
        f64::INFINITY
    };
    match meet_cone(from_axis.extend(0.0), d.extend(0.0), radius, growth, t) {
        Some(met) if met < back => {
            let outward = (from_axis + met * d).normalize();
            (met, outward.extend(-taper).normalize())
        }
        _ => (back, beyond.normalize_or_zero().extend(0.0)),
    }
}

/// Distance at which a ray that is outside a cone at `t` meets it: orthogonal to the axis it moves from
/// `from_axis` along `d`, while the cone's radius changes from `radius` by `growth` per unit of `t`.
fn meet_cone(from_axis: DVec3, d: DVec3, radius: f64, growth: f64, t: f64) -> Option<f64> {
    // |from_axis + t d|² = (radius + t growth)²
    // A quadratic in t: square · t² + 2 half_linear · t + …, with a quarter of the discriminant expanded by
    // Lagrange's identity, |q|²|d|² − (q · d)² = |q × d|², which does not cancel for distant origins.
    let square = d.length_squared() - growth * growth;
    let half_linear = from_axis.dot(d) - growth * radius;
    let quarter = d.length_squared() * radius * radius - from_axis.cross(d).length_squared()
        + growth * (growth * from_axis.length_squared() - 2.0 * from_axis.dot(d) * radius);
    // |…|² − (…)² is positive outside. If it opens upwards, the cone begins at the lower root, if that is
    // ahead. If the ray is steeper than the side, it opens downwards, and the same formula gives the upper
    // root.
    let met = -(half_linear + quarter.max(0.0).sqrt()) / square;
    let is_ahead = square < 0.0 || square * t + half_linear < 0.0;
    // Beyond the apex lies the other nappe of the double cone, which is not part of the body.
    (quarter >= 0.0 && square != 0.0 && is_ahead && radius + met * growth > 0.0).then_some(met)
}

/// Slope of a cone's side (the length of `b`, which lies along the axis), and the components of a vector
/// along the axis and orthogonal to it.
fn about_axis(b: DVec3, v: DVec3) -> (f64, f64, DVec3) {
    let slope = b.length();
    let axis = b / slope;
    let along = v.dot(axis);
    (slope, along, v - along * axis)
}
