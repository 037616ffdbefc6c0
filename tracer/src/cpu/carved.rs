//! Boxes from which parts are taken away, a lane each: the walk of [`crate::scalar::carved`].

use fearless_simd::prelude::*;

use super::geometry::Rays;
use super::lanes::{Float, Mask, Vec3x, Word};
use crate::compiled::{CarvedData, FACE_BORE, FACE_PLANE, FACE_TURNED, FaceData};
use crate::scene::validate::CUT_MARGIN_M;

/// A carved box. Its faces have the ids from `first` on: the box's own, then those of the cuts.
pub(super) struct Carved {
    min: [f32; 3],
    max: [f32; 3],
    cuts: Vec<FaceData>,
    first: u32,
}

impl Carved {
    /// `first_id` is the id of the scene's first face.
    pub(super) fn new(carved: &CarvedData, faces: &[FaceData], first_id: u32) -> Self {
        let own = carved.first_face as usize..(carved.first_face + carved.face_count) as usize;
        Self {
            min: carved.min,
            max: carved.max,
            cuts: faces[own][1..].to_vec(),
            first: first_id + carved.first_face,
        }
    }

    /// Where rays meet the body before `limit`, and which face of it.
    #[inline(always)]
    pub(super) fn meet<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        limit: Float<S>,
    ) -> Option<(Mask<S>, Float<S>, Word<S>)> {
        let (near, far) = rays.slabs(simd, self.min, self.max);
        let enter = near.x.max(near.y).max(near.z);
        let end = far.x.min(far.y).min(far.z).min(limit);
        let last = self.first + self.cuts.len() as u32;
        let left = rays.skip.simd_ge(self.first) & rays.skip.simd_le(last);
        let zero = Float::splat(simd, 0.0);
        let start = left.select(Float::splat(simd, CUT_MARGIN_M), zero);
        let mut t = enter.max(start);
        let mut open = t.simd_lt(end);
        if !open.any_true() {
            return None;
        }
        let first = Word::splat(simd, self.first);
        let mut face = first;
        loop {
            let mut moved = Mask::splat(simd, false);
            for (cut, id) in self.cuts.iter().zip(self.first + 1..) {
                let within = open & holds(simd, cut, rays.direction.mul_add(t, rays.origin));
                if !within.any_true() {
                    continue;
                }
                let exit = exit(simd, cut, rays, t);
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
        let within = face.simd_eq(first) & (left | enter.simd_le(0.0));
        let hit = open & !within & t.simd_gt(0.0);
        hit.any_true().then_some((hit, t, face))
    }
}

/// Where points are taken away by a cut.
#[inline(always)]
fn holds<S: Simd>(simd: S, cut: &FaceData, p: Vec3x<S>) -> Mask<S> {
    let margin = CUT_MARGIN_M;
    match cut.kind {
        FACE_PLANE => p.dot(Vec3x::splat(simd, cut.a)).simd_gt(cut.b[0] - margin),
        FACE_BORE => {
            let (x, y) = (p.x - cut.a[0], p.y - cut.a[1]);
            let radius = cut.b[0] + margin;
            x.mul_add(x, y * y).simd_lt(radius * radius)
        }
        FACE_TURNED => {
            let [taper, beyond_x, beyond_y] = cut.b;
            let (x, y) = (p.x - cut.a[0], p.y - cut.a[1]);
            let radius = p.z * taper + (cut.a[2] - margin);
            let outside = x.mul_add(x, y * y).simd_gt(radius * radius) | radius.simd_lt(0.0);
            let beyond = beyond_x.hypot(beyond_y);
            outside & (x * beyond_x + y * beyond_y).simd_ge(beyond * (beyond - margin))
        }
        _ => {
            p.x.simd_gt(cut.a[0] - margin)
                & p.y.simd_gt(cut.a[1] - margin)
                & p.z.simd_gt(cut.a[2] - margin)
                & p.x.simd_lt(cut.b[0] + margin)
                & p.y.simd_lt(cut.b[1] + margin)
                & p.z.simd_lt(cut.b[2] + margin)
        }
    }
}

/// Where rays that are in a cut at `t` leave it.
#[inline(always)]
fn exit<S: Simd>(simd: S, cut: &FaceData, rays: &Rays<S>, t: Float<S>) -> Float<S> {
    let infinite = Float::splat(simd, f32::INFINITY);
    match cut.kind {
        FACE_PLANE => {
            let normal = Vec3x::splat(simd, cut.a);
            let slope = rays.direction.dot(normal);
            let t = (Float::splat(simd, cut.b[0]) - rays.origin.dot(normal)) / slope;
            slope.simd_lt(0.0).select(t, infinite)
        }
        FACE_BORE => {
            let (x, y) = (rays.origin.x - cut.a[0], rays.origin.y - cut.a[1]);
            let (dx, dy) = (rays.direction.x, rays.direction.y);
            let d2 = dx.mul_add(dx, dy * dy);
            let miss = x.mul_add(dy, -(y * dx));
            let half = d2 * (cut.b[0] * cut.b[0]) - miss * miss;
            let t = (half.max(0.0).sqrt() - x.mul_add(dx, y * dy)) / d2;
            d2.simd_gt(0.0).select(t, infinite)
        }
        FACE_TURNED => leave_turned(simd, cut, rays, t),
        _ => {
            let (_, far) = rays.slabs(simd, cut.a, cut.b);
            far.x.min(far.y).min(far.z)
        }
    }
}

/// Where the round body of a turned cut is met, or else the plane that the cut begins beyond.
#[inline(always)]
fn leave_turned<S: Simd>(simd: S, cut: &FaceData, rays: &Rays<S>, t: Float<S>) -> Float<S> {
    let [taper, beyond_x, beyond_y] = cut.b;
    let (x, y) = (rays.origin.x - cut.a[0], rays.origin.y - cut.a[1]);
    let (dx, dy) = (rays.direction.x, rays.direction.y);
    let radius = rays.origin.z * taper + cut.a[2];
    let growth = rays.direction.z * taper;
    let d2 = dx.mul_add(dx, dy * dy);
    let along = x.mul_add(dx, y * dy);
    let miss = x.mul_add(dy, -(y * dx));
    let square = d2 - growth * growth;
    let half_linear = along - growth * radius;
    let quarter = d2 * (radius * radius) - miss * miss
        + growth * (growth * x.mul_add(x, y * y) - 2.0 * along * radius);
    let met = -(half_linear + quarter.max(0.0).sqrt()) / square;
    let ahead = square.simd_lt(0.0) | square.mul_add(t, half_linear).simd_lt(0.0);
    let real = quarter.simd_ge(0.0) & met.mul_add(growth, radius).simd_gt(0.0);
    let body = ahead & real & square.simd_ne(0.0);
    let slope = dx * beyond_x + dy * beyond_y;
    let beyond_squared = beyond_x.mul_add(beyond_x, beyond_y * beyond_y);
    let back = (Float::splat(simd, beyond_squared) - (x * beyond_x + y * beyond_y)) / slope;
    let infinite = Float::splat(simd, f32::INFINITY);
    body.select(met, slope.simd_lt(0.0).select(back, infinite))
}
