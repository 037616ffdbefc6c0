//! Triangle intersection in f64, and shading normals.
//!
//! # Watertightness
//! Corners are transformed to a coordinate system with the ray as z axis: their x and y are rounded once
//! each, independently of the triangle that they belong to. The ray hits a triangle if it is on one side
//! of all three edges, by the signs of edge functions. These never have the wrong sign: rounding is
//! monotonic, so that the difference of two products at worst becomes 0, and the same edge of a neighbour
//! has the same two products with opposite sign. So a ray through a closed mesh hits it, at edges and
//! corners too. An edge function of 0 only tells that the ray meets the line of an edge: a triangle seen
//! edge-on lies on that line however far away, and is hit only if the ray is also within the bounds of
//! its corners (Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013, whose
//! shear is a rotation here).
//!
//! # Normals
//! A facet is shaded with its geometric normal. With vertex normals, the BSDF uses their interpolation,
//! or the result of a normal map, while the geometric normal decides which side is outside: a direction
//! below the triangle carries no light (Pharr, Jakob and Humphreys, "Physically Based Rendering", 4th
//! edition, section 9.1.1, on light leaks). So shading may lose light near silhouettes and terminators
//! but never adds any. Where the mirror direction of the viewer would be below, the normal is turned
//! towards the viewer until it is not (Keller et al., "The Iray Light Transport Simulation and Rendering
//! System", 2017, appendix A.3).
//!
//! # Bodies
//! Meshes of a dielectric are closed, with corners counterclockwise as seen from outside, so that the
//! side that is hit tells whether a ray was inside. A ray that continues inside may hit the triangle on
//! which it starts only on its way out, after a scattering event inside: from the surface it leads away.
//! Refracted light goes to the side of the triangle to which the shading normal sends it, or is lost.
//!
//! # Opacity
//! Where a material's [`crate::Opacity`] lets a ray pass, the triangle is not hit: each ray, shadow rays
//! included, decides by a hash of itself and the triangle. That is unbiased for any number of layers in
//! any order, needs no random number of the path, and costs nothing for opaque scenes.

use glam::DVec3;

use super::normal_map::mapped_normal;
use super::ray::{Ray, RayOrigin, vector};
use crate::CompiledScene;
use crate::bvh::Bvh;
use crate::compiled::{Primitive, ShapeKind, TriangleData};

/// Least sine of the elevation of the viewer's mirror direction above the triangle.
pub const REFLECTION_SINE_MIN: f64 = 1e-3;
/// Relative rounding error of a point interpolated between corners in f32, over their coordinates: seven
/// roundings, and as much again for subsequent operations.
pub const POINT_ROUNDING: f32 = 14.0 * 0.5 * f32::EPSILON;
/// Number of triangles from which scalar rays use the BVH.
const BVH_MIN: usize = 16;

/// Origin and coordinate axes of a ray; the third is its direction.
#[derive(Clone, Copy, Debug)]
pub struct RayFrame {
    origin: DVec3,
    axes: [DVec3; 3],
}

/// Hit of a ray on a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleHit {
    /// Distance, metres; negative behind the ray's origin.
    pub t: f64,
    /// Barycentric coordinates, whose sum is 1.
    pub barycentric: [f64; 3],
    /// Whether the ray leaves the body through it: it sees the corners clockwise.
    pub is_left: bool,
}

impl RayFrame {
    /// Coordinate system of a ray.
    pub fn new(ray: &Ray) -> Self {
        let (u, v) = ray.direction.any_orthonormal_pair();
        Self {
            origin: ray.origin,
            axes: [u, v, ray.direction],
        }
    }

    /// Intersection with a triangle, ahead or behind; `None` also for one that is seen edge-on.
    pub fn intersect(&self, triangle: &TriangleData) -> Option<TriangleHit> {
        let seen = |corner: [f32; 3]| {
            let from_origin = vector(corner) - self.origin;
            DVec3::from(self.axes.map(|axis| axis.dot(from_origin)))
        };
        let [a, b, c] = [triangle.a, triangle.b, triangle.c].map(seen);
        let edge = |from: DVec3, to: DVec3| from.x * to.y - from.y * to.x;
        let weights = [edge(b, c), edge(c, a), edge(a, b)];
        let is_inside = weights.iter().all(|&w| w >= 0.0) || weights.iter().all(|&w| w <= 0.0);
        let sum: f64 = weights.iter().sum();
        let is_on_line = weights.contains(&0.0);
        let (min, max) = (a.min(b).min(c), a.max(b).max(c));
        let is_in_bounds = min.x.max(min.y) <= 0.0 && max.x.min(max.y) >= 0.0;
        // Written so that NaN misses.
        let is_met = is_inside && (is_in_bounds || !is_on_line) && sum.abs() > 0.0;
        is_met.then(|| {
            let barycentric = weights.map(|weight| weight / sum);
            TriangleHit {
                t: DVec3::from(barycentric).dot(DVec3::new(a.z, b.z, c.z)),
                barycentric,
                is_left: sum > 0.0,
            }
        })
    }
}

/// Distance and index of the nearest triangle ahead of a ray, before `t_max` if given; at equal distances
/// the first.
pub(super) fn nearest_triangle(
    scene: &CompiledScene,
    ray: &Ray,
    start: Option<RayOrigin>,
    t_max: Option<f64>,
) -> Option<(f64, u32)> {
    let triangles = &scene.meshes.triangles[..];
    if triangles.is_empty() {
        return None;
    }
    let frame = RayFrame::new(ray);
    let t_max = t_max.unwrap_or(f64::INFINITY);
    let mut nearest = (t_max, u32::MAX);
    let alpha_test = scene.alpha_test();
    let (origin, direction) = (ray.origin.as_vec3(), ray.direction.as_vec3());
    let is_there = |index: u32, met: &TriangleHit| {
        let weights = || met.barycentric.map(|weight| weight as f32);
        alpha_test.is_none_or(|test| test.is_met(origin, direction, index, weights))
    };
    // A ray cannot hit the flat primitive again that it leaves, unless it has been scattered in the body
    // behind it.
    let is_skipped = |index: u32, met: &TriangleHit| {
        start.is_some_and(|start| {
            start.primitive == Primitive::Triangle(index) && !(start.is_inside && met.is_left)
        })
    };
    let mut offer = |index: u32, t_max: &mut f64| {
        let met = frame.intersect(&triangles[index as usize]);
        if let Some(met) = met.filter(|met| met.t > 0.0 && !is_skipped(index, met))
            // By distance, then index, so that the result does not depend on the order of traversal.
            && (met.t, index) < nearest
            && is_there(index, &met)
        {
            nearest = (met.t, index);
            *t_max = met.t;
        }
    };
    match scene.bvh(ShapeKind::Triangle, BVH_MIN) {
        Some(bvh) => descend(bvh, ray, t_max, &mut offer),
        None => {
            let mut unused = t_max;
            (0..triangles.len() as u32).for_each(|index| offer(index, &mut unused));
        }
    }
    let (t, index) = nearest;
    (t < t_max).then_some((t, index))
}

/// Calls `offer` for the primitives of all leaves that a ray enters before `t_max`, which `offer` lowers.
fn descend(bvh: &Bvh, ray: &Ray, mut t_max: f64, offer: &mut impl FnMut(u32, &mut f64)) {
    let mut stack = vec![bvh.root];
    while let Some(part) = stack.pop() {
        if !enters(ray, [part.min, part.max].map(glam::Vec3::as_dvec3), t_max) {
            continue;
        }
        if !part.is_leaf() {
            stack.extend(bvh.nodes[part.node as usize]);
            continue;
        }
        let leaf = &bvh.order[part.first as usize..][..part.count as usize];
        for &index in leaf {
            offer(index, &mut t_max);
        }
    }
}

/// Whether a ray enters a box up to `t_max`; conservative with respect to rounding.
fn enters(ray: &Ray, [min, max]: [DVec3; 2], t_max: f64) -> bool {
    // Far more than the rounding error of f64.
    let slack = 1e-12 * (min.abs().max(max.abs()).max_element() + ray.origin.abs().max_element());
    let (mut near, mut far) = (0.0f64, t_max * (1.0 + 1e-12));
    for axis in 0..3 {
        let inverse = ray.direction[axis].recip();
        let to_min = (min[axis] - slack - ray.origin[axis]) * inverse;
        let to_max = (max[axis] + slack - ray.origin[axis]) * inverse;
        // 0 · ∞ = NaN, for a ray along a face, is ignored by `min` and `max`.
        near = near.max(to_min.min(to_max));
        far = far.min(to_min.max(to_max));
    }
    near <= far
}

/// Point and normals at a hit on a triangle.
pub(super) struct TriangleSurface {
    pub(super) point: DVec3,
    pub(super) n: DVec3,
    /// Shading normal, interpolated and mapped, on the side of `n`; `n` for a facet.
    pub(super) shading_n: DVec3,
}

impl TriangleSurface {
    pub(super) fn new(scene: &CompiledScene, index: u32, barycentric: [f64; 3]) -> Self {
        let triangle = &scene.meshes.triangles[index as usize];
        let [a, b, c] = [triangle.a, triangle.b, triangle.c].map(vector);
        let [wa, wb, wc] = barycentric;
        let n = (b - a).cross(c - a).normalize();
        let n_out = interpolated_normal(scene, index, barycentric).unwrap_or(n);
        let mapped = mapped_normal(scene, index, barycentric, n_out);
        let shading_n = facing(mapped, n_out, n);
        Self {
            point: wa * a + wb * b + wc * c,
            n,
            shading_n,
        }
    }
}

/// Unit normal interpolated between the vertex normals of a triangle, if it has any.
pub(super) fn interpolated_normal(
    scene: &CompiledScene,
    index: u32,
    [wa, wb, wc]: [f64; 3],
) -> Option<DVec3> {
    let triangle = &scene.meshes.triangles[index as usize];
    let normals = scene.meshes.normals.get(triangle.normals as usize)?;
    let [na, nb, nc] = [normals.a, normals.b, normals.c].map(vector);
    (wa * na + wb * nb + wc * nc).try_normalize()
}

/// The mapped normal on the side of the geometric normal `n`; `n_out` is the normal before mapping.
pub(super) fn facing(mapped: DVec3, n_out: DVec3, n: DVec3) -> DVec3 {
    match mapped == n_out {
        true => n_out * side(n_out.dot(n)),
        false => above(mapped * side(n_out.dot(n)), n),
    }
}

/// Shading normal as seen from `wo`: `shading_n`, turned until the mirror direction of `wo` is above the
/// surface with geometric normal `n`. All are unit vectors; `wo` and `shading_n` are on the side of `n`.
pub fn visible_shading_normal(shading_n: DVec3, n: DVec3, wo: DVec3) -> DVec3 {
    let reflected = 2.0 * wo.dot(shading_n) * shading_n - wo;
    let sine = reflected.dot(n);
    if sine >= REFLECTION_SINE_MIN {
        return shading_n;
    }
    let lifted = reflected + (REFLECTION_SINE_MIN - sine) * n;
    (wo + lifted.normalize()).normalize()
}

/// A mapped normal, lifted above the surface with normal `n`.
fn above(mapped: DVec3, n: DVec3) -> DVec3 {
    let sine = mapped.dot(n);
    match sine >= REFLECTION_SINE_MIN {
        true => mapped,
        false => (mapped + (REFLECTION_SINE_MIN - sine) * n).normalize(),
    }
}

fn side(cosine: f64) -> f64 {
    if cosine < 0.0 { -1.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::test_scenes::globe_with_rays;
    use crate::compiled::BvhUse;
    use crate::sampling::uniforms;
    use crate::scalar::intersect;

    #[test]
    fn no_ray_passes_an_edge_or_a_corner_of_a_closed_mesh() {
        let (mut scene, rays) = globe_with_rays();
        for (origin, direction) in rays {
            let (origin, direction) = (origin.as_dvec3(), direction.as_dvec3().normalize());
            let ray = Ray { origin, direction };
            let [each, by_bvh] = [BvhUse::Never, BvhUse::Always].map(|bvh_use| {
                scene.bvh_use = bvh_use;
                intersect(&scene, &ray)
            });
            assert!(each.is_some(), "{ray:?}");
            assert_eq!(each, by_bvh, "{ray:?}");
        }
    }

    #[test]
    fn mirrors_show_what_is_above_the_surface() {
        for i in 0..10_000 {
            let [a, b, c, d] = uniforms(i, 1, 2, 3).map(f64::from);
            let upper = |a: f64, b: f64| {
                let (sin, cos) = (std::f64::consts::TAU * a).sin_cos();
                let z = b.max(1e-6);
                DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
            };
            let (shading_n, wo) = (upper(a, b), upper(c, d * d));
            let n = visible_shading_normal(shading_n, DVec3::Z, wo);
            let reflected = 2.0 * wo.dot(n) * n - wo;
            assert!(reflected.z > 0.5 * REFLECTION_SINE_MIN, "{shading_n} {wo}");
            assert!(wo.dot(n) > 0.0 && (n.length() - 1.0).abs() < 1e-12);
        }
    }
}
