//! Triangle intersection, one triangle per lane: the arithmetic of [`crate::scalar::triangle`].

use std::sync::Arc;

use fearless_simd::prelude::*;

use super::beam::{Beam, BoundsGroups};
use super::bvh16::{Bvh16, HitFilter, Solid};
use super::lanes::{Float, LANES, Mask, Vec3x, has_zero};
use super::rays::{HitMask, INSIDE, Nearest, Rays};
use super::sampling::basis;
use super::shapes::{PackedPrimitive, Primitives, Shape, join};
use super::shared_edges::SharedEdges;
use crate::CompiledScene;
use crate::bvh::Bounds;
use crate::compiled::clusters::Clusters;
use crate::compiled::{
    AlphaTest, CompiledTextures, KIND_DIELECTRIC, MaterialData, ShapeKind, TriangleColors,
    TriangleData, TriangleUvs, corner_weights,
};

/// Triangle, described by its corners.
pub(super) struct Triangle;

/// Two axes orthogonal to each ray, which complete it to an orthonormal basis.
#[derive(Clone, Copy)]
pub(super) struct RayAxes<S: Simd> {
    pub(super) u: Vec3x<S>,
    pub(super) v: Vec3x<S>,
}

/// A triangle in the coordinate system of a ray.
pub(super) struct Seen<S: Simd> {
    /// Unnormalised barycentric coordinates of the ray's intersection with the plane.
    pub(super) weights: [Float<S>; 3],
    /// Coordinates of the corners orthogonal to the ray, and along it.
    x: [Float<S>; 3],
    y: [Float<S>; 3],
    along: [Float<S>; 3],
}

impl<S: Simd> Seen<S> {
    #[inline(always)]
    pub(super) fn new(
        origin: Vec3x<S>,
        direction: Vec3x<S>,
        axes: &RayAxes<S>,
        corners: [Vec3x<S>; 3],
    ) -> Self {
        // Written out, here and below: closures passed to `array::map` are compiled for the baseline
        // instruction set.
        let (a, b, c) = (
            corners[0] - origin,
            corners[1] - origin,
            corners[2] - origin,
        );
        let across = |p: Vec3x<S>| (axes.u.dot(p), axes.v.dot(p));
        let [(ax, ay), (bx, by), (cx, cy)] = [across(a), across(b), across(c)];
        // Each product is rounded separately, for watertight edges: see the scalar tracer.
        Self {
            weights: [bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx],
            x: [ax, bx, cx],
            y: [ay, by, cy],
            along: [direction.dot(a), direction.dot(b), direction.dot(c)],
        }
    }

    /// Whether the ray is within the bounds of the corners; exact, as only signs are compared.
    #[inline(always)]
    fn is_in_bounds(&self) -> Mask<S> {
        has_zero(self.x) & has_zero(self.y)
    }

    /// Sum of the weights: twice the signed projected area.
    #[inline(always)]
    pub(super) fn sum(&self) -> Float<S> {
        let [a, b, c] = self.weights;
        a + b + c
    }
}

impl Triangle {
    fn numbers(triangle: &TriangleData) -> [f32; 9] {
        join([triangle.a, triangle.b, triangle.c])
    }
}

impl Shape<9> for Triangle {
    /// The BVH is faster by 1.08 for 64 and 1.3 for 96: `carom-bench bvh --backend cpu --shape triangles`.
    const BVH_MIN: usize = 64;

    type Frame<S: Simd> = RayAxes<S>;

    #[inline(always)]
    fn frame<S: Simd>(simd: S, rays: &Rays<S>) -> RayAxes<S> {
        let (u, v) = basis(simd, rays.direction);
        RayAxes { u, v }
    }

    #[inline(always)]
    fn intersect<S: Simd>(
        rays: &Rays<S>,
        axes: &RayAxes<S>,
        primitives: &Primitives<S, 9>,
        limit: Float<S>,
    ) -> HitMask<S> {
        let corners = [
            primitives.vector(0),
            primitives.vector(3),
            primitives.vector(6),
        ];
        let seen = Seen::new(rays.origin, rays.direction, axes, corners);
        let [a, b, c] = seen.weights;
        let is_left = a.simd_ge(0.0) & b.simd_ge(0.0) & c.simd_ge(0.0);
        let is_right = a.simd_le(0.0) & b.simd_le(0.0) & c.simd_le(0.0);
        let mut candidate = (is_left | is_right) & rays.start.simd_ne(primitives.id);
        if !candidate.any_true() {
            return None;
        }
        if primitives.has_dielectric {
            let within = rays.start.simd_eq(primitives.id | INSIDE);
            // A ray that starts on this triangle inside the body hits it only on its way out, after
            // scattering inside. Without scattering it leads away from the triangle, and rounding must not
            // hit it again.
            candidate &= !within | seen.sum().simd_gt(0.0);
        }
        let on_line = a.simd_eq(0.0) | b.simd_eq(0.0) | c.simd_eq(0.0);
        if (candidate & on_line).any_true() {
            // A triangle seen edge-on has weights 0 and would be hit by every ray in its plane.
            candidate &= seen.is_in_bounds() | !on_line;
        }
        let (sum, [along_a, along_b, along_c]) = (seen.sum(), seen.along);
        let t = a.mul_add(along_a, b.mul_add(along_b, c * along_c)) / sum;
        let ahead = t.simd_gt(0.0) & t.simd_lt(limit) & sum.abs().simd_gt(0.0);
        Some((candidate & ahead, t))
    }
}

/// All triangles of a scene, with the acceleration structures over them.
pub(super) struct Triangles {
    /// Empty if the triangles are in the BVH.
    each: Vec<PackedPrimitive<Triangle, 9>>,
    bounds: BoundsGroups,
    /// The same triangles for incoherent rays, if they share enough edges.
    shared_edges: Option<SharedEdges>,
    bvh: Option<Arc<Bvh16<Triangle, 9>>>,
    /// `None` if all triangles are opaque.
    alpha_filter: Option<AlphaFilter>,
}

/// Tables for opacity and emission at points of triangles.
pub(super) struct TriangleTables {
    materials: Vec<MaterialData>,
    triangles: Arc<Vec<TriangleData>>,
    uvs: Arc<Vec<TriangleUvs>>,
    colors: Arc<Vec<TriangleColors>>,
    textures: CompiledTextures,
}

impl TriangleTables {
    pub(super) fn new(scene: &CompiledScene) -> Self {
        let meshes = &scene.meshes;
        Self {
            materials: scene.materials.clone(),
            triangles: Arc::clone(&meshes.triangles),
            uvs: Arc::clone(&meshes.uvs),
            colors: Arc::clone(&meshes.colors),
            textures: scene.textures.clone(),
        }
    }

    pub(super) fn alpha_test(&self) -> AlphaTest<'_> {
        AlphaTest {
            materials: &self.materials,
            triangles: &self.triangles,
            uvs: &self.uvs,
            colors: &self.colors,
            textures: &self.textures,
        }
    }
}

/// Filter that lets rays pass through triangles according to their opacity.
struct AlphaFilter {
    /// Materials, texture coordinates and textures.
    tables: TriangleTables,
    /// Id of the first triangle.
    first: u32,
}

impl AlphaFilter {
    /// `None` if all triangles are opaque.
    fn new(scene: &CompiledScene, first: u32) -> Option<Self> {
        scene.alpha_test()?;
        let tables = TriangleTables::new(scene);
        Some(Self { tables, first })
    }

    /// The lanes of `hit` whose rays the triangle `id` stops.
    #[inline(never)]
    fn met<S: Simd>(&self, simd: S, rays: &Rays<S>, hit: Mask<S>, id: u32) -> Mask<S> {
        let columns = |v: Vec3x<S>| [v.x.to_array(), v.y.to_array(), v.z.to_array()];
        let (origins, directions) = (columns(rays.origin), columns(rays.direction));
        let bits = hit.to_bitmask();
        let hits = (0..LANES).filter(|lane| bits >> lane & 1 == 1);
        let met = hits.filter(|&lane| {
            let of_lane = |columns: &[[f32; LANES]; 3]| columns.map(|column| column[lane]);
            self.is_met(of_lane(&origins), of_lane(&directions), id)
        });
        Mask::from_bitmask(simd, met.fold(0, |bits, lane| bits | 1 << lane))
    }
}

impl HitFilter for AlphaFilter {
    #[inline(always)]
    fn is_some(&self) -> bool {
        true
    }

    #[inline(never)]
    fn is_met(&self, origin: [f32; 3], direction: [f32; 3], id: u32) -> bool {
        let index = id - self.first;
        let test = self.tables.alpha_test();
        let (origin, direction) = (origin.into(), direction.into());
        let triangle = &test.triangles[index as usize];
        // Weights are recomputed from the ray, one lane at a time: few hits reach a texture look-up, and
        // the traversal need not keep weights.
        let weights = || corner_weights(triangle, origin, direction);
        test.is_met(origin, direction, index, weights)
    }
}

impl Triangles {
    /// Triangles with ids from `first` on; `reach` as in [`BoundsGroups::new`]. The wide BVH is cached with
    /// the scene.
    pub(super) fn new(scene: &CompiledScene, first: u32, reach: f32) -> Self {
        let each = || {
            let triangles = scene.meshes.triangles.iter().zip(first..);
            triangles.map(|(data, id)| {
                let material = &scene.materials[data.material as usize];
                let is_dielectric = material.kind == KIND_DIELECTRIC;
                PackedPrimitive::new(Triangle::numbers(data), id, is_dielectric)
            })
        };
        let Some(bvh) = scene.bvh(ShapeKind::Triangle, Triangle::BVH_MIN) else {
            let bounds = scene.meshes.triangles.iter().map(Bounds::from);
            let alpha_filter = AlphaFilter::new(scene, first);
            return Self {
                each: each().collect(),
                bounds: BoundsGroups::new(bounds, Clusters::NONE, reach),
                shared_edges: match alpha_filter {
                    None => shared_edges(scene, first),
                    Some(_) => None,
                },
                bvh: None,
                alpha_filter,
            };
        };
        // Meshes do not change from frame to frame: the wide BVH is built once and shared by all frames.
        let bvh = scene.meshes.layout.get_or_make(|| {
            let each: Vec<_> = each().map(Some).collect();
            Bvh16::new(bvh, &each)
        });
        Self {
            each: Vec::new(),
            bounds: BoundsGroups::new([], Clusters::NONE, reach),
            shared_edges: None,
            bvh: Some(bvh),
            alpha_filter: AlphaFilter::new(scene, first),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.each.is_empty() && self.bvh.is_none()
    }

    /// Updates `nearest` by hits that are nearer. Not inlined, so that scenes without meshes do not pay for
    /// it.
    #[inline(never)]
    pub(super) fn nearest<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        beam: Option<&Beam>,
        nearest: &mut Nearest<S>,
    ) {
        if let Some(bvh) = &self.bvh {
            match (&self.alpha_filter, beam) {
                (None, None) => bvh.nearest(simd, rays, nearest, &Solid),
                (None, Some(beam)) => bvh.nearest_in_beam(simd, rays, beam, nearest),
                // Opacity is tested per ray, so that a beam saves nothing here.
                (Some(filter), _) => bvh.nearest(simd, rays, nearest, filter),
            }
            return;
        }
        if let (Some(shared_edges), None) = (&self.shared_edges, beam) {
            shared_edges.nearest(simd, rays, nearest);
            return;
        }
        simd.vectorize(
            #[inline(always)]
            || {
                let axes = Triangle::frame(simd, rays);
                for group in 0..self.bounds.len() {
                    for index in self.bounds.met(simd, group, rays, beam, nearest.distance) {
                        let one = &self.each[index];
                        let triangle = one.splat(simd);
                        let mut met = Triangle::intersect(rays, &axes, &triangle, nearest.distance);
                        if let (Some(filter), Some((hit, _))) = (&self.alpha_filter, &mut met) {
                            *hit = filter.met(simd, rays, *hit, one.id);
                        }
                        nearest.update(met, one.id);
                    }
                }
            },
        );
    }

    /// Sets the lanes in `dark` whose ray hits a triangle before `distance`.
    #[inline(never)]
    pub(super) fn occlude<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        beam: Option<&Beam>,
        distance: Float<S>,
        dark: &mut Mask<S>,
    ) {
        if let Some(bvh) = &self.bvh {
            match &self.alpha_filter {
                None => bvh.occlude(simd, rays, distance, dark, &Solid),
                Some(filter) => bvh.occlude(simd, rays, distance, dark, filter),
            }
            return;
        }
        if let (Some(shared_edges), None) = (&self.shared_edges, beam) {
            shared_edges.occlude(simd, rays, distance, dark);
            return;
        }
        simd.vectorize(
            #[inline(always)]
            || {
                let axes = Triangle::frame(simd, rays);
                for group in 0..self.bounds.len() {
                    for index in self.bounds.met(simd, group, rays, beam, distance) {
                        let one = &self.each[index];
                        let triangle = one.splat(simd);
                        let met = Triangle::intersect(rays, &axes, &triangle, distance);
                        let Some((hit, _)) = met else {
                            continue;
                        };
                        *dark |= match &self.alpha_filter {
                            None => hit,
                            Some(filter) => filter.met(simd, rays, hit, one.id),
                        };
                    }
                }
            },
        );
    }
}

fn shared_edges(scene: &CompiledScene, first: u32) -> Option<SharedEdges> {
    let triangles = scene.meshes.triangles.iter().map(|data| {
        let material = &scene.materials[data.material as usize];
        let corners = [data.a, data.b, data.c];
        (corners, material.kind == KIND_DIELECTRIC)
    });
    SharedEdges::new(triangles, first)
}

#[cfg(test)]
mod tests {
    use super::super::geometry::Geometry;
    use super::super::lanes::Word;
    use super::super::rays::NONE;
    use super::*;
    use crate::CpuTracer;
    use crate::bvh::test_scenes::globe_with_rays;
    use crate::compiled::BvhUse;
    use crate::simd::dispatch;

    #[inline(always)]
    fn ids<S: Simd>(simd: S, geometry: &Geometry, six: &[[f32; LANES]; 6]) -> [u32; LANES] {
        let [ox, oy, oz, dx, dy, dz] = six.map(|column| Float::load_array(simd, column));
        let (origin, direction) = (Vec3x::new(ox, oy, oz), Vec3x::new(dx, dy, dz));
        let rays = Rays::new(simd, origin, direction, Word::splat(simd, NONE));
        geometry.nearest(simd, &rays, None).id.to_array()
    }

    #[test]
    fn no_ray_passes_an_edge_or_a_corner_of_a_closed_mesh() {
        let (mut scene, rays) = globe_with_rays();
        for bvh_use in [BvhUse::Never, BvhUse::Always] {
            scene.bvh_use = bvh_use;
            let geometry = Geometry::new(&scene);
            for level in CpuTracer::levels_available() {
                for packet in rays.chunks_exact(LANES) {
                    let mut six = [[0.0; LANES]; 6];
                    for (lane, (origin, direction)) in packet.iter().enumerate() {
                        for axis in 0..3 {
                            six[axis][lane] = origin[axis];
                            six[axis + 3][lane] = direction[axis];
                        }
                    }
                    let ids = dispatch!(level, simd => ids(simd, &geometry, &six));
                    assert!(!ids.contains(&NONE), "{level:?}, {bvh_use:?}: {packet:?}");
                }
            }
        }
    }
}
