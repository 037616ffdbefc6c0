//! Boxes from which parts are taken away.
//!
//! A ray enters the box, and leaves in turn each cut that it finds itself in; where it is in none,
//! it has met the body. A point is in a cut if it is closer to it than a margin, so that a ray that
//! leaves a cut's surface never meets that surface for rounding.

use glam::DVec3;

use super::intersect::{Ray, vector};
use crate::CompiledScene;
use crate::compiled::{CarvedData, FACE_BORE, FACE_PLANE, FaceData};
use crate::scene::validate::CUT_MARGIN_M;

const MARGIN: f64 = CUT_MARGIN_M as f64;

/// Where a ray meets a carved box: distance, normal and face. A ray that leaves the body may meet
/// it again across a cut, after [`CUT_MARGIN_M`] at least. Nothing is met from within the body.
pub(super) fn meet_carved(
    scene: &CompiledScene,
    carved: &CarvedData,
    ray: &Ray,
    is_left: bool,
) -> Option<(f64, DVec3, u32)> {
    let (enter, leave) = slabs(vector(carved.min), vector(carved.max), ray);
    let start = enter.0.max(if is_left { MARGIN } else { 0.0 });
    if start >= leave.0 || leave.0.is_infinite() {
        return None;
    }
    let first = carved.first_face;
    let cuts = first + 1..first + carved.face_count;
    let (mut t, mut n, mut face) = (start, enter.1, first);
    loop {
        let before = t;
        for index in cuts.clone() {
            let cut = &scene.faces[index as usize];
            if !holds(cut, ray.origin + t * ray.direction) {
                continue;
            }
            let (exit, normal) = exit(cut, ray);
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

type Side = (f64, DVec3);

/// Where a ray enters and leaves a box, each with the normal on the side that it comes from.
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

/// Whether a point is taken away by a cut.
fn holds(cut: &FaceData, p: DVec3) -> bool {
    let (a, b) = (vector(cut.a), vector(cut.b));
    match cut.kind {
        FACE_PLANE => a.dot(p) > b.x - MARGIN,
        FACE_BORE => (p - a).truncate().length() < b.x + MARGIN,
        _ => p.cmpgt(a - MARGIN).all() && p.cmplt(b + MARGIN).all(),
    }
}

/// Where a ray that is in a cut leaves it, with the normal of the surface there.
fn exit(cut: &FaceData, ray: &Ray) -> Side {
    let (a, b) = (vector(cut.a), vector(cut.b));
    match cut.kind {
        FACE_PLANE => {
            let slope = a.dot(ray.direction);
            if slope >= 0.0 {
                return (f64::INFINITY, a);
            }
            ((b.x - a.dot(ray.origin)) / slope, a)
        }
        FACE_BORE => {
            let (from_axis, d) = ((ray.origin - a).truncate(), ray.direction.truncate());
            let d2 = d.length_squared();
            if d2 == 0.0 {
                return (f64::INFINITY, DVec3::Z);
            }
            let miss = from_axis.perp_dot(d);
            let half = (d2 * b.x * b.x - miss * miss).max(0.0).sqrt();
            let t = (half - from_axis.dot(d)) / d2;
            let n = -(from_axis + t * d).normalize();
            (t, n.extend(0.0))
        }
        _ => slabs(a, b, ray).1,
    }
}
