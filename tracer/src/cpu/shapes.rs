//! Ray-primitive intersection, with a different primitive per lane or the same one in all lanes.
//!
//! Each test begins with a cheap rejection; the exact test runs only if some lane passes.

use std::marker::PhantomData;

use fearless_simd::prelude::*;

use super::lanes::{Float, Mask, Vec3x, Word};
use super::rays::{HitMask, INSIDE, Rays};
use crate::compiled::{AreaLightData, BoxData, DiscData, RectangleData, SphereData};

/// A shape whose primitives are described by `N` numbers.
pub(super) trait Shape<const N: usize> {
    /// Least number of primitives at which a BVH is faster, measured by `carom-bench bvh --backend cpu`.
    const BVH_MIN: usize;

    /// Values shared by all intersection tests of the same rays.
    type Frame<S: Simd>: Copy;

    /// Computes the frame of `rays`.
    fn frame<S: Simd>(simd: S, rays: &Rays<S>) -> Self::Frame<S>;

    /// Hits of rays on `primitives` before `limit`, and their distances; `None` if there are none.
    fn intersect<S: Simd>(
        rays: &Rays<S>,
        frame: &Self::Frame<S>,
        primitives: &Primitives<S, N>,
        limit: Float<S>,
    ) -> HitMask<S>;
}

/// One primitive per lane. Primitives whose numbers are NaN are never hit.
pub(super) struct Primitives<S: Simd, const N: usize> {
    pub(super) numbers: [Float<S>; N],
    pub(super) id: Word<S>,
    /// Whether some are dielectrics, of which rays inside hit the far side.
    pub(super) has_dielectric: bool,
}

impl<S: Simd, const N: usize> Primitives<S, N> {
    /// Three consecutive numbers as a vector.
    #[inline(always)]
    pub(super) fn vector(&self, first: usize) -> Vec3x<S> {
        Vec3x::new(
            self.numbers[first],
            self.numbers[first + 1],
            self.numbers[first + 2],
        )
    }
}

/// One primitive of shape `F`.
pub(super) struct PackedPrimitive<F, const N: usize> {
    pub(super) numbers: [f32; N],
    pub(super) id: u32,
    pub(super) is_dielectric: bool,
    shape: PhantomData<F>,
}

impl<F, const N: usize> PackedPrimitive<F, N> {
    pub(super) fn new(numbers: [f32; N], id: u32, is_dielectric: bool) -> Self {
        Self {
            numbers,
            id,
            is_dielectric,
            shape: PhantomData,
        }
    }

    /// Broadcasts the primitive to all lanes.
    #[inline(always)]
    pub(super) fn splat<S: Simd>(&self, simd: S) -> Primitives<S, N> {
        let mut numbers = [Float::splat(simd, 0.0); N];
        for (lanes, number) in numbers.iter_mut().zip(self.numbers) {
            *lanes = Float::splat(simd, number);
        }
        Primitives {
            numbers,
            id: Word::splat(simd, self.id),
            has_dielectric: self.is_dielectric,
        }
    }
}

/// Radius outside which no line can hit, whatever the rounding errors of the quick test.
fn reject_radius(radius: f32, reach: f32) -> f32 {
    // The first term covers rounding of squares near the radius, the second that of coordinates up to
    // `reach`. Too large a radius only costs exact tests; too small a one would lose hits.
    radius * 1.000_01 + reach * (8.0 * f32::EPSILON)
}

/// Sphere: centre, radius, and the radius of the quick test with its square.
pub(super) struct Sphere;

impl Sphere {
    /// `None` if it is hidden. `reach` bounds the distance from any ray's origin, metres.
    pub(super) fn numbers(sphere: &SphereData, reach: f32) -> Option<[f32; 6]> {
        let [x, y, z] = sphere.center;
        let radius = sphere.radius;
        let reject = reject_radius(radius, reach);
        (radius > 0.0).then_some([x, y, z, radius, reject, reject * reject])
    }
}

impl Shape<6> for Sphere {
    /// With AVX-512 the BVH is faster by 1.4 for 512 and 2.2 for 1024; slower by 2 % for 256.
    const BVH_MIN: usize = 320;

    type Frame<S: Simd> = ();

    #[inline(always)]
    fn frame<S: Simd>(_: S, _: &Rays<S>) {}

    #[inline(always)]
    fn intersect<S: Simd>(
        rays: &Rays<S>,
        (): &(),
        primitives: &Primitives<S, 6>,
        limit: Float<S>,
    ) -> HitMask<S> {
        let center = primitives.vector(0);
        let [.., radius, reject, reject_squared] = primitives.numbers;
        let from_center = rays.origin - center;
        let closest = -from_center.dot(rays.direction);
        let miss_squared = rays
            .direction
            .mul_add(closest, from_center)
            .length_squared();
        // The second condition rejects spheres behind the origin. The bound is −reject, as an origin inside
        // may have its closest point up to a radius behind it.
        let candidate = miss_squared.simd_le(reject_squared) & closest.simd_gt(-reject);
        if !candidate.any_true() {
            return None;
        }
        let chord = Chord::new(rays.origin, rays.direction, center, radius);
        let mut t = chord.first();
        let mut hit = chord.real & t.simd_gt(0.0);
        if primitives.has_dielectric {
            // A ray inside has to leave. It hits even where rounding leaves no real chord, as for a grazing
            // ray: `half` is 0 there, and the path leaves at that point instead of being lost in the body.
            let within = rays.start.simd_eq(primitives.id | INSIDE);
            // Rounding may put the far side behind an origin that lies on it.
            t = within.select(chord.far.max(0.0), t);
            hit |= within;
        }
        // Strictly before the limit: of primitives at equal distance the first is kept.
        let hit = hit & t.simd_lt(limit) & rays.start.simd_ne(primitives.id);
        Some((hit, t))
    }
}

/// Chord of a line inside a sphere, accurate in f32 for distant origins: the difference of origin and
/// centre keeps its rounding error (Knuth's TwoDiff), and the perpendicular is orthogonalised twice.
/// Haines et al., "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems ch. 7, 2019, use
/// part of this.
pub(super) struct Chord<S: Simd> {
    /// From the centre to the line, orthogonal to it.
    perpendicular: Vec3x<S>,
    /// Half the length of the chord.
    half: Float<S>,
    /// Distances along the ray to the entry and to the exit.
    near: Float<S>,
    pub(super) far: Float<S>,
    /// Lanes where the line meets the sphere.
    pub(super) real: Mask<S>,
}

impl<S: Simd> Chord<S> {
    #[inline(always)]
    pub(super) fn new(
        origin: Vec3x<S>,
        direction: Vec3x<S>,
        center: Vec3x<S>,
        radius: Float<S>,
    ) -> Self {
        let (x, x_error) = two_diff(origin.x, center.x);
        let (y, y_error) = two_diff(origin.y, center.y);
        let (z, z_error) = two_diff(origin.z, center.z);
        // Rounding errors of the differences: 0.6 m for an eye 10,000 km away, twenty radii of a pool ball.
        let error = Vec3x::new(x_error, y_error, z_error);
        let closest = -Vec3x::new(x, y, z).dot(direction);
        // The products cancel against x, y and z: without a fused multiply-add no correct digits would be
        // left.
        let rough = Vec3x::new(
            direction.x.mul_add_precise(closest, x),
            direction.y.mul_add_precise(closest, y),
            direction.z.mul_add_precise(closest, z),
        ) + error;
        // Second projection: the rounding error of `closest` still lies along the ray.
        let correction = -rough.dot(direction);
        let perpendicular = direction.mul_add(correction, rough);
        // r² − |p|² with p orthogonal to the line: b² − 4ac of the usual quadratic cancels in proportion to
        // the square of the distance in radii.
        let discriminant = radius * radius - perpendicular.length_squared();
        let half = discriminant.max(0.0).sqrt();
        Self {
            perpendicular,
            half,
            near: (closest - half) + correction,
            far: (closest + half) + correction,
            real: discriminant.simd_ge(0.0),
        }
    }

    /// Distance along the ray to the first intersection ahead.
    #[inline(always)]
    pub(super) fn first(&self) -> Float<S> {
        self.near.simd_gt(0.0).select(self.near, self.far)
    }

    /// That intersection relative to the centre, without the rounding error of `origin + t · direction`;
    /// for rays `within` the sphere, the far one.
    #[inline(always)]
    pub(super) fn first_from_center(&self, direction: Vec3x<S>, within: Mask<S>) -> Vec3x<S> {
        let is_near = self.near.simd_gt(0.0) & !within;
        let half = is_near.select(-self.half, self.half);
        direction.mul_add(half, self.perpendicular)
    }
}

/// `a − b` and its rounding error.
#[inline(always)]
fn two_diff<S: Simd>(a: Float<S>, b: Float<S>) -> (Float<S>, Float<S>) {
    let difference = a - b;
    // Knuth's TwoSum of a and −b. Operations must not be fused or reordered here, or the error comes out as
    // 0.
    let b_part = difference - a;
    (difference, (a - (difference - b_part)) - (b + b_part))
}

/// Axis-aligned box as three slabs: centre and half extents.
pub(super) struct AlignedBox;

impl AlignedBox {
    pub(super) fn numbers(data: &BoxData) -> [f32; 6] {
        let center: [f32; 3] = std::array::from_fn(|i| 0.5 * (data.min[i] + data.max[i]));
        // Rounded up, so that rays within a face or through an edge hit.
        let half: [f32; 3] = std::array::from_fn(|i| {
            let half = (data.max[i] - center[i]).max(center[i] - data.min[i]);
            half.next_up().next_up()
        });
        join([center, half])
    }
}

impl Shape<6> for AlignedBox {
    /// Equally fast there; the BVH is faster by 1.4 for 512 and 2.3 for 1024.
    const BVH_MIN: usize = 256;

    type Frame<S: Simd> = ();

    #[inline(always)]
    fn frame<S: Simd>(_: S, _: &Rays<S>) {}

    #[inline(always)]
    fn intersect<S: Simd>(
        rays: &Rays<S>,
        (): &(),
        primitives: &Primitives<S, 6>,
        limit: Float<S>,
    ) -> HitMask<S> {
        let to_center = primitives.vector(0) - rays.origin;
        // By centre and half extent |1/d| orders near and far; corners need a minimum and a maximum more
        // per axis.
        let middle = to_center.scale(rays.inverse);
        let half = primitives.vector(3);
        let near = (-half).scale_add(rays.inverse_abs, middle);
        let far = half.scale_add(rays.inverse_abs, middle);
        let entry = near.x.max(near.y).max(near.z);
        let exit = far.x.min(far.y).min(far.z);
        // Rays parallel to a slab have |1/d| ≤ 1e30 instead of ∞: both distances are huge, of equal sign
        // outside the slab and of opposite signs inside; 0 · ∞ would be NaN.
        let hit = entry.max(0.0).simd_le(exit.min(limit)) & rays.start.simd_ne(primitives.id);
        if primitives.has_dielectric {
            let within = rays.start.simd_eq(primitives.id | INSIDE);
            let t = entry.simd_gt(0.0).select(entry, exit);
            let t = within.select(exit.max(0.0), t);
            let ahead = hit & t.simd_gt(0.0);
            return Some(((ahead | within) & t.simd_lt(limit), t));
        }
        if !hit.any_true() {
            return None;
        }
        let t = entry.simd_gt(0.0).select(entry, exit);
        Some((hit & t.simd_gt(0.0) & t.simd_lt(limit), t))
    }
}

/// Disc: centre, normal and square of the radius.
pub(super) struct Disc;

impl Disc {
    pub(super) fn numbers(disc: &DiscData) -> [f32; 7] {
        let ([x, y, z], [nx, ny, nz]) = (disc.center, disc.normal);
        [x, y, z, nx, ny, nz, disc.radius * disc.radius]
    }
}

impl Shape<7> for Disc {
    /// Equally fast there; the BVH is faster by 1.4 for 192 and 3.4 for 1024.
    const BVH_MIN: usize = 96;

    type Frame<S: Simd> = ();

    #[inline(always)]
    fn frame<S: Simd>(_: S, _: &Rays<S>) {}

    #[inline(always)]
    fn intersect<S: Simd>(
        rays: &Rays<S>,
        (): &(),
        primitives: &Primitives<S, 7>,
        limit: Float<S>,
    ) -> HitMask<S> {
        let crossing = Crossing::new(rays, primitives.vector(0), primitives.vector(3));
        // |p|² ≤ r², both sides times the square of the denominator.
        let bound = crossing.denominator * crossing.denominator * primitives.numbers[6];
        let inside = crossing.from_center.length_squared().simd_le(bound);
        crossing.finish(rays, inside, limit, primitives.id)
    }
}

/// Rectangle, of an object or an area light: centre, normal, and half edges over their squared length, so
/// that dot products with them are in [−1, 1] inside.
pub(super) struct Rectangle;

impl Rectangle {
    pub(super) fn numbers(rectangle: &RectangleData) -> [f32; 12] {
        let u = rectangle.half_u.map(|c| c * rectangle.inv_u2);
        let v = rectangle.half_v.map(|c| c * rectangle.inv_v2);
        join([rectangle.center, rectangle.normal, u, v])
    }

    pub(super) fn area_light_numbers(light: &AreaLightData) -> [f32; 12] {
        let u = light.axis_u.map(|c| c * (1.0 / light.length_u));
        let v = light.axis_v.map(|c| c * (1.0 / light.length_v));
        join([light.center, light.normal, u, v])
    }
}

impl Shape<12> for Rectangle {
    /// The BVH is faster by 1.1 there, 1.6 for 192 and 4.0 for 1024.
    const BVH_MIN: usize = 96;

    type Frame<S: Simd> = ();

    #[inline(always)]
    fn frame<S: Simd>(_: S, _: &Rays<S>) {}

    #[inline(always)]
    fn intersect<S: Simd>(
        rays: &Rays<S>,
        (): &(),
        primitives: &Primitives<S, 12>,
        limit: Float<S>,
    ) -> HitMask<S> {
        let crossing = Crossing::new(rays, primitives.vector(0), primitives.vector(3));
        let bound = crossing.denominator.abs();
        let along_u = crossing.from_center.dot(primitives.vector(6)).abs();
        let along_v = crossing.from_center.dot(primitives.vector(9)).abs();
        let inside = along_u.simd_le(bound) & along_v.simd_le(bound);
        crossing.finish(rays, inside, limit, primitives.id)
    }
}

pub(super) fn join<const VECTORS: usize, const N: usize>(vectors: [[f32; 3]; VECTORS]) -> [f32; N] {
    let mut numbers = [0.0; N];
    numbers.copy_from_slice(vectors.as_flattened());
    numbers
}

/// Intersection of rays with a plane as fractions: most lie outside the shape and need no division.
struct Crossing<S: Simd> {
    numerator: Float<S>,
    denominator: Float<S>,
    /// From the centre to the intersection, times the denominator.
    from_center: Vec3x<S>,
}

impl<S: Simd> Crossing<S> {
    #[inline(always)]
    fn new(rays: &Rays<S>, center: Vec3x<S>, normal: Vec3x<S>) -> Self {
        let from_center = rays.origin - center;
        let denominator = rays.direction.dot(normal);
        let numerator = -from_center.dot(normal);
        Self {
            numerator,
            denominator,
            // (o − c) + d · num/den, times den.
            from_center: rays.direction.mul_add(numerator, from_center * denominator),
        }
    }

    #[inline(always)]
    fn finish(self, rays: &Rays<S>, inside: Mask<S>, limit: Float<S>, id: Word<S>) -> HitMask<S> {
        // Sign of the distance without the division. For a parallel ray the product is 0, which is not
        // ahead.
        let ahead = (self.numerator * self.denominator).simd_gt(0.0);
        let candidate = inside & ahead & rays.start.simd_ne(id);
        if !candidate.any_true() {
            return None;
        }
        let t = self.numerator / self.denominator;
        Some((candidate & t.simd_gt(0.0) & t.simd_lt(limit), t))
    }
}
