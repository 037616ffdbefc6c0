//! Triangles, a lane each: the arithmetic of [`crate::scalar::triangle`].

use std::sync::Arc;

use fearless_simd::prelude::*;

use super::beam::{Beam, BoundsGroups};
use super::bvh16::{Bvh16, HitFilter, Solid};
use super::image_texture::{LaneHit, LayerColumns, TextureColumns, TextureLanes, TriangleTextures};
use super::lanes::{Float, LANES, Mask, Vec3x, Word};
use super::rays::{HitMask, INSIDE, Nearest, Rays};
use super::sampling::basis;
use super::shapes::{PackedPrimitive, Primitives, Shape, join};
use crate::CompiledScene;
use crate::bvh::Bounds;
use crate::compiled::{
    AlphaTest, CompiledTextures, KIND_DIELECTRIC, MaterialData, ShapeKind, TriangleColors,
    TriangleData, TriangleNormals, TriangleUvs, corner_weights,
};
use crate::scalar::triangle::{POINT_ROUNDING, REFLECTION_SINE_MIN};

/// A triangle: its corners.
pub(super) struct Triangle;

/// Two axes across each ray.
#[derive(Clone, Copy)]
pub(super) struct RayAxes<S: Simd> {
    u: Vec3x<S>,
    v: Vec3x<S>,
}

/// A triangle as its ray sees it.
struct Seen<S: Simd> {
    /// What the corners weigh where the ray goes through, times their sum.
    weights: [Float<S>; 3],
    /// Where the corners are across the ray, and how far along it.
    x: [Float<S>; 3],
    y: [Float<S>; 3],
    along: [Float<S>; 3],
}

impl<S: Simd> Seen<S> {
    #[inline(always)]
    fn new(
        origin: Vec3x<S>,
        direction: Vec3x<S>,
        axes: &RayAxes<S>,
        corners: [Vec3x<S>; 3],
    ) -> Self {
        // Written out, here and below: closures passed to `array::map` are not compiled for the processor's level.
        let (a, b, c) = (
            corners[0] - origin,
            corners[1] - origin,
            corners[2] - origin,
        );
        let across = |p: Vec3x<S>| (axes.u.dot(p), axes.v.dot(p));
        let [(ax, ay), (bx, by), (cx, cy)] = [across(a), across(b), across(c)];
        // Each product is rounded by itself, see the scalar tracer.
        Self {
            weights: [bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx],
            x: [ax, bx, cx],
            y: [ay, by, cy],
            along: [direction.dot(a), direction.dot(b), direction.dot(c)],
        }
    }

    /// Where the ray goes through the bounds of the corners, as far as it can be told without rounding.
    #[inline(always)]
    fn is_in_bounds(&self) -> Mask<S> {
        has_zero(self.x) & has_zero(self.y)
    }

    #[inline(always)]
    fn sum(&self) -> Float<S> {
        let [a, b, c] = self.weights;
        a + b + c
    }
}

/// Whether 0 is within the bounds of three numbers.
#[inline(always)]
fn has_zero<S: Simd>([a, b, c]: [Float<S>; 3]) -> Mask<S> {
    a.min(b).min(c).simd_le(0.0) & a.max(b).max(c).simd_ge(0.0)
}

impl Triangle {
    fn numbers(triangle: &TriangleData) -> [f32; 9] {
        join([triangle.a, triangle.b, triangle.c])
    }
}

impl Shape<9> for Triangle {
    /// Faster by 1.08 for 64 and 1.3 for 96: `carom-bench bvh --backend cpu --shape triangles`.
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
            candidate &= !within | seen.sum().simd_gt(0.0);
        }
        let on_line = a.simd_eq(0.0) | b.simd_eq(0.0) | c.simd_eq(0.0);
        if (candidate & on_line).any_true() {
            candidate &= seen.is_in_bounds() | !on_line;
        }
        let (sum, [along_a, along_b, along_c]) = (seen.sum(), seen.along);
        let t = a.mul_add(along_a, b.mul_add(along_b, c * along_c)) / sum;
        let ahead = t.simd_gt(0.0) & t.simd_lt(limit) & sum.abs().simd_gt(0.0);
        Some((candidate & ahead, t))
    }
}

/// The triangles of a scene, by which rays find them.
pub(super) struct Triangles {
    /// Empty if they are in the BVH.
    each: Vec<PackedPrimitive<Triangle, 9>>,
    bounds: BoundsGroups,
    bvh: Option<Arc<Bvh16<Triangle, 9>>>,
    /// Where some are not opaque.
    alpha_filter: Option<AlphaFilter>,
}

/// What tells of points of triangles how much is there, and what it emits.
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

/// Lets rays pass triangles as their opacity says.
struct AlphaFilter {
    tables: TriangleTables,
    /// The id of the first triangle.
    first: u32,
}

impl AlphaFilter {
    /// None where all triangles are opaque.
    fn new(scene: &CompiledScene, first: u32) -> Option<Self> {
        scene.alpha_test()?;
        let tables = TriangleTables::new(scene);
        Some(Self { tables, first })
    }

    /// The lanes of `hit` whose rays meet the triangle with an id.
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
        let weights = || corner_weights(triangle, origin, direction);
        test.is_met(origin, direction, index, weights)
    }
}

impl Triangles {
    /// Of ids from `first` on; `reach` as of [`BoundsGroups::new`]. The BVH is kept with the scene.
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
            return Self {
                each: each().collect(),
                bounds: BoundsGroups::new(bounds, reach),
                bvh: None,
                alpha_filter: AlphaFilter::new(scene, first),
            };
        };
        let bvh = scene.meshes.layout.get_or_make(|| {
            let each: Vec<_> = each().map(Some).collect();
            Bvh16::new(bvh, &each)
        });
        Self {
            each: Vec::new(),
            bounds: BoundsGroups::new([], reach),
            bvh: Some(bvh),
            alpha_filter: AlphaFilter::new(scene, first),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.each.is_empty() && self.bvh.is_none()
    }

    /// Takes what rays meet before what they have met. Out of line: scenes without meshes are not to pay for it.
    #[inline(never)]
    pub(super) fn nearest<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        beam: Option<&Beam>,
        nearest: &mut Nearest<S>,
    ) {
        if let Some(bvh) = &self.bvh {
            match &self.alpha_filter {
                None => bvh.nearest(simd, rays, nearest, &Solid),
                Some(filter) => bvh.nearest(simd, rays, nearest, filter),
            }
        }
        simd.vectorize(
            #[inline(always)]
            || {
                let axes = Triangle::frame(simd, rays);
                for group in 0..self.bounds.len() {
                    for index in self.bounds.met(simd, group, beam) {
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

    /// Adds where a triangle lies before `distance` to `dark`.
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
        }
        simd.vectorize(
            #[inline(always)]
            || {
                let axes = Triangle::frame(simd, rays);
                for group in 0..self.bounds.len() {
                    for index in self.bounds.met(simd, group, beam) {
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

/// The surfaces of a scene's triangles.
pub(super) struct TriangleSurfaces {
    triangles: Arc<Vec<TriangleData>>,
    normals: Arc<Vec<TriangleNormals>>,
    textures: TriangleTextures,
    colors: Arc<Vec<TriangleColors>>,
    /// The id of the first triangle, and the number of them.
    ids: [u32; 2],
    /// The row of the first material.
    rows_first: u32,
    /// Some are of dielectrics.
    has_dielectric: bool,
}

/// Where rays meet triangles.
pub(super) struct TriangleHit<S: Simd> {
    pub(super) lanes: Mask<S>,
    /// The row of each lane's material, in all lanes: elsewhere it is the primitive's id.
    pub(super) row: Word<S>,
    /// A little above the surface, so that rounding leaves no neighbour in between.
    pub(super) position: Vec3x<S>,
    /// To shade with, on the side that the ray comes from.
    pub(super) normal: Vec3x<S>,
    /// The surface's own, on that side; 0 in lanes of facets and other shapes.
    pub(super) geometric: Vec3x<S>,
    /// That of clear coats which have another than `normal`, on that side, 0 in other lanes; if any lane's has.
    pub(super) clearcoat_normal: Option<Vec3x<S>>,
    /// Of lanes whose materials have some, if any can.
    pub(super) textures: Option<TextureLanes<S>>,
    /// Of scenes with vertex colours: white in lanes without.
    pub(super) color: Option<Vec3x<S>>,
    /// Of scenes with meshes of dielectrics.
    pub(super) boundary: Option<Boundary<S>>,
}

/// What light that passes a triangle needs to know.
#[derive(Clone, Copy)]
pub(super) struct Boundary<S: Simd> {
    /// The ray was inside the body.
    pub(super) is_left: Mask<S>,
    /// As far on the other side of the surface as the position is on this one.
    pub(super) beyond: Vec3x<S>,
}

impl<S: Simd> TriangleHit<S> {
    /// Gives clear coats their own normals, seen from `wo`, while [`TriangleHit::normal`] is the triangle's.
    #[inline(always)]
    fn set_clearcoat_normal(&mut self, simd: S, layers: &LayerColumns, wo: Vec3x<S>) {
        let coated = Mask::from_bitmask(simd, layers.coated) & self.lanes;
        let coat = Vec3x::load_arrays(simd, &layers.normals);
        let shading = visible_normal(simd, coat, self.normal, wo);
        let none = Vec3x::splat(simd, [0.0; 3]);
        self.clearcoat_normal = Some(Vec3x::select(coated, shading, none));
        self.geometric = Vec3x::select(coated, self.normal, self.geometric);
    }
}

impl TriangleSurfaces {
    /// `first` is the id of the first triangle, `rows_first` the row of the scene's first material.
    pub(super) fn new(scene: &CompiledScene, first: u32, rows_first: u32) -> Self {
        Self {
            triangles: Arc::clone(&scene.meshes.triangles),
            normals: Arc::clone(&scene.meshes.normals),
            textures: TriangleTextures::new(scene),
            colors: Arc::clone(&scene.meshes.colors),
            ids: [first, scene.meshes.triangles.len() as u32],
            rows_first,
            has_dielectric: scene.has_dielectric_mesh(),
        }
    }

    /// Whether some may be shaded with another normal than their own.
    pub(super) fn has_shading_normals(&self) -> bool {
        !self.normals.is_empty() || !self.textures.is_empty()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.ids[1] == 0
    }

    /// The triangles that rays meet, whose ids have no tags; none if they meet other shapes alone. Paths that were
    /// `scattered` inside a body have the id of the triangle by which they came in, and are on none.
    #[inline(always)]
    pub(super) fn hit<S: Simd>(
        &self,
        simd: S,
        origin: Vec3x<S>,
        direction: Vec3x<S>,
        id: Word<S>,
        scattered: Option<Mask<S>>,
        footprint: f32,
    ) -> Option<TriangleHit<S>> {
        let [first, count] = self.ids;
        // Those before the first wrap round.
        let is_met = count > 0 && (id - first).simd_lt(count).any_true();
        is_met.then(|| self.hit_some(simd, origin, direction, id, scattered, footprint))
    }

    #[inline(never)]
    fn hit_some<S: Simd>(
        &self,
        simd: S,
        origin: Vec3x<S>,
        direction: Vec3x<S>,
        id: Word<S>,
        scattered: Option<Mask<S>>,
        footprint: f32,
    ) -> TriangleHit<S> {
        simd.vectorize(
            #[inline(always)]
            || {
                let [first, count] = self.ids;
                let mut lanes = (id - first).simd_lt(count);
                let columns = self.columns(id.to_array());
                let vector = |first: usize| load(simd, &columns.numbers, first);
                let corners = [vector(0), vector(3), vector(6)];
                let (u, v) = basis(simd, direction);
                let seen = Seen::new(origin, direction, &RayAxes { u, v }, corners);
                let inverse_sum = 1.0 / lanes.select(seen.sum(), Float::splat(simd, 1.0));
                let [a, b, c] = seen.weights;
                let weights = [a * inverse_sum, b * inverse_sum, c * inverse_sum];
                let normal = facet_normal(direction, corners);
                let mut hit = TriangleHit {
                    lanes,
                    row: Word::load_array(simd, columns.rows),
                    position: point_above(corners, weights, normal),
                    normal,
                    geometric: Vec3x::splat(simd, [0.0; 3]),
                    clearcoat_normal: None,
                    textures: None,
                    color: None,
                    boundary: None,
                };
                if !self.colors.is_empty() {
                    hit.color = Some(self.vertex_color(simd, id, weights));
                }
                let mut smooth = Mask::from_bitmask(simd, columns.smooth);
                if self.has_dielectric {
                    let outward = wound_normal(corners);
                    hit.boundary = Some(Boundary {
                        is_left: outward.dot(direction).simd_gt(0.0),
                        beyond: point_above(corners, weights, -normal),
                    });
                    if let Some(scattered) = scattered {
                        lanes &= !scattered;
                        smooth &= !scattered;
                        hit.lanes = lanes;
                    }
                }
                let mut interpolated = normal;
                if smooth.any_true() {
                    interpolated = interpolate([vector(9), vector(12), vector(15)], weights);
                }
                if !self.textures.is_empty() {
                    let n_out = out_normal(smooth, interpolated, corners);
                    let distance = (hit.position - origin).length_squared().sqrt();
                    let footprint = distance * footprint;
                    let looked_up = self.look_up(id, weights, footprint, n_out, normal);
                    hit.textures = Some(looked_up.lanes(simd));
                    let mapped = Mask::from_bitmask(simd, looked_up.mapped);
                    let normals = Vec3x::load_arrays(simd, &looked_up.normals);
                    interpolated = Vec3x::select(mapped, normals, interpolated);
                    smooth |= mapped;
                    if let Some(layers) = looked_up.layers.filter(|layers| layers.coated != 0) {
                        hit.set_clearcoat_normal(simd, &layers, -direction);
                    }
                }
                if smooth.any_true() {
                    let shading = visible_normal(simd, interpolated, normal, -direction);
                    hit.normal = Vec3x::select(smooth, shading, normal);
                    hit.geometric = Vec3x::select(smooth, normal, hit.geometric);
                }
                hit
            },
        )
    }

    /// What vertex colours multiply each lane's albedo by.
    fn vertex_color<S: Simd>(&self, simd: S, id: Word<S>, weights: [Float<S>; 3]) -> Vec3x<S> {
        let weights = weights.map(Float::<S>::to_array);
        let mut columns = [[1.0; LANES]; 3];
        for (lane, id) in id.to_array().into_iter().enumerate() {
            if let Some(colors) = self.colors.get(id.wrapping_sub(self.ids[0]) as usize) {
                let color = colors.at(weights.map(|weight| weight[lane]));
                for (column, channel) in columns.iter_mut().zip(color.to_array()) {
                    column[lane] = channel;
                }
            }
        }
        Vec3x::load_arrays(simd, &columns)
    }

    /// What textures give each lane.
    fn look_up<S: Simd>(
        &self,
        id: Word<S>,
        weights: [Float<S>; 3],
        footprint_m: Float<S>,
        n_out: Vec3x<S>,
        n: Vec3x<S>,
    ) -> TextureColumns {
        let ids = id.to_array();
        let weights = weights.map(Float::<S>::to_array);
        let footprint_m = footprint_m.to_array();
        let [n_out, n] = [n_out, n].map(|v| [v.x.to_array(), v.y.to_array(), v.z.to_array()]);
        let vector = |v: &[[f32; LANES]; 3], lane: usize| glam::Vec3::from(v.map(|c| c[lane]));
        let mut columns = self.textures.columns();
        for (lane, id) in ids.into_iter().enumerate() {
            let Some(triangle) = self.triangles.get(id.wrapping_sub(self.ids[0]) as usize) else {
                continue;
            };
            let hit = LaneHit {
                triangle,
                weights: weights.map(|weight| weight[lane]),
                footprint_m: footprint_m[lane],
                n_out: vector(&n_out, lane),
                n: vector(&n, lane),
            };
            self.textures.look_up(&mut columns, lane, &hit);
        }
        columns
    }

    /// The rows of bodies whose ids, or those of triangles by which rays came in, are given.
    #[inline(always)]
    pub(super) fn rows<S: Simd>(&self, simd: S, id: Word<S>) -> Word<S> {
        if !self.has_dielectric {
            return id;
        }
        let row = |id: u32| {
            let triangle = self.triangles.get(id.wrapping_sub(self.ids[0]) as usize);
            triangle.map_or(id, |triangle| self.rows_first + triangle.material)
        };
        Word::load_array(simd, id.to_array().map(row))
    }

    fn columns(&self, ids: [u32; LANES]) -> TriangleColumns {
        let mut columns = TriangleColumns {
            numbers: [[0.0; LANES]; 18],
            rows: ids,
            smooth: 0,
        };
        for (lane, id) in ids.into_iter().enumerate() {
            let Some(data) = self.triangles.get(id.wrapping_sub(self.ids[0]) as usize) else {
                continue;
            };
            columns.rows[lane] = self.rows_first + data.material;
            columns.store(lane, 0, [data.a, data.b, data.c]);
            if let Some(normals) = self.normals.get(data.normals as usize) {
                columns.store(lane, 9, [normals.a, normals.b, normals.c]);
                columns.smooth |= 1 << lane;
            }
        }
        columns
    }
}

/// Corners and vertex normals by lane.
struct TriangleColumns {
    numbers: [[f32; LANES]; 18],
    rows: [u32; LANES],
    /// A bit for each lane that has vertex normals.
    smooth: u64,
}

impl TriangleColumns {
    #[inline(always)]
    fn store(&mut self, lane: usize, first: usize, vectors: [[f32; 3]; 3]) {
        let numbers = vectors.as_flattened();
        for (column, number) in self.numbers[first..].iter_mut().zip(numbers) {
            column[lane] = *number;
        }
    }
}

#[inline(always)]
fn load<S: Simd>(simd: S, numbers: &[[f32; LANES]; 18], first: usize) -> Vec3x<S> {
    Vec3x::new(
        Float::load_array(simd, numbers[first]),
        Float::load_array(simd, numbers[first + 1]),
        Float::load_array(simd, numbers[first + 2]),
    )
}

/// The unit normal that the corners of a triangle go round.
#[inline(always)]
fn wound_normal<S: Simd>([a, b, c]: [Vec3x<S>; 3]) -> Vec3x<S> {
    unit((b - a).cross(c - a))
}

/// The unit normal to shade with, out of the surface.
#[inline(always)]
fn out_normal<S: Simd>(
    smooth: Mask<S>,
    interpolated: Vec3x<S>,
    corners: [Vec3x<S>; 3],
) -> Vec3x<S> {
    let is_some = smooth & interpolated.length_squared().simd_gt(0.0);
    Vec3x::select(is_some, unit(interpolated), wound_normal(corners))
}

/// The unit normal of a triangle, on the side that a ray comes from.
#[inline(always)]
fn facet_normal<S: Simd>(direction: Vec3x<S>, corners: [Vec3x<S>; 3]) -> Vec3x<S> {
    let normal = wound_normal(corners);
    let behind = normal.dot(direction).simd_gt(0.0);
    Vec3x::select(behind, -normal, normal)
}

/// The point or vector where corners have these weights.
#[inline(always)]
pub(super) fn interpolate<S: Simd>(
    [a, b, c]: [Vec3x<S>; 3],
    [wa, wb, wc]: [Float<S>; 3],
) -> Vec3x<S> {
    a.mul_add(wa, b.mul_add(wb, c * wc))
}

/// The point of a triangle where corners have these weights, moved above it by the most that rounding can have
/// put it below: Pharr, Jakob and Humphreys, "Physically Based Rendering", 4th edition, sections 6.8.4 to 6.8.6.
#[inline(always)]
fn point_above<S: Simd>(
    corners: [Vec3x<S>; 3],
    weights: [Float<S>; 3],
    normal: Vec3x<S>,
) -> Vec3x<S> {
    let point = interpolate(corners, weights);
    let [a, b, c] = weights;
    let sizes = [corners[0].abs(), corners[1].abs(), corners[2].abs()];
    let magnitude = interpolate(sizes, [a.abs(), b.abs(), c.abs()]);
    let error = magnitude.dot(normal.abs()) * POINT_ROUNDING;
    normal.mul_add(error, point)
}

/// [`crate::scalar::triangle::visible_shading_normal`] of what is interpolated, on either side of the surface.
#[inline(always)]
fn visible_normal<S: Simd>(simd: S, interpolated: Vec3x<S>, n: Vec3x<S>, wo: Vec3x<S>) -> Vec3x<S> {
    let is_some = interpolated.length_squared().simd_gt(0.0);
    let shading = Vec3x::select(is_some, unit(interpolated), n);
    let behind = shading.dot(n).simd_lt(0.0);
    let shading = Vec3x::select(behind, -shading, shading);
    let reflected = shading.mul_add(wo.dot(shading) * 2.0, -wo);
    let lift = Float::splat(simd, REFLECTION_SINE_MIN as f32) - reflected.dot(n);
    let hidden = lift.simd_gt(0.0);
    if !hidden.any_true() {
        return shading;
    }
    let turned = unit(wo + unit(n.mul_add(lift, reflected)));
    Vec3x::select(hidden, turned, shading)
}

#[inline(always)]
fn unit<S: Simd>(v: Vec3x<S>) -> Vec3x<S> {
    v * (1.0 / v.length_squared().sqrt())
}

#[cfg(test)]
mod tests {
    use super::super::geometry::Geometry;
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
