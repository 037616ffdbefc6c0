//! Packets of rays and their nearest hits.

use fearless_simd::prelude::*;

use super::lanes::{Float, Mask, Vec3x, Word};

/// Lanes that hit a primitive, and their distances; `None` if no lane does.
pub(super) type HitMask<S> = Option<(Mask<S>, Float<S>)>;

/// Id of no primitive.
pub(super) const NONE: u32 = u32::MAX;

/// Flag in the id of a dielectric that the ray is inside of: it hits the far side of that body.
pub(super) const INSIDE: u32 = 1 << 31;

/// Lower bound of a direction component's absolute value in slab tests, so that no product is 0 · ∞.
pub(super) const DIRECTION_MIN: f32 = 1e-30;

/// Rays with the values shared by their intersection tests.
#[derive(Clone, Copy)]
pub(super) struct Rays<S: Simd> {
    pub(super) origin: Vec3x<S>,
    /// Unit vectors.
    pub(super) direction: Vec3x<S>,
    /// Primitive on which each ray starts and which it cannot hit again, as all are convex. With
    /// [`INSIDE`]: the dielectric that the ray is inside of.
    pub(super) start: Word<S>,
    /// Componentwise reciprocal of `direction`, finite.
    pub(super) inverse: Vec3x<S>,
    pub(super) inverse_abs: Vec3x<S>,
}

impl<S: Simd> Rays<S> {
    #[inline(always)]
    pub(super) fn new(simd: S, origin: Vec3x<S>, direction: Vec3x<S>, start: Word<S>) -> Self {
        let inverse = inverse(simd, direction);
        Self {
            origin,
            direction,
            start,
            inverse,
            inverse_abs: inverse.abs(),
        }
    }

    /// Distances to the nearer and to the farther plane of each slab of a box.
    #[inline(always)]
    pub(super) fn slabs(&self, simd: S, min: [f32; 3], max: [f32; 3]) -> (Vec3x<S>, Vec3x<S>) {
        let a = (Vec3x::splat(simd, min) - self.origin).scale(self.inverse);
        let b = (Vec3x::splat(simd, max) - self.origin).scale(self.inverse);
        (
            Vec3x::new(a.x.min(b.x), a.y.min(b.y), a.z.min(b.z)),
            Vec3x::new(a.x.max(b.x), a.y.max(b.y), a.z.max(b.z)),
        )
    }
}

/// Componentwise `1 / d`, with |d| at least [`DIRECTION_MIN`].
#[inline(always)]
pub(super) fn inverse<S: Simd>(simd: S, direction: Vec3x<S>) -> Vec3x<S> {
    Vec3x::new(
        inverse_component(simd, direction.x),
        inverse_component(simd, direction.y),
        inverse_component(simd, direction.z),
    )
}

#[inline(always)]
fn inverse_component<S: Simd>(simd: S, d: Float<S>) -> Float<S> {
    // The sign survives for ±0, so that a ray in the plane of a face still knows which side lies ahead.
    1.0 / d.abs().max(Float::splat(simd, DIRECTION_MIN)).copysign(d)
}

/// Distance and id of the nearest hit so far, per lane.
pub(super) struct Nearest<S: Simd> {
    pub(super) distance: Float<S>,
    pub(super) id: Word<S>,
}

impl<S: Simd> Nearest<S> {
    #[inline(always)]
    pub(super) fn none(simd: S) -> Self {
        Self {
            distance: Float::splat(simd, f32::INFINITY),
            id: Word::splat(simd, NONE),
        }
    }

    #[inline(always)]
    pub(super) fn update(&mut self, hits: HitMask<S>, id: u32) {
        if let Some((hit, t)) = hits {
            self.distance = hit.select(t, self.distance);
            self.id = hit.select(Word::splat(t.token(), id), self.id);
        }
    }
}
