//! Boxes with subtracted solids (CSG), one ray per lane: the traversal of [`crate::scalar::csg`].

use fearless_simd::prelude::*;

use super::lanes::{Float, Mask, Vec3x, Word};
use super::rays::Rays;
use crate::compiled::{
    CSG_FACE_APEX_CONE, CSG_FACE_CONE_X, CSG_FACE_CONE_Y, CSG_FACE_CONE_Z, CSG_FACE_CYLINDER,
    CSG_FACE_PLANE, CsgBoxData, CsgFaceData,
};
use crate::scene::validate::CSG_MARGIN_M;

/// A CSG box. Its faces have consecutive ids from `first` on: the box itself, then each subtraction.
pub(super) struct CsgBox {
    min: [f32; 3],
    max: [f32; 3],
    subtractions: Vec<CsgFaceData>,
    first: u32,
}

impl CsgBox {
    /// `first_id` is the id of the scene's first face.
    pub(super) fn new(csg_box: &CsgBoxData, faces: &[CsgFaceData], first_id: u32) -> Self {
        let own = csg_box.first_face as usize..(csg_box.first_face + csg_box.face_count) as usize;
        Self {
            min: csg_box.min,
            max: csg_box.max,
            subtractions: faces[own][1..].to_vec(),
            first: first_id + csg_box.first_face,
        }
    }

    /// Hits of rays on the body before `limit`: lanes, distances and ids of the faces.
    #[inline(always)]
    pub(super) fn intersect<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        limit: Float<S>,
    ) -> Option<(Mask<S>, Float<S>, Word<S>)> {
        let (near, far) = rays.slabs(simd, self.min, self.max);
        let enter = near.x.max(near.y).max(near.z);
        let end = far.x.min(far.y).min(far.z).min(limit);
        let last = self.first + self.subtractions.len() as u32;
        let left = rays.start.simd_ge(self.first) & rays.start.simd_le(last);
        let zero = Float::splat(simd, 0.0);
        // A ray that leaves the body starts within the margin of the face that it leaves, and would count
        // as inside that subtraction again.
        let start = left.select(Float::splat(simd, CSG_MARGIN_M), zero);
        let mut t = enter.max(start);
        let mut open = t.simd_lt(end);
        if !open.any_true() {
            return None;
        }
        let first = Word::splat(simd, self.first);
        // The box's own face, until the ray leaves a subtraction: if it leaves none, the hit is on the box.
        let mut face = first;
        loop {
            let mut moved = Mask::splat(simd, false);
            for (subtraction, id) in self.subtractions.iter().zip(self.first + 1..) {
                let within =
                    open & contains(simd, subtraction, rays.direction.mul_add(t, rays.origin));
                if !within.any_true() {
                    continue;
                }
                let exit = exit(simd, subtraction, rays, t);
                // Only exits ahead count: `t` grows in every iteration, so that the loop terminates.
                let further = within & exit.simd_gt(t);
                t = further.select(exit, t);
                face = further.select(Word::splat(simd, id), face);
                moved |= further;
                open &= t.simd_lt(end);
                if !open.any_true() {
                    return None;
                }
            }
            if !moved.any_true() {
                break;
            }
        }
        // Such a lane started inside the body and has never been inside a subtraction.
        let within = face.simd_eq(first) & (left | enter.simd_le(0.0));
        let hit = open & !within & t.simd_gt(0.0);
        hit.any_true().then_some((hit, t, face))
    }
}

/// Lanes whose point lies in a subtraction or closer to it than the margin.
#[inline(always)]
fn contains<S: Simd>(simd: S, subtraction: &CsgFaceData, p: Vec3x<S>) -> Mask<S> {
    let margin = CSG_MARGIN_M;
    match subtraction.kind {
        CSG_FACE_PLANE => p
            .dot(Vec3x::splat(simd, subtraction.a))
            .simd_gt(subtraction.b[0] - margin),
        CSG_FACE_CYLINDER => {
            let (x, y) = (p.x - subtraction.a[0], p.y - subtraction.a[1]);
            let radius = subtraction.b[0] + margin;
            x.mul_add(x, y * y).simd_lt(radius * radius)
        }
        kind @ (CSG_FACE_CONE_X | CSG_FACE_CONE_Y | CSG_FACE_CONE_Z) => {
            let p = axis_last(kind, p);
            let [taper, beyond_x, beyond_y] = subtraction.b;
            let (x, y) = (p.x - subtraction.a[0], p.y - subtraction.a[1]);
            let radius = p.z * taper + (subtraction.a[2] - margin);
            let outside = x.mul_add(x, y * y).simd_gt(radius * radius) | radius.simd_lt(0.0);
            let beyond = beyond_x.hypot(beyond_y);
            outside & (x * beyond_x + y * beyond_y).simd_ge(beyond * (beyond - margin))
        }
        CSG_FACE_APEX_CONE => {
            let cone = ApexCone::new(simd, subtraction);
            let (along, aside) = cone.split(p - Vec3x::splat(simd, subtraction.a));
            let radius = along * cone.slope - margin;
            aside.length_squared().simd_gt(radius * radius) | radius.simd_lt(0.0)
        }
        _ => {
            p.x.simd_gt(subtraction.a[0] - margin)
                & p.y.simd_gt(subtraction.a[1] - margin)
                & p.z.simd_gt(subtraction.a[2] - margin)
                & p.x.simd_lt(subtraction.b[0] + margin)
                & p.y.simd_lt(subtraction.b[1] + margin)
                & p.z.simd_lt(subtraction.b[2] + margin)
        }
    }
}

/// Distance at which rays that are in a subtraction at `t` leave it; ∞ if they do not.
#[inline(always)]
fn exit<S: Simd>(simd: S, subtraction: &CsgFaceData, rays: &Rays<S>, t: Float<S>) -> Float<S> {
    let infinite = Float::splat(simd, f32::INFINITY);
    match subtraction.kind {
        CSG_FACE_PLANE => {
            let normal = Vec3x::splat(simd, subtraction.a);
            let slope = rays.direction.dot(normal);
            let t = (Float::splat(simd, subtraction.b[0]) - rays.origin.dot(normal)) / slope;
            slope.simd_lt(0.0).select(t, infinite)
        }
        CSG_FACE_CYLINDER => {
            let (x, y) = (
                rays.origin.x - subtraction.a[0],
                rays.origin.y - subtraction.a[1],
            );
            let (dx, dy) = (rays.direction.x, rays.direction.y);
            let d2 = dx.mul_add(dx, dy * dy);
            // |q × d|² instead of |q|²|d|² − (q·d)², which cancels for distant origins.
            let miss = x.mul_add(dy, -(y * dx));
            let half = d2 * (subtraction.b[0] * subtraction.b[0]) - miss * miss;
            let t = (half.max(0.0).sqrt() - x.mul_add(dx, y * dy)) / d2;
            d2.simd_gt(0.0).select(t, infinite)
        }
        CSG_FACE_CONE_X | CSG_FACE_CONE_Y | CSG_FACE_CONE_Z => {
            exit_cone_exterior(simd, subtraction, rays, t)
        }
        CSG_FACE_APEX_CONE => {
            let cone = ApexCone::new(simd, subtraction);
            let apex = Vec3x::splat(simd, subtraction.a);
            let (along, q) = cone.split(rays.origin - apex);
            let (advance, d) = cone.split(rays.direction);
            let miss = Vec3x::new(
                q.y * d.z - q.z * d.y,
                q.z * d.x - q.x * d.z,
                q.x * d.y - q.y * d.x,
            );
            let approach = Approach {
                d2: d.length_squared(),
                along: q.dot(d),
                miss2: miss.length_squared(),
                q2: q.length_squared(),
                radius: along * cone.slope,
                growth: advance * cone.slope,
            };
            let (body, met) = approach.meet(t);
            body.select(met, infinite)
        }
        _ => {
            let (_, far) = rays.slabs(simd, subtraction.a, subtraction.b);
            far.x.min(far.y).min(far.z)
        }
    }
}

/// Coordinates of vectors permuted so that the axis of a cone's exterior becomes the third.
#[inline(always)]
fn axis_last<S: Simd>(kind: u32, v: Vec3x<S>) -> Vec3x<S> {
    match kind {
        CSG_FACE_CONE_X => Vec3x::new(v.y, v.z, v.x),
        CSG_FACE_CONE_Y => Vec3x::new(v.z, v.x, v.y),
        _ => v,
    }
}

/// Distance at which rays in a cone's exterior meet the cone, or the plane that bounds the subtraction.
#[inline(always)]
fn exit_cone_exterior<S: Simd>(
    simd: S,
    subtraction: &CsgFaceData,
    rays: &Rays<S>,
    t: Float<S>,
) -> Float<S> {
    let [taper, beyond_x, beyond_y] = subtraction.b;
    let direction = axis_last(subtraction.kind, rays.direction);
    // Relative to the point at `t`: for a thin cone the squares of a distant origin would cancel in f32.
    let from = direction.mul_add(t, axis_last(subtraction.kind, rays.origin));
    let (x, y) = (from.x - subtraction.a[0], from.y - subtraction.a[1]);
    let (dx, dy) = (direction.x, direction.y);
    let radius = from.z * taper + subtraction.a[2];
    let growth = direction.z * taper;
    let d2 = dx.mul_add(dx, dy * dy);
    let along = x.mul_add(dx, y * dy);
    let miss = x.mul_add(dy, -(y * dx));
    let approach = Approach {
        d2,
        along,
        miss2: miss * miss,
        q2: x.mul_add(x, y * y),
        radius,
        growth,
    };
    let (body, met) = approach.meet(Float::splat(simd, 0.0));
    let slope = dx * beyond_x + dy * beyond_y;
    let beyond_squared = beyond_x.mul_add(beyond_x, beyond_y * beyond_y);
    let back = (Float::splat(simd, beyond_squared) - (x * beyond_x + y * beyond_y)) / slope;
    let infinite = Float::splat(simd, f32::INFINITY);
    let back = slope.simd_lt(0.0).select(back, infinite);
    t + body.select(met, infinite).min(back)
}

/// A cone by its axis and the slope of its side (radius per length).
struct ApexCone<S: Simd> {
    axis: Vec3x<S>,
    slope: f32,
}

impl<S: Simd> ApexCone<S> {
    #[inline(always)]
    fn new(simd: S, subtraction: &CsgFaceData) -> Self {
        let [x, y, z] = subtraction.b;
        let slope = x.mul_add(x, y.mul_add(y, z * z)).sqrt();
        let axis = Vec3x::splat(simd, subtraction.b.map(|c| c / slope));
        Self { axis, slope }
    }

    /// Components of a vector along the axis and orthogonal to it.
    #[inline(always)]
    fn split(&self, v: Vec3x<S>) -> (Float<S>, Vec3x<S>) {
        let along = v.dot(self.axis);
        (along, self.axis.mul_add(-along, v))
    }
}

/// A ray relative to a cone: orthogonal to the axis it moves from q along d, while the cone's radius
/// there changes from `radius` by `growth` per unit of `t`.
struct Approach<S: Simd> {
    /// |d|²
    d2: Float<S>,
    /// q · d
    along: Float<S>,
    /// |q × d|²
    miss2: Float<S>,
    /// |q|²
    q2: Float<S>,
    radius: Float<S>,
    growth: Float<S>,
}

impl<S: Simd> Approach<S> {
    /// Whether and where a ray that is outside the cone at `t` meets it; derivation in
    /// [`crate::scalar::csg`].
    #[inline(always)]
    fn meet(&self, t: Float<S>) -> (Mask<S>, Float<S>) {
        let (radius, growth) = (self.radius, self.growth);
        // |q + t d|² = (radius + t growth)² as a quadratic in t.
        let square = self.d2 - growth * growth;
        let half_linear = self.along - growth * radius;
        let quarter = self.d2 * (radius * radius) - self.miss2
            + growth * (growth * self.q2 - 2.0 * self.along * radius);
        let met = -(half_linear + quarter.max(0.0).sqrt()) / square;
        let ahead = square.simd_lt(0.0) | square.mul_add(t, half_linear).simd_lt(0.0);
        let real = quarter.simd_ge(0.0) & met.mul_add(growth, radius).simd_gt(0.0);
        (ahead & real & square.simd_ne(0.0), met)
    }
}
