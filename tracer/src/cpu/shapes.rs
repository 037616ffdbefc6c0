//! Tests of rays against primitives, lane by lane: each its own, or all the same one.
//!
//! Each begins with its cheapest sufficient condition; the exact test runs only when some lane passes.

use std::marker::PhantomData;

use fearless_simd::prelude::*;

use super::lanes::{Float, Mask, Vec3x, Word};
use super::rays::{HitMask, INSIDE, Rays};
use crate::compiled::{AreaLightData, BoxData, DiscData, RectangleData, SphereData};

/// A shape whose primitives are `N` numbers.
pub(super) trait Shape<const N: usize> {
    /// From so many on, rays find them faster by a BVH: `carom-bench bvh --backend cpu`.
    const BVH_MIN: usize;

    /// What all tests of the same rays share.
    type Frame<S: Simd>: Copy;

    /// That of `rays`.
    fn frame<S: Simd>(simd: S, rays: &Rays<S>) -> Self::Frame<S>;

    /// Where rays meet `primitives` before `limit`, and how far away; none if no lane may.
    fn intersect<S: Simd>(
        rays: &Rays<S>,
        frame: &Self::Frame<S>,
        primitives: &Primitives<S, N>,
        limit: Float<S>,
    ) -> HitMask<S>;
}

/// A primitive per lane. One whose numbers are NaN is not met.
pub(super) struct Primitives<S: Simd, const N: usize> {
    pub(super) numbers: [Float<S>; N],
    pub(super) id: Word<S>,
    /// Some are dielectrics: rays that are inside of one meet its far side.
    pub(super) has_dielectric: bool,
}

impl<S: Simd, const N: usize> Primitives<S, N> {
    /// Three of the numbers.
    #[inline(always)]
    pub(super) fn vector(&self, first: usize) -> Vec3x<S> {
        Vec3x::new(
            self.numbers[first],
            self.numbers[first + 1],
            self.numbers[first + 2],
        )
    }
}

/// A primitive, whose shape is `F`.
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

    /// The same in all lanes.
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

/// No ray passes outside this radius and hits, whatever the rounding of the quick test.
fn reject_radius(radius: f32, reach: f32) -> f32 {
    // The first term covers the rounding of squares near the radius, the second that of coordinates as
    // large as `reach`. Too large a radius only costs the exact test; too small a one would lose hits.
    radius * 1.000_01 + reach * (8.0 * f32::EPSILON)
}

/// A sphere: centre, radius, and the radius of the quick test with its square.
pub(super) struct Sphere;

impl Sphere {
    /// None if it is hidden. `reach` is an upper bound of the distance from any ray's origin.
    pub(super) fn numbers(sphere: &SphereData, reach: f32) -> Option<[f32; 6]> {
        let [x, y, z] = sphere.center;
        let radius = sphere.radius;
        let reject = reject_radius(radius, reach);
        (radius > 0.0).then_some([x, y, z, radius, reject, reject * reject])
    }
}

impl Shape<6> for Sphere {
    /// With AVX-512 faster by 1.4 for 512 and 2.2 for 1024; slower by 2 % for 256.
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
        // The second condition drops spheres behind the origin. It holds by more than the radius, since
        // an origin inside has its closest point up to a radius back.
        let candidate = miss_squared.simd_le(reject_squared) & closest.simd_gt(-reject);
        if !candidate.any_true() {
            return None;
        }
        let chord = Chord::new(rays.origin, rays.direction, center, radius);
        let mut t = chord.first();
        let mut hit = chord.real & t.simd_gt(0.0);
        if primitives.has_dielectric {
            // A ray inside has to come out. It hits even where rounding leaves no real chord, as of a ray
            // that grazes: `half` is 0 there, and the path leaves where it is instead of being lost in
            // the body.
            let within = rays.start.simd_eq(primitives.id | INSIDE);
            // Rounding may put the far side behind an origin that lies on it.
            t = within.select(chord.far.max(0.0), t);
            hit |= within;
        }
        // Strictly before the limit: of primitives at the same distance the first keeps the ray.
        let hit = hit & t.simd_lt(limit) & rays.start.simd_ne(primitives.id);
        Some((hit, t))
    }
}

/// The part of a line inside a sphere, right in f32 however far the origin is: the difference of
/// origin and centre keeps its rounding error (Knuth's TwoDiff), and the foot of the perpendicular
/// is projected twice. Haines et al., "Precision Improvements for Ray/Sphere Intersection", Ray
/// Tracing Gems ch. 7, 2019, goes halfway.
pub(super) struct Chord<S: Simd> {
    /// From the centre to the line, at right angles to it.
    perpendicular: Vec3x<S>,
    half: Float<S>,
    near: Float<S>,
    pub(super) far: Float<S>,
    /// Where line and sphere meet.
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
        // What the differences lost to rounding: 0.6 m for an eye 10,000 km away, twenty radii of a
        // pool ball.
        let error = Vec3x::new(x_error, y_error, z_error);
        let closest = -Vec3x::new(x, y, z).dot(direction);
        // The products cancel against x, y and z: without fused rounding nothing would be left.
        let rough = Vec3x::new(
            direction.x.mul_add_precise(closest, x),
            direction.y.mul_add_precise(closest, y),
            direction.z.mul_add_precise(closest, z),
        ) + error;
        // Projected again: what `closest` lost to rounding still lies along the ray.
        let correction = -rough.dot(direction);
        let perpendicular = direction.mul_add(correction, rough);
        // r² − |p|² with p across the line: b² − 4ac of the usual quadratic cancels by as many digits as
        // the origin is radii away.
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

    /// Distance along the ray to the first meeting point that is ahead.
    #[inline(always)]
    pub(super) fn first(&self) -> Float<S> {
        self.near.simd_gt(0.0).select(self.near, self.far)
    }

    /// That point as seen from the centre, which keeps the digits that `origin + t · direction`
    /// has lost; for rays `within` the sphere, the far one.
    #[inline(always)]
    pub(super) fn first_from_center(&self, direction: Vec3x<S>, within: Mask<S>) -> Vec3x<S> {
        let is_near = self.near.simd_gt(0.0) & !within;
        let half = is_near.select(-self.half, self.half);
        direction.mul_add(half, self.perpendicular)
    }
}

/// `a − b` and what rounding took from it.
#[inline(always)]
fn two_diff<S: Simd>(a: Float<S>, b: Float<S>) -> (Float<S>, Float<S>) {
    let difference = a - b;
    // Knuth's TwoSum of a and −b. No fused or reordered operation may stand here, or the error comes out
    // as 0.
    let b_part = difference - a;
    (difference, (a - (difference - b_part)) - (b + b_part))
}

/// An axis-aligned box as three slabs: centre and half extents.
pub(super) struct AlignedBox;

impl AlignedBox {
    pub(super) fn numbers(data: &BoxData) -> [f32; 6] {
        let center: [f32; 3] = std::array::from_fn(|i| 0.5 * (data.min[i] + data.max[i]));
        // Rounded up, so that rays within a face and through an edge hit.
        let half: [f32; 3] = std::array::from_fn(|i| {
            let half = (data.max[i] - center[i]).max(center[i] - data.min[i]);
            half.next_up().next_up()
        });
        join([center, half])
    }
}

impl Shape<6> for AlignedBox {
    /// Equal there; faster by 1.4 for 512 and 2.3 for 1024.
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
        // By centre and half extent, |1/d| tells near from far; corners would need a minimum and a
        // maximum per axis.
        let middle = to_center.scale(rays.inverse);
        let half = primitives.vector(3);
        let near = (-half).scale_add(rays.inverse_abs, middle);
        let far = half.scale_add(rays.inverse_abs, middle);
        let entry = near.x.max(near.y).max(near.z);
        let exit = far.x.min(far.y).min(far.z);
        // Rays that are parallel to a slab have |1/d| ≤ 1e30 instead of ∞, so that both distances are of
        // one sign and huge outside of it, and of two inside; 0 · ∞ would be NaN.
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

/// A disc: centre, normal and the square of the radius.
pub(super) struct Disc;

impl Disc {
    pub(super) fn numbers(disc: &DiscData) -> [f32; 7] {
        let ([x, y, z], [nx, ny, nz]) = (disc.center, disc.normal);
        [x, y, z, nx, ny, nz, disc.radius * disc.radius]
    }
}

impl Shape<7> for Disc {
    /// Equal there; faster by 1.4 for 192 and 3.4 for 1024.
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
        // |p|² ≤ r² with both sides times the denominator squared.
        let bound = crossing.denominator * crossing.denominator * primitives.numbers[6];
        let inside = crossing.from_center.length_squared().simd_le(bound);
        crossing.finish(rays, inside, limit, primitives.id)
    }
}

/// A rectangle, of an object or an area light: centre, normal, and half edges over their squared length, so that
/// dot products with them are in [−1, 1] inside.
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
    /// Faster by 1.1 there, 1.6 for 192 and 4.0 for 1024.
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

/// Where rays cross a plane, as fractions: most crossings lie outside the shape and need no
/// division.
struct Crossing<S: Simd> {
    numerator: Float<S>,
    denominator: Float<S>,
    /// From the centre to the crossing, times the denominator.
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
        // The sign of the distance without the division. Of a parallel ray the product is 0, which is not
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
