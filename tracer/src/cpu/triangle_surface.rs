//! Surface properties of triangles at hits, one per lane: the arithmetic of [`crate::scalar::triangle`].

use std::sync::Arc;

use fearless_simd::prelude::*;

use super::image_texture::{LaneHit, LayerColumns, TextureColumns, TextureLanes, TriangleTextures};
use super::lanes::{Float, LANES, Mask, Vec3x, Word};
use super::sampling::basis;
use super::triangle::{RayAxes, Seen};
use crate::CompiledScene;
use crate::compiled::{TriangleColors, TriangleData, TriangleNormals};
use crate::scalar::triangle::{POINT_ROUNDING, REFLECTION_SINE_MIN};

/// Surface data of a scene's triangles.
pub(super) struct TriangleSurfaces {
    triangles: Arc<Vec<TriangleData>>,
    normals: Arc<Vec<TriangleNormals>>,
    textures: TriangleTextures,
    colors: Arc<Vec<TriangleColors>>,
    /// Id of the first triangle, and their number.
    ids: [u32; 2],
    /// Row of the first material in [`super::surface::Surfaces`].
    rows_first: u32,
    /// Whether some triangles belong to dielectrics.
    has_dielectric: bool,
    /// Distance of the camera's near plane, metres: see [`super::surface::Surfaces`].
    near_m: f32,
}

/// Hits of rays on triangles.
pub(super) struct TriangleHit<S: Simd> {
    /// Lanes that hit a triangle.
    pub(super) lanes: Mask<S>,
    /// Row of the material in lanes that hit a triangle, the primitive's id in others.
    pub(super) row: Word<S>,
    /// Slightly above the surface, by the rounding error, so that a ray from there misses neighbouring
    /// triangles.
    pub(super) position: Vec3x<S>,
    /// Unit shading normal, on the side from which the ray comes.
    pub(super) normal: Vec3x<S>,
    /// Geometric normal on that side; 0 in lanes of facets and of other shapes.
    pub(super) geometric: Vec3x<S>,
    /// Normal of clear coats with one of their own, on that side; 0 in other lanes; `None` if no lane has
    /// one.
    pub(super) clearcoat_normal: Option<Vec3x<S>>,
    /// Texture values, if the scene has textures.
    pub(super) textures: Option<TextureLanes<S>>,
    /// Interpolated vertex colours, if the scene has any; white in lanes without.
    pub(super) color: Option<Vec3x<S>>,
    /// For scenes with meshes of dielectrics.
    pub(super) boundary: Option<Boundary<S>>,
}

/// Additional properties of hits at which light may be transmitted.
#[derive(Clone, Copy)]
pub(super) struct Boundary<S: Simd> {
    /// Whether the ray was inside the body.
    pub(super) is_left: Mask<S>,
    /// As far beyond the surface as `position` is before it: the origin of transmitted rays.
    pub(super) beyond: Vec3x<S>,
}

impl<S: Simd> TriangleHit<S> {
    /// Sets the normals of clear coats, seen from `wo`, while [`TriangleHit::normal`] is still the
    /// geometric normal.
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
            near_m: scene.camera.near_m,
        }
    }

    /// Whether any triangle may have a shading normal other than its geometric normal.
    pub(super) fn has_shading_normals(&self) -> bool {
        !self.normals.is_empty() || !self.textures.is_empty()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.ids[1] == 0
    }

    /// Whether any of the ids, which have no flags, is that of a triangle.
    #[inline(always)]
    pub(super) fn are_met<S: Simd>(&self, id: Word<S>) -> bool {
        let [first, count] = self.ids;
        // Ids below the first wrap to large numbers.
        count > 0 && (id - first).simd_lt(count).any_true()
    }

    /// Surface at the hits of rays on triangles, whose ids have no flags. Paths `scattered` inside a body
    /// carry the id of the triangle through which they entered, and are on no triangle.
    #[inline(never)]
    pub(super) fn hit<S: Simd>(
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
                // Other shapes have corners of 0 here, and would divide by 0.
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
                        // The path keeps the row of its body but is on no triangle: position and normal
                        // remain its own.
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
                    // Rays start on the near plane, while `footprint` is per metre from the eye.
                    let footprint = (distance + self.near_m) * footprint;
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

    /// Interpolated vertex colours, by which the albedo of each lane is multiplied.
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

    /// Looks up the textures of all lanes.
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

    /// Row of each body, whose id is given, or that of the triangle through which the ray entered it.
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

/// Corners and vertex normals, by lane.
struct TriangleColumns {
    numbers: [[f32; LANES]; 18],
    rows: [u32; LANES],
    /// Bit mask of the lanes with vertex normals.
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

/// Unit normal around which the corners run counterclockwise.
#[inline(always)]
fn wound_normal<S: Simd>([a, b, c]: [Vec3x<S>; 3]) -> Vec3x<S> {
    unit((b - a).cross(c - a))
}

/// Unit shading normal on the outer side of the surface.
#[inline(always)]
fn out_normal<S: Simd>(
    smooth: Mask<S>,
    interpolated: Vec3x<S>,
    corners: [Vec3x<S>; 3],
) -> Vec3x<S> {
    let is_some = smooth & interpolated.length_squared().simd_gt(0.0);
    Vec3x::select(is_some, unit(interpolated), wound_normal(corners))
}

/// Unit geometric normal on the side from which the ray comes.
#[inline(always)]
fn facet_normal<S: Simd>(direction: Vec3x<S>, corners: [Vec3x<S>; 3]) -> Vec3x<S> {
    let normal = wound_normal(corners);
    let behind = normal.dot(direction).simd_gt(0.0);
    Vec3x::select(behind, -normal, normal)
}

/// Point or vector at these barycentric coordinates.
#[inline(always)]
pub(super) fn interpolate<S: Simd>(
    [a, b, c]: [Vec3x<S>; 3],
    [wa, wb, wc]: [Float<S>; 3],
) -> Vec3x<S> {
    a.mul_add(wa, b.mul_add(wb, c * wc))
}

/// Point of a triangle at these barycentric coordinates, offset along the normal by a bound of its rounding
/// error: Pharr, Jakob and Humphreys, "Physically Based Rendering", 4th edition, sections 6.8.4 to 6.8.6.
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
    // The error bound is a box around the point; along the normal it extends as far as its projection.
    let error = magnitude.dot(normal.abs()) * POINT_ROUNDING;
    normal.mul_add(error, point)
}

/// [`crate::scalar::triangle::visible_shading_normal`] of an interpolated normal on either side of the
/// surface.
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
    // The half vector of `wo` and the lifted mirror direction is the normal that reflects one into the
    // other.
    let turned = unit(wo + unit(n.mul_add(lift, reflected)));
    Vec3x::select(hidden, turned, shading)
}

#[inline(always)]
fn unit<S: Simd>(v: Vec3x<S>) -> Vec3x<S> {
    v * (1.0 / v.length_squared().sqrt())
}
