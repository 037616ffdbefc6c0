//! Next-event estimation from inside a dielectric ball, one path per lane: the arithmetic of
//! [`crate::scalar::refracted_nee`].

use std::f32::consts::PI;

use fearless_simd::prelude::*;

use super::area_light::LightSample;
use super::fresnel::fresnel;
use super::lanes::{Float, Mask, Vec3x, Word};
use super::math::exp;
use super::microfacet::untagged;
use super::rows::Rows;
use crate::compiled::{MaterialData, SphereData};

/// One row per ball.
pub(super) type NeeBoundaryRow = [f32; 8];

const CENTER: usize = 0;
/// Radius, metres; 0 for a ball that does not allow refracted next-event estimation.
const RADIUS: usize = 3;
const IOR: usize = 4;
const EXTINCTION: usize = 5;

pub(super) fn nee_boundary_row(sphere: &SphereData, material: &MaterialData) -> NeeBoundaryRow {
    let mut row = [0.0; 8];
    row[CENTER..][..3].copy_from_slice(&sphere.center);
    row[RADIUS] = if sphere.allows_refracted_nee == 1 {
        sphere.radius
    } else {
        0.0
    };
    row[IOR] = material.ior;
    row[EXTINCTION..][..3].copy_from_slice(&material.extinction);
    row
}

/// The ball around each path of a packet.
pub(super) struct NeeBoundaries<S: Simd> {
    /// Lanes inside a ball that allows it, or at its boundary.
    pub(super) lanes: Mask<S>,
    center: Vec3x<S>,
    radius: Float<S>,
    ior: Float<S>,
    extinction: Vec3x<S>,
}

/// Paths from inside to points on area lights, refracted at the boundary.
pub(super) struct RefractedPaths<S: Simd> {
    /// Lanes with such a path.
    pub(super) lanes: Mask<S>,
    /// Point of refraction on the boundary.
    pub(super) place: Vec3x<S>,
    /// Unit direction inside the ball.
    pub(super) inner: Vec3x<S>,
    /// Unit direction outside the ball.
    pub(super) outer: Vec3x<S>,
    /// Lengths inside and outside the ball, metres.
    pub(super) inside: Float<S>,
    pub(super) outside: Float<S>,
    /// Factor of the area light's radiance: phase function, transmittances and densities, if nothing
    /// occludes the path.
    pub(super) weight: Vec3x<S>,
}

/// Rays from inner points, each in the plane of the inner point's axis (x) and the outer point; lengths in
/// radii.
struct PlaneRays<S: Simd> {
    place: [Float<S>; 2],
    inner: [Float<S>; 2],
    outer: [Float<S>; 2],
    length: Float<S>,
    cos_i: Float<S>,
    cos_o: Float<S>,
}

impl<S: Simd> PlaneRays<S> {
    #[inline(always)]
    fn new(r: Float<S>, ior: Float<S>, sine: Float<S>) -> Self {
        let cos = cosine(sine);
        let cos_i = cosine(r * sine);
        let cos_o = cosine(ior * r * sine);
        // cos θi − r cos θ, expanded by its conjugate: near the boundary the difference would cancel.
        let length = (1.0 - r * r).max(0.0) / r.mul_add(cos, cos_i).max(TINY);
        let place = [length.mul_add(cos, r), length * sine];
        let power = cos_o - ior * cos_i;
        Self {
            place,
            inner: [cos, sine],
            // Snell's law in vector form: n·inner + (cos θo − n cos θi)·normal; `place` is the normal of
            // the unit ball.
            outer: [
                ior.mul_add(cos, power * place[0]),
                ior.mul_add(sine, power * place[1]),
            ],
            length,
            cos_i,
            cos_o,
        }
    }

    /// Signed distance of a point from the outer ray, positive on the side of larger angles.
    #[inline(always)]
    fn beside(&self, point: [Float<S>; 2]) -> Float<S> {
        // 2D cross product, positive where the point lies to the left of the ray.
        self.outer[0] * (point[1] - self.place[1]) - self.outer[1] * (point[0] - self.place[0])
    }

    /// Area across the ray at its end per solid angle at the inner point: derivation in
    /// [`crate::scalar::refracted_nee`].
    #[inline(always)]
    fn spread(&self, ior: Float<S>, outside: Float<S>) -> Float<S> {
        // Coddington's equations: see the scalar tracer's `spread`.
        let moved = self.length / self.cos_i.max(TINY);
        let bent = ior * self.cos_i / self.cos_o.max(TINY);
        let turned = bent.mul_add(1.0 - moved, moved);
        let in_plane = moved.mul_add(self.cos_o, outside * turned);
        let power = ior * self.cos_i - self.cos_o;
        in_plane * (ior - power * self.length).mul_add(outside, self.length)
    }
}

impl<S: Simd> NeeBoundaries<S> {
    /// Balls in `tag` for the lanes of `mask`; `None` if no lane is inside one.
    #[inline(always)]
    pub(super) fn new(
        simd: S,
        table: &[NeeBoundaryRow],
        tag: Word<S>,
        mask: Mask<S>,
    ) -> Option<Self> {
        let balls = Word::splat(simd, table.len() as u32);
        let body = untagged(tag);
        let mask = mask & body.simd_lt(balls);
        if !mask.any_true() {
            return None;
        }
        let rows = Rows::new(table, mask.select(body, Word::splat(simd, 0)));
        let radius = rows.number(simd, RADIUS);
        let lanes = mask & radius.simd_gt(0.0);
        if !lanes.any_true() {
            return None;
        }
        Some(Self {
            lanes,
            center: rows.triple(simd, CENTER),
            radius,
            ior: rows.number(simd, IOR),
            extinction: rows.triple(simd, EXTINCTION),
        })
    }

    /// Lanes whose ray, scattered inside, leaves after `length` at `cos_i` by a path that refracted
    /// next-event estimation covers.
    #[inline(always)]
    pub(super) fn are_left(&self, length: Float<S>, cos_i: Float<S>) -> Mask<S> {
        self.lanes & length.simd_le(self.radius * cos_i)
    }

    /// Refracted paths from points inside to sampled points on area lights with the given normals.
    #[inline(always)]
    pub(super) fn refracted_paths(
        &self,
        simd: S,
        from: Vec3x<S>,
        light: &LightSample<S>,
        normal: Vec3x<S>,
    ) -> RefractedPaths<S> {
        let per_radius = 1.0 / self.radius;
        let x = (from - self.center) * per_radius;
        let distance = light.distance * per_radius;
        let y = light.wi.mul_add(distance, x);
        let r = x.length_squared().sqrt();
        let axis = x * (1.0 / r.max(TINY));
        // At the centre every direction is an axis; the direction to the light needs no search.
        let axis = Vec3x::select(r.simd_gt(0.0), axis, light.wi);
        let along = y.dot(axis);
        let across = y - axis * along;
        let height = across.length_squared().sqrt();
        let side = across * (1.0 / height.max(TINY));
        let point = [along, height];
        let (sine, found) = search(simd, r, self.ior, point);
        let ray = PlaneRays::new(r, self.ior, sine);
        let offset = [point[0] - ray.place[0], point[1] - ray.place[1]];
        let outside = offset[0].mul_add(offset[0], offset[1] * offset[1]).sqrt();
        let inside = ray.length * self.radius;
        let outer = axis.mul_add(ray.outer[0], side * ray.outer[1]);
        let place = axis.mul_add(ray.place[0], side * ray.place[1]);

        let reflected = fresnel(simd, ray.cos_i, 1.0 / self.ior);
        // Radiance inside is higher by the square of the refractive index.
        let passed = (1.0 - reflected) * self.ior * self.ior;
        let cosines = outer.dot(normal) / light.wi.dot(normal);
        let spread = ray.spread(self.ior, outside);
        // The density of `light` is per solid angle of straight rays: d² / cos converts it to area on the
        // light, and the new cosine over the spread to solid angle inside. The units of length cancel.
        let inverse_pdf = light.inverse_pdf * (distance * distance) * cosines / spread;
        let left = self.extinction * -inside;
        let left = Vec3x::new(exp(simd, left.x), exp(simd, left.y), exp(simd, left.z));
        RefractedPaths {
            lanes: self.lanes & found & light.distance.simd_gt(0.0),
            place: place.mul_add(self.radius, self.center),
            inner: axis.mul_add(ray.inner[0], side * ray.inner[1]),
            outer,
            inside,
            outside: outside * self.radius,
            // 1 / 4π is the isotropic phase function.
            weight: left * (passed * inverse_pdf.max(0.0) * (0.25 / PI)),
        }
    }
}

/// Sine at the inner point of the ray to each outer point, and the lanes where there is one. Root search by
/// the Illinois variant of regula falsi.
#[inline(always)]
fn search<S: Simd>(
    simd: S,
    r: Float<S>,
    ior: Float<S>,
    point: [Float<S>; 2],
) -> (Float<S>, Mask<S>) {
    let (half, one) = (Float::splat(simd, 0.5), Float::splat(simd, 1.0));
    // Steeper rays are totally reflected, or leave through the other half of the ball.
    let sine_max = (1.0 / (ior * r).max(TINY)).min(one);
    let highest = highest(simd, r, point);
    let mut low = lowest(simd, r, point);
    let mut high = highest.min(sine_max);
    let mut found = low.simd_lt(high);
    let mut at_low = PlaneRays::new(r, ior, low).beside(point);
    let mut at_high = PlaneRays::new(r, ior, high).beside(point);
    found &= at_low.simd_ge(0.0) & (at_high.simd_le(0.0) | highest.simd_le(sine_max));
    at_high = at_high.min(0.0);
    let mut sine = low;
    let (mut moved_low, mut moved_high) = (Mask::splat(simd, false), Mask::splat(simd, false));
    // Fixed number of steps, so that lanes do not diverge and the GPU finds the same root.
    for _ in 0..SphereData::REFRACTED_NEE_STEPS {
        let part = at_low / (at_low - at_high).max(TINY);
        sine = part.mul_add(high - low, low);
        let at = PlaneRays::new(r, ior, sine).beside(point);
        let moves_low = at.simd_gt(0.0);
        let (halved_low, halved_high) = (at_low * half, at_high * half);
        // Illinois step: the value of an end that is kept twice is halved.
        let at_low_kept = (moved_high & !moves_low).select(halved_low, at_low);
        let at_high_kept = (moved_low & moves_low).select(halved_high, at_high);
        low = moves_low.select(sine, low);
        high = moves_low.select(high, sine);
        at_low = moves_low.select(at, at_low_kept);
        at_high = moves_low.select(at_high_kept, at);
        (moved_low, moved_high) = (moves_low, !moves_low);
    }
    (sine, found)
}

/// Sine of the first ray whose exit point the outer point can see; 2 if that is on the other half.
#[inline(always)]
fn lowest<S: Simd>(simd: S, r: Float<S>, [x, y]: [Float<S>; 2]) -> Float<S> {
    let cos = 1.0 / x.mul_add(x, y * y).sqrt();
    let sin = cosine(cos);
    let offset_x = cos * cos.mul_add(x, sin * y) - r;
    let offset_y = cos * (cos * y - sin * x);
    let sine = offset_y / offset_x.mul_add(offset_x, offset_y * offset_y).sqrt();
    let beyond = offset_x.simd_gt(0.0).select(sine, Float::splat(simd, 2.0));
    x.simd_ge(1.0).select(Float::splat(simd, 0.0), beyond)
}

/// Sine of the ray to the boundary point nearest to the outer point; 2 if that is on the other half.
#[inline(always)]
fn highest<S: Simd>(simd: S, r: Float<S>, [x, y]: [Float<S>; 2]) -> Float<S> {
    let per_length = 1.0 / x.mul_add(x, y * y).sqrt();
    let (offset_x, offset_y) = (x * per_length - r, y * per_length);
    let sine = offset_y / offset_x.mul_add(offset_x, offset_y * offset_y).sqrt();
    offset_x.simd_gt(0.0).select(sine, Float::splat(simd, 2.0))
}

#[inline(always)]
fn cosine<S: Simd>(sine: Float<S>) -> Float<S> {
    (1.0 - sine * sine).max(0.0).sqrt()
}

/// Lower bound of divisors.
const TINY: f32 = 1e-30;
