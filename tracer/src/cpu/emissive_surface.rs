//! Light sampling of emissive surfaces, one point per lane: see [`crate::scalar::emissive_surface`].

use fearless_simd::prelude::*;

use super::lanes::{Float, LANES, Mask, Vec3x, Word};
use super::rows::Rows;
use super::sampling::{basis, sin_cos_turns};
use super::triangle::TriangleTables;
use super::triangle_surface::interpolate;
use crate::CompiledScene;
use crate::compiled::{
    EMISSIVE_SURFACE_REACH, EmissiveSurfaceData, EmissiveSurfaces, MaterialData, ShapeKind,
};

/// Sampler of the scene's emissive surfaces.
pub(super) struct EmissiveSurfaceSampler {
    lights: EmissiveSurfaces,
    /// Rows of all surfaces if they are at most [`FEW_MAX`], else of those other than triangles, which
    /// come first.
    rows: Vec<SurfaceRow>,
    /// Spheres of the scene, by primitive; empty if no sphere emits.
    spheres: Vec<SphereRow>,
    has_triangles_only: bool,
    triangles: TriangleTables,
    /// Whether emission varies over the surface of some of them.
    emission_varies: bool,
}

impl EmissiveSurfaceSampler {
    /// `None` if no surface emits.
    pub(super) fn new(scene: &CompiledScene) -> Option<Self> {
        let lights = &scene.emissive_surfaces;
        (lights.sixteenths > 0).then(|| {
            let (shapes, _) = lights.shapes_and_triangles();
            let rows = match lights.surfaces.len() <= FEW_MAX {
                true => &lights.surfaces[..],
                false => shapes,
            };
            let is_sphere = |surface: &EmissiveSurfaceData| surface.kind() == ShapeKind::Sphere;
            let spheres = match shapes.first().is_some_and(is_sphere) {
                true => &scene.spheres[..],
                false => &[],
            };
            let spheres = spheres.iter().map(|sphere| {
                let [x, y, z] = sphere.center;
                [x, y, z, sphere.radius]
            });
            Self {
                rows: (rows.iter())
                    .map(|surface| SurfaceRow::new(scene, surface))
                    .collect(),
                spheres: spheres.collect(),
                has_triangles_only: shapes.is_empty(),
                triangles: TriangleTables::new(scene),
                emission_varies: (0..scene.materials.len())
                    .any(|index| scene.emission_varies(index)),
                lights: lights.clone(),
            }
        })
    }

    /// Probability with which light sampling chooses an emissive surface.
    pub(super) fn probability(&self) -> f32 {
        self.lights.probability()
    }

    /// Area per solid angle at the hits of rays from `origin`, m²·sr⁻¹, which converts densities by area
    /// to densities by solid angle; 0 for spheres seen from within.
    #[inline(always)]
    pub(super) fn area_per_angle<S: Simd>(
        &self,
        simd: S,
        origin: Vec3x<S>,
        id: Word<S>,
        distance: Float<S>,
        cosine: Float<S>,
    ) -> Float<S> {
        let flat = distance * distance / cosine;
        match self.spheres.is_empty() {
            true => flat,
            false => self.area_per_angle_of_spheres(simd, origin, id, flat),
        }
    }

    /// [`Self::area_per_angle`] where some lanes met spheres; `flat` in the others.
    #[inline(never)]
    fn area_per_angle_of_spheres<S: Simd>(
        &self,
        simd: S,
        origin: Vec3x<S>,
        id: Word<S>,
        flat: Float<S>,
    ) -> Float<S> {
        simd.vectorize(
            #[inline(always)]
            || {
                let is_sphere: Mask<S> = id.simd_lt(self.spheres.len() as u32);
                let rows = Rows::new(&self.spheres, is_sphere.select(id, Word::splat(simd, 0)));
                let radius = rows.number(simd, RADIUS);
                let to_center = rows.triple(simd, CENTER) - origin;
                let of_sphere = area_per_angle_of_sphere(simd, to_center.length_squared(), radius);
                is_sphere.select(of_sphere, flat)
            },
        )
    }

    /// Draws a point for each of `lanes`; distance and radiance are 0 in the others. Not inlined, to keep
    /// it out of the instruction stream of scenes without emissive surfaces.
    #[inline(never)]
    pub(super) fn sample<S: Simd>(
        &self,
        simd: S,
        lanes: Mask<S>,
        point: Vec3x<S>,
        u: [Float<S>; 2],
    ) -> EmissiveSurfaceSample<S> {
        simd.vectorize(
            #[inline(always)]
            || {
                let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
                let drawn = match self.rows.split_first() {
                    Some((first, others)) if self.rows.len() == self.lights.surfaces.len() => {
                        draw_of_few(simd, first, others, u[0])
                    }
                    _ => self.draw(simd, lanes, u[0]),
                };
                let (before, probability) = (drawn.before, drawn.probability);
                // Within the interval of the chosen surface `u[0]` is rescaled to be uniform again.
                let within = ((u[0] - before) / probability).max(zero).min(one);
                // Uniform in a triangle: a fraction √u of the way from the first corner bounds the area u.
                let root = within.sqrt();
                let mut weights = [one - root, root * (one - u[1]), root * u[1]];
                if !self.has_triangles_only {
                    weights = drawn.corner_weights(simd, [within, u[1]], weights);
                }
                let corners = drawn.corners;
                let across = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                let parallelogram = across.length_squared().sqrt();
                let to_light = interpolate(corners, weights) - point;
                let distance2 = to_light.length_squared();
                let mut distance = distance2.sqrt();
                let mut wi = to_light * (one / distance);
                let cosine = (wi.dot(across) / parallelogram).abs();
                // Rejects degenerate triangles (0 / 0) and points in the triangle's own plane.
                let mut is_seen = lanes & cosine.simd_gt(0.0) & distance.simd_gt(0.0);
                let mut angle_per_area = cosine / distance2;
                let mut area = drawn.area_factor * parallelogram;
                if !self.spheres.is_empty() {
                    let is_sphere = drawn.shape.simd_eq(ShapeKind::Sphere as u32);
                    let sphere = drawn.of_sphere(simd, point, [within, u[1]]);
                    wi = Vec3x::select(is_sphere, sphere.wi, wi);
                    distance = is_sphere.select(sphere.distance, distance);
                    angle_per_area = is_sphere.select(sphere.angle_per_area, angle_per_area);
                    area = is_sphere.select(sphere.area, area);
                    let is_outside = lanes & sphere.angle_per_area.simd_gt(0.0);
                    is_seen = (is_sphere & is_outside) | (is_seen & !is_sphere);
                }
                // Reciprocal densities per solid angle need area · angle_per_area / (P(kind) · P(surface)).
                let per_angle = angle_per_area * (1.0 / self.probability());
                let emission = match self.emission_varies {
                    true => self.emission(simd, lanes, &drawn, weights),
                    false => drawn.emission,
                };
                let radiance = emission * (area * per_angle / probability);
                let forward = Vec3x::splat(simd, [0.0, 0.0, 1.0]);
                let black = Vec3x::splat(simd, [0.0; 3]);
                EmissiveSurfaceSample {
                    wi: Vec3x::select(is_seen, wi, forward),
                    distance: is_seen.select(distance * EMISSIVE_SURFACE_REACH, zero),
                    inverse_density: is_seen.select(per_angle / drawn.point_density, zero),
                    radiance: Vec3x::select(is_seen, radiance, black),
                }
            },
        )
    }

    /// Draws a surface for each of `lanes` by `u` in [0, 1).
    #[inline(always)]
    fn draw<S: Simd>(&self, simd: S, lanes: Mask<S>, u: Float<S>) -> DrawnSurfaces<S> {
        let (lanes, u) = (lanes.to_bitmask(), u.to_array());
        let mut words = [[0; LANES]; 2];
        let mut columns = [[0.0; LANES]; NUMBERS];
        for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
            let light = self.lights.sample_index(u[lane]);
            let of_triangle;
            let row = match self.rows.get(light) {
                Some(row) => row,
                None => {
                    of_triangle =
                        SurfaceRow::of_triangle(&self.triangles, &self.lights.surfaces[light]);
                    &of_triangle
                }
            };
            words[0][lane] = row.index;
            words[1][lane] = row.shape;
            for (column, number) in columns.iter_mut().zip(row.numbers) {
                column[lane] = number;
            }
        }
        let mut numbers = [Float::splat(simd, 0.0); NUMBERS];
        for (lanes, column) in numbers.iter_mut().zip(columns) {
            *lanes = Float::load_array(simd, column);
        }
        let [index, shape] = words;
        DrawnSurfaces::new(
            Word::load_array(simd, index),
            Word::load_array(simd, shape),
            numbers,
        )
    }

    /// Emission of each lane's surface at the point with these corner weights.
    #[inline(never)]
    fn emission<S: Simd>(
        &self,
        simd: S,
        lanes: Mask<S>,
        drawn: &DrawnSurfaces<S>,
        weights: [Float<S>; 3],
    ) -> Vec3x<S> {
        let tables = self.triangles.alpha_test();
        let is_triangle: Mask<S> = drawn.shape.simd_eq(ShapeKind::Triangle as u32);
        let weights = weights.map(Float::<S>::to_array);
        let index = drawn.index.to_array();
        let mut columns = [[0.0; LANES]; 3];
        let bits = (lanes & is_triangle).to_bitmask();
        for lane in (0..LANES).filter(|lane| bits >> lane & 1 == 1) {
            let emission = tables.emission(index[lane], weights.map(|weight| weight[lane]));
            for (column, channel) in columns.iter_mut().zip(emission.to_array()) {
                column[lane] = channel;
            }
        }
        Vec3x::select(
            is_triangle,
            Vec3x::load_arrays(simd, &columns),
            drawn.emission,
        )
    }
}

/// Area per solid angle of spheres, m²·sr⁻¹, from a point at the square root of `squared` from the
/// centre; 0 from within.
#[inline(always)]
fn area_per_angle_of_sphere<S: Simd>(simd: S, squared: Float<S>, radius: Float<S>) -> Float<S> {
    let beyond = squared - radius * radius;
    // Area over solid angle, 4πr² / 2π(1 − cos θ). With 1 − cos θ = (r/d)² / (1 + cos θ), which does not
    // cancel, this is 2 (d² + d √(d² − r²)).
    let outside = (squared + (squared * beyond.max(0.0)).sqrt()) * 2.0;
    beyond.simd_gt(0.0).select(outside, Float::splat(simd, 0.0))
}

/// Draws a surface for each lane by `u` in [0, 1). For few surfaces a linear scan is faster than
/// gathering a row per lane.
#[inline(always)]
fn draw_of_few<S: Simd>(
    simd: S,
    first: &SurfaceRow,
    others: &[SurfaceRow],
    u: Float<S>,
) -> DrawnSurfaces<S> {
    let mut index = Word::splat(simd, first.index);
    let mut shape = Word::splat(simd, first.shape);
    let mut numbers = [Float::splat(simd, 0.0); NUMBERS];
    for (lanes, number) in numbers.iter_mut().zip(first.numbers) {
        *lanes = Float::splat(simd, number);
    }
    for surface in others {
        // Intervals ascend, so that the last one that begins at or below `u` is kept.
        let is_after = u.simd_ge(surface.numbers[BEFORE]);
        index = is_after.select(Word::splat(simd, surface.index), index);
        shape = is_after.select(Word::splat(simd, surface.shape), shape);
        for (lanes, number) in numbers.iter_mut().zip(surface.numbers) {
            *lanes = is_after.select(Float::splat(simd, number), *lanes);
        }
    }
    DrawnSurfaces::new(index, shape, numbers)
}

/// Largest number of surfaces for which [`draw_of_few`] is used.
const FEW_MAX: usize = 8;

/// Centre and radius, metres.
type SphereRow = [f32; 4];

const CENTER: usize = 0;
const RADIUS: usize = 3;

/// Emissive surface: three corners, emission, then the numbers at the indices below.
struct SurfaceRow {
    numbers: [f32; NUMBERS],
    index: u32,
    shape: u32,
}

const NUMBERS: usize = 16;
const POINT_DENSITY: usize = 12;
const BEFORE: usize = 13;
const PROBABILITY: usize = 14;
const AREA_FACTOR: usize = 15;

impl SurfaceRow {
    fn new(scene: &CompiledScene, surface: &EmissiveSurfaceData) -> Self {
        let material = scene.material_of(surface.primitive());
        let material = material.expect("no area light is among them");
        Self::of(
            surface,
            surface.kind(),
            scene.emissive_corners(surface).map(Into::into),
            material,
        )
    }

    #[inline(always)]
    fn of_triangle(tables: &TriangleTables, surface: &EmissiveSurfaceData) -> Self {
        let tables = tables.alpha_test();
        let triangle = &tables.triangles[surface.index as usize];
        let material = &tables.materials[triangle.material as usize];
        let corners = [triangle.a, triangle.b, triangle.c];
        Self::of(surface, ShapeKind::Triangle, corners, material)
    }

    #[inline(always)]
    fn of(
        surface: &EmissiveSurfaceData,
        shape: ShapeKind,
        [[ax, ay, az], [bx, by, bz], [cx, cy, cz]]: [[f32; 3]; 3],
        material: &MaterialData,
    ) -> Self {
        let [r, g, b] = material.k;
        let EmissiveSurfaceData {
            index,
            before,
            probability,
            ..
        } = *surface;
        let area_factor = shape.area_factor();
        let area_factor = area_factor.expect("light sampling draws points on it");
        Self {
            numbers: [
                ax,
                ay,
                az,
                bx,
                by,
                bz,
                cx,
                cy,
                cz,
                r,
                g,
                b,
                // For emissive materials `sampling_density` is the density of points by area.
                material.sampling_density,
                before,
                probability,
                area_factor as f32,
            ],
            index,
            shape: shape as u32,
        }
    }
}

/// The emissive surface drawn for each lane.
struct DrawnSurfaces<S: Simd> {
    index: Word<S>,
    shape: Word<S>,
    /// See [`CompiledScene::emissive_corners`].
    corners: [Vec3x<S>; 3],
    /// Emission; where emission varies, its constant factor.
    emission: Vec3x<S>,
    /// Density by area with which light sampling draws points of the surface, m⁻².
    point_density: Float<S>,
    /// Sum of the probabilities of the surfaces before it in the table.
    before: Float<S>,
    /// Probability of the surface.
    probability: Float<S>,
    /// See [`ShapeKind::area_factor`].
    area_factor: Float<S>,
}

/// Directions drawn uniformly in the solid angles of spheres.
struct SphereDirections<S: Simd> {
    wi: Vec3x<S>,
    distance: Float<S>,
    /// Solid angle per area, sr·m⁻²; 0 from within.
    angle_per_area: Float<S>,
    area: Float<S>,
}

impl<S: Simd> DrawnSurfaces<S> {
    #[inline(always)]
    fn new(index: Word<S>, shape: Word<S>, numbers: [Float<S>; NUMBERS]) -> Self {
        let [ax, ay, az, bx, by, bz, cx, cy, cz, r, g, b, ..] = numbers;
        Self {
            index,
            shape,
            corners: [
                Vec3x::new(ax, ay, az),
                Vec3x::new(bx, by, bz),
                Vec3x::new(cx, cy, cz),
            ],
            emission: Vec3x::new(r, g, b),
            point_density: numbers[POINT_DENSITY],
            before: numbers[BEFORE],
            probability: numbers[PROBABILITY],
            area_factor: numbers[AREA_FACTOR],
        }
    }

    /// Weights of the corners at a point uniform in area; `of_triangles` in lanes of triangles.
    #[inline(always)]
    fn corner_weights(
        &self,
        simd: S,
        [u, v]: [Float<S>; 2],
        of_triangles: [Float<S>; 3],
    ) -> [Float<S>; 3] {
        let one = Float::splat(simd, 1.0);
        let is_disc: Mask<S> = self.shape.simd_eq(ShapeKind::Disc as u32);
        let is_rectangle: Mask<S> = self.shape.simd_eq(ShapeKind::Rectangle as u32);
        let (sin, cos) = sin_cos_turns(v);
        let root = u.sqrt();
        let [mut a, mut b, mut c] = of_triangles;
        b = is_disc.select(root * cos, is_rectangle.select(u, b));
        c = is_disc.select(root * sin, is_rectangle.select(v, c));
        a = (is_disc | is_rectangle).select(one - b - c, a);
        [a, b, c]
    }

    #[inline(always)]
    fn of_sphere(&self, simd: S, point: Vec3x<S>, [u, v]: [Float<S>; 2]) -> SphereDirections<S> {
        let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
        // The second corner of a sphere's row is (radius, …): see `CompiledScene::emissive_corners`.
        let radius = self.corners[1].x;
        let radius2 = radius * radius;
        let to_center = self.corners[0] - point;
        let squared = to_center.length_squared();
        let area_per_angle = area_per_angle_of_sphere(simd, squared, radius);
        let is_outside = area_per_angle.simd_gt(0.0);
        let angle_per_area = is_outside.select(one / area_per_angle, zero);
        // 1 − cos θ of the direction, uniform in solid angle. Kept in this form, as 1 − cos θ of a small
        // angle would cancel.
        let within = u * 2.0 * radius2 * angle_per_area;
        let sine2 = within * (2.0 - within);
        let distance = squared.sqrt();
        let axis = to_center * (one / distance);
        let (t, b) = basis(simd, axis);
        let (sin, cos) = sin_cos_turns(v);
        let sine = sine2.sqrt();
        // The nearer intersection is at d·cos θ − √(r² − d² sin² θ).
        let half_chord = (radius2 - squared * sine2).max(0.0).sqrt();
        SphereDirections {
            wi: t * (sine * cos) + b * (sine * sin) + axis * (one - within),
            distance: distance * (one - within) - half_chord,
            angle_per_area,
            area: self.area_factor * radius2,
        }
    }
}

/// Points on emissive surfaces, as directions to them.
pub(super) struct EmissiveSurfaceSample<S: Simd> {
    pub(super) wi: Vec3x<S>,
    /// Length of the shadow ray, metres; 0 where no light arrives.
    pub(super) distance: Float<S>,
    /// Reciprocal of the density per solid angle that the power heuristic takes.
    pub(super) inverse_density: Float<S>,
    /// Emitted radiance over the density with which the point was drawn.
    pub(super) radiance: Vec3x<S>,
}
