//! The scalar path tracer: f64, one sample at a time, with the random numbers of the fast tracers.
//!
//! # Estimator
//! The fast tracers follow it sample for sample, to the rounding of f32. With `k` the
//! depth, from 0, and `u = sampling::pair(pixel, sample, block, seed)`:
//!
//! 1. **Camera.** The ray goes through film position `pixel + u` of block `BLOCK_CAMERA`, and through the point of the lens
//!    of block `BLOCK_LENS`.
//! 2. **Edge.** The nearest primitive with `t > 0` is hit, the first of equals in the order
//!    spheres, boxes, discs, rectangles, CSG boxes, triangles, area lights. The primitive that the ray leaves is skipped: each
//!    is convex, so an outward ray cannot meet it again, and no origin need be offset; a ray inside
//!    a dielectric meets that body's far side and no other of its own, or any triangle of a mesh ([`triangle`]). There it flies freely first:
//!    it is scattered after `−ln(1 − u[1]) / majorant` metres if that is nearer, with `u` of block
//!    `block_choice(k)`, evenly by `block_scatter(k)`, which counts as a scattering. A ray that
//!    meets nothing adds `beta · environment` and ends. A ray that meets an area light ends; from the
//!    front it adds `beta · radiance · w`, where `w` is 1 for camera rays and after what has no
//!    density (a metal mirror, smooth glass, a medium), 0 where step 3 has added the area lights (after a
//!    coat's mirror, and where light that was scattered inside a ball is joined by [`refracted_nee`]),
//!    else the power heuristic of the pdf against `brightness / light_weight_sum`. After
//!    `max_depth` scattering events a ray that meets a surface ends black.
//! 3. **Light.** The coat's share: if the nearest area light in the mirror's direction is met from the
//!    front and nothing is in between, adds `beta · F · radiance`; where the path is regularised
//!    ([`crate::regularisation`]) it is part of the other lobes', weighed by 1. The other lobes' (block
//!    `block_light(k)`): an area light drawn by brightness times solid angle with `u[0]`, which is then
//!    stretched to [0, 1) again, and a direction uniform in its solid angle, or, where that is below
//!    [`AreaLightData::SOLID_ANGLE_MIN`], a point uniform in its area. Unless something is in between, adds
//!    `beta · f · cos · radiance / pdf · w`, `w` weighing the same two densities as in step 2,
//!    where `f` leaves out mirrors, and directions into a dielectric are. Inside a ball that allows it
//!    the same point is aimed at by the path refracted at the boundary, if
//!    that counts as a scattering that is left: a point that light falls on from `spread` per
//!    solid angle.
//! 4. **Scattering** (block `block_scatter(k)`). A surface that emits adds `beta · emission · w`, at camera rays too. Metals and
//!    dielectrics: [`microfacet`], whose choice to reflect takes `u[0]` of `block_choice(k)`, as that of
//!    [`mod@metallic_roughness`]. Others: with `F` the Fresnel reflectance seen
//!    from `wo` and `a` the channel mean of the albedo at the hit, the mirror is chosen if `u[0]` is
//!    below `p = F / (F + (1−F)·a)` (0 where `F` is 0), with weight `F/p`. Else `u[0]` is stretched
//!    to [0, 1) again and `wi` drawn by the cosine: `(√u[0]·cos 2πu[1], √u[0]·sin 2πu[1],
//!    √(1−u[0]))` in the basis of [`bsdf::basis`], pdf `(1−p)·cos/π`, weight `f·cos / pdf`. A path
//!    whose weight is 0 ends.
//!
//! What each part is worth at 16 samples on the pool table (relMSE; the whole 2.8e-4, 2.85 rays a
//! sample): points of step 1 that are independent, 1.5e-3; area lights drawn uniformly, 3.9e-4; area lights by
//! chance alone after the mirror, 7.5e-4; the balance heuristic, 1.1e-3. What would cost more than
//! it is worth: every area light at each scattering, 2.6e-4 for 3.75 rays.
//!
//! What goes straight on through a smooth thin wall has no density, as behind smooth glass.
//!
//! A constant environment is found by scattering alone. An environment map is aimed at instead of an area light with
//! probability [`CompiledEnvironment::probability`] by `u[0]` of `block_light(k)`, which is then stretched to [0, 1) again, and
//! weighed in the same way; what coats and media lead to it counts in full. Before both, [`mod@punctual_light`]s have their
//! share of `u[0]`, which chance does not find, and before all surfaces that emit ([`mod@emissive_surface`]), whose
//! light is weighed as that of an environment map where chance finds it, at the last vertex too. From the second vertex on, paths outside of bodies that would bring
//! little light are ended by Russian roulette ([`crate::sampling::SURVIVAL_PER_THROUGHPUT`]). There is no clamping; a
//! sample that is not finite counts as black and is reported.
//!
//! [`intersect()`], [`camera_ray`] and [`bsdf::Bsdf`] are public for tests of each part.

mod aov;
pub mod area_light;
pub mod bsdf;
pub mod csg;
pub mod emissive_surface;
pub mod environment;
pub mod intersect;
pub mod medium;
pub mod metallic_roughness;
pub mod microfacet;
mod normal_map;
pub mod punctual_light;
mod ray;
pub mod refracted_nee;
pub mod scatter;
mod textured;
pub mod triangle;

use std::f64::consts::{PI, TAU};
use std::sync::atomic::Ordering;

use glam::DVec3;
use rayon::prelude::*;

#[cfg(doc)]
use crate::compiled::CompiledEnvironment;
use crate::compiled::{AreaLightData, CameraFrame, EMISSIVE_SURFACE_REACH, Primitive, SphereData};
use crate::denoise::{
    DenoiseInput, DenoiseInputTile, DenoiseSource, FilterMemory, SampleSums, trace_denoised,
};
use crate::fresnel::fresnel_dielectric;
use crate::regularisation::{ALPHA_MIN, CONE_COSINE, CONE_DENSITY, KEY_MASK};
use crate::sampling::{
    BELOW_1, BLOCK_CAMERA, BLOCK_LENS, ROULETTE_DEPTH, SURVIVAL_PER_THROUGHPUT, block_choice,
    block_light, block_scatter, pair, pixel_key, sample_key,
};
use crate::simd::Level;
use crate::tracer::{DeviceInfo, DeviceKind, TileRadiance, TraceJob, TraceStats, Tracer};
use crate::{Aovs, CompiledScene, Error, ImageSize, RenderSettings, Tile, TileAovs};
use area_light::{LightDirection, light_weight_sum, sample_light};
use bsdf::BsdfSample;
use emissive_surface::{EmissiveDirection, emissive_surface_density, sample_emissive_surface};
use environment::environment_radiance;
pub use intersect::{Hit, Ray, intersect};
use intersect::{RayOrigin, intersect_from, nearest_area_light, vector};
use medium::{Medium, uniform_direction};
use metallic_roughness::MetallicRoughness;
use microfacet::Conductor;
use punctual_light::sample_punctual_light;
use refracted_nee::RefractedPath;
use scatter::Scatter;
use triangle::visible_shading_normal;

/// The f64 path tracer of this module, over rayon's threads.
#[derive(Clone, Copy, Debug, Default)]
pub struct ScalarTracer;

impl Tracer for ScalarTracer {
    fn info(&self) -> DeviceInfo {
        DeviceInfo {
            kind: DeviceKind::Scalar,
            name: "f64 scalar".to_owned(),
            width: 1,
            threads: rayon::current_num_threads() as u32,
        }
    }

    fn trace(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error> {
        job.validate()?;
        if job.settings.denoise {
            let memory = FilterMemory::default();
            return trace_denoised(self, Level::new(), &memory, scene, job, sink);
        }
        Ok(PathTracer::new(scene, job).trace(job, |index, _, rows| {
            sink(TileRadiance {
                index,
                dropped_samples: rows.iter().map(|row| row.dropped_samples).sum(),
                radiance: rows.into_iter().flat_map(|row| row.radiance).collect(),
            });
        }))
    }

    fn aovs(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileAovs) + Sync),
    ) -> Result<(), Error> {
        job.validate()?;
        let tracer = PathTracer::new(scene, job);
        job.tiles.par_iter().enumerate().for_each(|(index, &tile)| {
            if !job.cancelled.load(Ordering::Relaxed) {
                let pixels = tracer.aovs(tile);
                sink(TileAovs { index, pixels });
            }
        });
        Ok(())
    }
}

impl DenoiseSource for ScalarTracer {
    fn trace_denoise_input(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(DenoiseInputTile) + Sync),
    ) -> Result<TraceStats, Error> {
        let tracer = PathTracer::new(scene, job);
        Ok(tracer.trace(job, |index, tile, rows| {
            let hits = tracer.aovs(tile);
            let dropped_samples = rows.iter().map(|row| row.dropped_samples).sum();
            sink(DenoiseInputTile {
                index,
                tile,
                pixels: denoise_input(job.settings.samples, &rows, &hits),
                dropped_samples,
            });
        }))
    }

    fn trace_hits(
        &self,
        scene: &CompiledScene,
        size: ImageSize,
        settings: RenderSettings,
        pixels: &[(u32, u32)],
    ) -> Vec<Aovs> {
        let frame = scene.camera_frame(size);
        let tracer = PathTracer {
            scene,
            frame,
            settings,
        };
        let pixels = pixels.par_iter();
        pixels.map(|&(x, y)| tracer.pixel_aovs(x, y)).collect()
    }
}

fn denoise_input(samples: u32, rows: &[TileRow], hits: &[Aovs]) -> DenoiseInput {
    let aovs = |hits: &[Aovs]| columns(hits.iter().map(Aovs::columns));
    let radiance = columns(rows.iter().flat_map(|row| row.radiance.iter().copied()));
    let half = columns(rows.iter().flat_map(|row| row.half.iter().copied()));
    let hits = aovs(hits);
    let mut pixels = DenoiseInput::default();
    pixels.extend(
        samples,
        &SampleSums {
            counts: [1; 2],
            radiance: radiance.each_ref().map(Vec::as_slice),
            half: half.each_ref().map(Vec::as_slice),
            hits: hits.each_ref().map(Vec::as_slice),
        },
    );
    pixels
}

fn columns<const N: usize>(pixels: impl Iterator<Item = [f32; N]>) -> [Vec<f32>; N] {
    let mut columns = [const { Vec::new() }; N];
    for pixel in pixels {
        for (column, value) in columns.iter_mut().zip(pixel) {
            column.push(value);
        }
    }
    columns
}

/// What a path's throughput is multiplied by at Russian roulette: 0 if it ends.
fn survival_weight(
    depth: u32,
    start: Option<RayOrigin>,
    beta: DVec3,
    random: impl Fn() -> f64,
) -> f64 {
    let survival = f64::from(SURVIVAL_PER_THROUGHPUT) * beta.max_element();
    let is_inside = start.is_some_and(|start| start.is_inside);
    if depth < ROULETTE_DEPTH || is_inside || survival >= 1.0 {
        return 1.0;
    }
    if random() < survival {
        survival.recip()
    } else {
        0.0
    }
}

/// The ray through film position `(x, y)`, in pixels from the image's top left corner, and through the point of the lens
/// that `lens` in the unit square is mapped to.
pub fn camera_ray(frame: &CameraFrame, [x, y]: [f64; 2], lens: [f64; 2]) -> Ray {
    let (dx, dy) = (vector(frame.dx), vector(frame.dy));
    let [u, v] = [lens[0].sqrt(), TAU * lens[1]];
    let (u, v) = (u * v.cos(), u * v.sin());
    let (lens_steps, lens_film) = (f64::from(frame.lens_steps), f64::from(frame.lens_film));
    let (film_x, film_y) = (x - lens_film * u, y - lens_film * v);
    let direction = vector(frame.corner) + film_x * dx + film_y * dy;
    Ray {
        origin: vector(frame.eye) + lens_steps * (u * dx + v * dy),
        direction: direction.normalize(),
    }
}

/// What all paths of a picture share.
#[derive(Clone, Copy)]
struct PathTracer<'a> {
    scene: &'a CompiledScene,
    frame: CameraFrame,
    settings: RenderSettings,
}

/// A row of a tile.
#[derive(Default)]
struct TileRow {
    radiance: Vec<[f32; 3]>,
    /// Of the first half of the samples.
    half: Vec<[f32; 3]>,
    dropped_samples: u32,
    rays: u64,
}

/// A vertex of a path on a surface that scatters.
struct Vertex {
    point: DVec3,
    /// Unit normal to shade with, on the side of `wo`.
    n: DVec3,
    /// Unit normal of the surface on the side of `wo`.
    geometric_n: DVec3,
    wo: DVec3,
    primitive: Primitive,
    /// `wo` is inside the body.
    is_inside: bool,
    scatter: Scatter,
    /// [`light_weight_sum`] at the point, over the probability with which an area light is aimed at at all.
    light_weight_sum: f64,
    /// Its mirror is mollified ([`crate::regularisation`]).
    is_regularised: bool,
}

impl<'a> PathTracer<'a> {
    fn new(scene: &'a CompiledScene, job: &TraceJob<'_>) -> Self {
        Self {
            scene,
            frame: scene.camera_frame(job.size),
            settings: job.settings,
        }
    }

    /// Traces a job and hands the rows of each tile over.
    fn trace(
        &self,
        job: &TraceJob<'_>,
        sink: impl Fn(usize, Tile, Vec<TileRow>) + Sync,
    ) -> TraceStats {
        let tiles = job.tiles.par_iter().enumerate();
        let rays = tiles.map(|(index, tile)| self.tile(index, tile, job, &sink));
        let (pixels, rays) = rays.reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        TraceStats {
            samples: pixels * u64::from(job.settings.samples),
            rays,
            ..TraceStats::default()
        }
    }

    /// Traces a tile and hands it over; returns its pixels and rays, none if cancelled on the way.
    fn tile(
        &self,
        index: usize,
        tile: &Tile,
        job: &TraceJob<'_>,
        sink: &(impl Fn(usize, Tile, Vec<TileRow>) + Sync),
    ) -> (u64, u64) {
        let rows = (tile.y..tile.y + tile.height).into_par_iter();
        let rows =
            rows.map(|y| (!job.cancelled.load(Ordering::Relaxed)).then(|| self.row(tile, y)));
        let Some(rows) = rows.collect::<Option<Vec<TileRow>>>() else {
            return (0, 0);
        };
        let rays = rows.iter().map(|row| row.rays).sum();
        sink(index, *tile, rows);
        (tile.pixels() as u64, rays)
    }

    fn row(&self, tile: &Tile, y: u32) -> TileRow {
        let mut row = TileRow::default();
        for x in tile.x..tile.x + tile.width {
            let mut sum = DVec3::ZERO;
            let half = self.settings.samples / 2;
            for taken in 0..self.settings.samples {
                if taken == half {
                    let mean = sum / f64::from(half.max(1));
                    row.half.push(mean.as_vec3().to_array());
                }
                let sample = self.settings.first_sample.wrapping_add(taken);
                let radiance = self.path(x, y, sample, &mut row.rays);
                if radiance.is_finite() {
                    sum += radiance;
                } else {
                    row.dropped_samples += 1;
                }
            }
            let mean = sum / f64::from(self.settings.samples);
            row.radiance.push(mean.as_vec3().to_array());
        }
        row
    }

    /// Radiance along one path.
    #[expect(clippy::too_many_lines, reason = "one path's steps in order")]
    fn path(&self, x: u32, y: u32, sample: u32, rays: &mut u64) -> DVec3 {
        let (pixel, key) = (pixel_key(x, y), sample_key(sample));
        let random = |block| pair(pixel, key, block, self.settings.seed).map(f64::from);
        let [u, v] = random(BLOCK_CAMERA);
        let film = [f64::from(x) + u, f64::from(y) + v];
        let mut ray = camera_ray(&self.frame, film, random(BLOCK_LENS));
        let (mut radiance, mut beta) = (DVec3::ZERO, DVec3::ONE);
        let mut start = None;
        let mut prev = PrevVertex::UNWEIGHED;
        for depth in 0..=self.settings.max_depth {
            *rays += 1;
            let is_emission = depth <= 1 && self.is_emission(prev, start);
            let Some(hit) = intersect_from(self.scene, &ray, start) else {
                if is_emission {
                    return radiance;
                }
                return radiance + beta * self.environment_with_mis(ray.direction, prev);
            };
            let ([u1, u2], [u0, u3]) = (random(block_scatter(depth)), random(block_choice(depth)));
            if let Some((medium, enclosing)) = self.medium(start) {
                let flight = medium.sample_distance(hit.t, u3);
                beta *= flight.weight;
                if let Some(distance) = flight.scattered_at {
                    let point = ray.origin + distance * ray.direction;
                    // The refraction counts as a scattering.
                    if depth + 2 <= self.settings.max_depth {
                        let u = random(block_light(depth));
                        radiance += beta
                            * self
                                .sample_light_through_boundary(enclosing, &medium, point, u, rays);
                    }
                    ray = Ray {
                        origin: point,
                        direction: uniform_direction(u1, u2),
                    };
                    prev = PrevVertex::SCATTERED;
                    continue;
                }
            }
            if let Primitive::AreaLight(light) = hit.primitive {
                if is_emission {
                    return radiance;
                }
                let light = &self.scene.area_lights[light as usize];
                return radiance + beta * self.emission_with_mis(light, &ray, &hit, prev);
            }
            let is_last = depth == self.settings.max_depth;
            if is_last && !self.scene.has_emission() {
                return radiance;
            }
            let footprint_m = self.footprint_m(&hit, depth);
            let vertex = Vertex::new(self.scene, &ray, &hit, footprint_m);
            radiance += beta * self.surface_emission_with_mis(&vertex, &hit, prev);
            if is_last {
                return radiance;
            }
            let vertex = vertex.regularised(prev.is_spread && key & KEY_MASK == 0);
            if !vertex.is_regularised && (!self.settings.denoise || depth > 0) {
                radiance += beta * self.coat_reflected_light(&vertex, rays);
            }
            radiance += beta * self.direct_light(&vertex, random(block_light(depth)), rays);
            let sample = vertex.sample([u0, u1, u2, u3]);
            beta *= sample.weight;
            ray = Ray {
                origin: vertex.point,
                direction: sample.wi,
            };
            start = Some(vertex.ray_origin(sample.wi));
            let is_known = prev.is_scattered && self.exits_by_nee_hemisphere(&vertex, start, hit.t);
            prev = prev.next(&vertex, sample.pdf, is_known);
            // The number that a body's flight would take.
            beta *= survival_weight(depth, start, beta, || random(block_choice(depth + 1))[1]);
            if beta == DVec3::ZERO {
                return radiance;
            }
        }
        radiance
    }

    /// About how wide the surface is that a pixel sees where a camera ray meets it, in metres; 0 where others meet it.
    fn footprint_m(&self, hit: &Hit, depth: u32) -> f64 {
        match depth {
            0 => hit.t * vector(self.frame.dx).length(),
            _ => 0.0,
        }
    }

    /// Whether light that a path ends in is first hits' emission, which for denoised pictures is traced
    /// apart.
    fn is_emission(&self, prev: PrevVertex, start: Option<RayOrigin>) -> bool {
        let is_outside = start.is_none_or(|start| !start.is_inside);
        self.settings.denoise && prev.is_mirror() && is_outside
    }

    /// What a ray flies through, and what that fills.
    fn medium(&self, start: Option<RayOrigin>) -> Option<(Medium, Primitive)> {
        let enclosing = start.filter(|start| start.is_inside)?.primitive;
        let material = self.scene.material_of(enclosing)?;
        Some((Medium::new(material), enclosing))
    }

    /// A body through whose boundary light that is scattered inside aims at area lights.
    fn nee_boundary(&self, enclosing: Primitive) -> Option<NeeBoundary<'a>> {
        let Primitive::Sphere(index) = enclosing else {
            return None;
        };
        let sphere = &self.scene.spheres[index as usize];
        let material = self.scene.material_of(enclosing)?;
        (sphere.allows_refracted_nee == 1).then_some(NeeBoundary {
            sphere,
            ior: f64::from(material.ior),
            primitive: enclosing,
        })
    }

    /// Whether a ray that was scattered inside leaves, after `length`, where area lights have been
    /// aimed at.
    fn exits_by_nee_hemisphere(
        &self,
        vertex: &Vertex,
        start: Option<RayOrigin>,
        length: f64,
    ) -> bool {
        let cos_i = vertex.wo.dot(vertex.n);
        start.is_some_and(|start| !start.is_inside)
            && (self.nee_boundary(vertex.primitive))
                .is_some_and(|boundary| length <= f64::from(boundary.sphere.radius) * cos_i)
    }

    /// Next-event estimation through a boundary, of light that is scattered evenly at `point` inside.
    fn sample_light_through_boundary(
        &self,
        enclosing: Primitive,
        medium: &Medium,
        point: DVec3,
        u: [f64; 2],
        rays: &mut u64,
    ) -> DVec3 {
        let Some(boundary) = self.nee_boundary(enclosing) else {
            return DVec3::ZERO;
        };
        let Some(chosen) = sample_light(&self.scene.area_lights, point, u) else {
            return DVec3::ZERO;
        };
        let light = &self.scene.area_lights[chosen.index];
        let normal = vector(light.normal);
        let straight = chosen.seen.sample(chosen.u);
        let target = point + straight.distance * straight.wi;
        let Some(refracted) = RefractedPath::new(boundary.sphere, boundary.ior, point, target)
        else {
            return DVec3::ZERO;
        };
        let [inside, outside] = refracted.lengths;
        *rays += 2;
        let is_dark = |origin, direction, is_inside, length: f64| {
            let ray_origin = RayOrigin {
                primitive: boundary.primitive,
                is_inside,
            };
            let met = intersect_from(self.scene, &Ray { origin, direction }, Some(ray_origin));
            let own = [
                boundary.primitive,
                Primitive::AreaLight(chosen.index as u32),
            ];
            met.is_some_and(|hit| hit.t < length && !own.contains(&hit.primitive))
        };
        if is_dark(point, refracted.inner, true, inside)
            || is_dark(refracted.place, refracted.outer, false, outside)
        {
            return DVec3::ZERO;
        }
        let passed = 1.0 - fresnel_dielectric(refracted.cos_i, 1.0 / boundary.ior);
        // Radiance is denser by the square of the index inside.
        let passed = passed * boundary.ior * boundary.ior * medium.transmittance(inside);
        let cosines = refracted.outer.dot(normal) / straight.wi.dot(normal);
        let inverse_pdf = straight.inverse_pdf / chosen.probability;
        let inverse_pdf = inverse_pdf * straight.distance.powi(2) * cosines / refracted.spread;
        passed * vector(light.radiance) * (inverse_pdf.max(0.0) / (4.0 * PI))
    }

    /// Weighted radiance of an area light that a ray finds.
    fn emission_with_mis(
        &self,
        light: &AreaLightData,
        ray: &Ray,
        hit: &Hit,
        prev: PrevVertex,
    ) -> DVec3 {
        if ray.direction.dot(hit.n) >= 0.0 || light.brightness == 0.0 {
            return DVec3::ZERO;
        }
        let density = f64::from(light.brightness) / prev.light_weight_sum;
        let weight = prev.pdf.map_or(1.0, |pdf| power_heuristic(pdf, density));
        weight * vector(light.radiance)
    }

    /// Weighted radiance that a surface emits which a ray finds.
    fn surface_emission_with_mis(&self, vertex: &Vertex, hit: &Hit, prev: PrevVertex) -> DVec3 {
        let emission = vertex.scatter.emission();
        let Some(pdf) = prev.sampled_pdf else {
            return emission;
        };
        let origin = vertex.point + hit.t * vertex.wo;
        let cosine = vertex.wo.dot(vertex.geometric_n).abs();
        let density = emissive_surface_density(self.scene, hit.primitive, origin, hit.t, cosine);
        emission * power_heuristic(pdf, density)
    }

    /// Weighted radiance of the environment that a ray finds.
    fn environment_with_mis(&self, direction: DVec3, prev: PrevVertex) -> DVec3 {
        let map = &self.scene.environment_map;
        let radiance = environment_radiance(self.scene, direction);
        match prev.sampled_pdf {
            Some(pdf) if map.probability > 0.0 => {
                let density = f64::from(map.probability) * map.pdf(direction);
                radiance * power_heuristic(pdf, density)
            }
            _ => radiance,
        }
    }

    /// Light of the area light that a coat reflects: drawn by chance alone, this small, bright image
    /// would be most of the noise of a ball.
    fn coat_reflected_light(&self, vertex: &Vertex, rays: &mut u64) -> DVec3 {
        let cos_o = vertex.wo.dot(vertex.n);
        let reflectance = vertex.scatter.coat(cos_o);
        if reflectance == 0.0 {
            return DVec3::ZERO;
        }
        let ray = Ray {
            origin: vertex.point,
            direction: 2.0 * cos_o * vertex.n - vertex.wo,
        };
        let Some((index, distance)) = nearest_area_light(self.scene, &ray) else {
            return DVec3::ZERO;
        };
        let light = &self.scene.area_lights[index];
        if ray.direction.dot(vector(light.normal)) >= 0.0
            || self.is_occluded(vertex, ray.direction, distance, index, rays)
        {
            return DVec3::ZERO;
        }
        reflectance * vector(light.radiance)
    }

    /// Next-event estimation: light that comes straight from a surface that emits, from a light without extent, from the
    /// environment, or from one point of one area light.
    fn direct_light(&self, vertex: &Vertex, [u, v]: [f64; 2], rays: &mut u64) -> DVec3 {
        let emissive = f64::from(self.scene.emissive_surfaces.probability());
        if u < emissive {
            return self.direct_emissive_surface(vertex, [u / emissive, v], rays);
        }
        let u = u - emissive;
        let punctual = f64::from(self.scene.punctual_probability);
        if u < punctual {
            return self.direct_punctual_light(vertex, u / punctual, rays);
        }
        let u = u - punctual;
        let environment = f64::from(self.scene.environment_map.probability);
        if u < environment {
            return self.direct_environment_light(vertex, [u / environment, v], rays);
        }
        let u = (u - environment) / self.scene.area_light_probability();
        self.direct_area_light(vertex, [u.min(BELOW_1), v], rays)
    }

    fn direct_emissive_surface(&self, vertex: &Vertex, u: [f64; 2], rays: &mut u64) -> DVec3 {
        let Some(chosen) = sample_emissive_surface(self.scene, vertex.point, u) else {
            return DVec3::ZERO;
        };
        let EmissiveDirection { wi, distance, .. } = chosen.direction;
        let (f, pdf_scatter) = vertex.scatter.eval(vertex.wo, wi, vertex.n);
        let reach = distance * f64::from(EMISSIVE_SURFACE_REACH);
        if f == DVec3::ZERO
            || vertex.is_below(wi)
            || vertex.ray_origin(wi).is_inside
            || self.is_occluded(vertex, wi, reach, usize::MAX, rays)
        {
            return DVec3::ZERO;
        }
        let weight = power_heuristic(chosen.density, pdf_scatter);
        f * chosen.emission * (vertex.cosine(wi) * weight * chosen.inverse_pdf)
    }

    fn direct_punctual_light(&self, vertex: &Vertex, u: f64, rays: &mut u64) -> DVec3 {
        let lights = &self.scene.punctual_lights;
        let Some(chosen) = sample_punctual_light(lights, vertex.point, u.min(BELOW_1)) else {
            return DVec3::ZERO;
        };
        let (f, _) = vertex.scatter.eval(vertex.wo, chosen.wi, vertex.n);
        if f == DVec3::ZERO
            || vertex.is_below(chosen.wi)
            || vertex.ray_origin(chosen.wi).is_inside
            || self.is_occluded(vertex, chosen.wi, chosen.distance, usize::MAX, rays)
        {
            return DVec3::ZERO;
        }
        let cos_i = vertex.cosine(chosen.wi);
        f * chosen.irradiance * (cos_i / f64::from(self.scene.punctual_probability))
    }

    fn direct_environment_light(&self, vertex: &Vertex, u: [f64; 2], rays: &mut u64) -> DVec3 {
        let map = &self.scene.environment_map;
        let chosen = map.sample_direction(u.map(|u| u.min(BELOW_1)));
        let (f, pdf_scatter) = vertex.scatter.eval(vertex.wo, chosen.wi, vertex.n);
        if f == DVec3::ZERO
            || vertex.is_below(chosen.wi)
            || vertex.ray_origin(chosen.wi).is_inside
            || self.is_occluded(vertex, chosen.wi, f64::INFINITY, usize::MAX, rays)
        {
            return DVec3::ZERO;
        }
        let inverse_density = chosen.inverse_pdf / f64::from(map.probability);
        let weight = 1.0 / (1.0 + (pdf_scatter * inverse_density).powi(2));
        let cos_i = vertex.cosine(chosen.wi);
        f * chosen.radiance * (cos_i * weight * inverse_density)
    }

    fn direct_area_light(&self, vertex: &Vertex, u: [f64; 2], rays: &mut u64) -> DVec3 {
        let Some(chosen) = sample_light(&self.scene.area_lights, vertex.point, u) else {
            return DVec3::ZERO;
        };
        let light = &self.scene.area_lights[chosen.index];
        let LightDirection {
            wi,
            distance,
            inverse_pdf,
        } = chosen.seen.sample(chosen.u);
        let (f, pdf_scatter) = vertex.scatter.eval(vertex.wo, wi, vertex.n);
        let coat = vertex.regularised_coat(wi);
        if (f == DVec3::ZERO && coat == 0.0)
            || vertex.is_below(wi)
            || vertex.ray_origin(wi).is_inside
            || self.is_occluded(vertex, wi, distance, chosen.index, rays)
        {
            return DVec3::ZERO;
        }
        let density = f64::from(light.brightness) / vertex.light_weight_sum;
        let weight = power_heuristic(density, pdf_scatter);
        let cos_i = vertex.cosine(wi);
        let reflected = f * (cos_i * weight) + coat;
        let probability = self.scene.area_light_probability() * chosen.probability;
        reflected * vector(light.radiance) * (inverse_pdf / probability)
    }

    /// Whether something is in between a vertex and a point of area light `index`.
    fn is_occluded(
        &self,
        vertex: &Vertex,
        direction: DVec3,
        distance: f64,
        index: usize,
        rays: &mut u64,
    ) -> bool {
        *rays += 1;
        let ray = Ray {
            origin: vertex.point,
            direction,
        };
        let met = intersect_from(self.scene, &ray, Some(vertex.ray_origin(direction)));
        met.is_some_and(|hit| {
            hit.t < distance && hit.primitive != Primitive::AreaLight(index as u32)
        })
    }
}

/// A ball through whose boundary area lights are aimed at.
struct NeeBoundary<'a> {
    sphere: &'a SphereData,
    ior: f64,
    primitive: Primitive,
}

/// How a ray's direction was found: what weighs an area light along it.
#[derive(Clone, Copy)]
struct PrevVertex {
    /// That of [`bsdf::BsdfSample`].
    pdf: Option<f64>,
    /// [`light_weight_sum`] where the ray began.
    light_weight_sum: f64,
    /// The density of its direction, if it has one.
    sampled_pdf: Option<f64>,
    /// It began where light was scattered inside a body.
    is_scattered: bool,
    /// It comes from a diffuse surface, or by way of coats and metals from one.
    is_spread: bool,
}

impl PrevVertex {
    /// By the camera.
    const UNWEIGHED: Self = Self {
        pdf: None,
        light_weight_sum: 0.0,
        sampled_pdf: None,
        is_scattered: false,
        is_spread: false,
    };
    /// In a medium.
    const SCATTERED: Self = Self {
        is_scattered: true,
        ..Self::UNWEIGHED
    };

    /// Of a direction drawn at `vertex`, along which area lights may be known already.
    fn next(self, vertex: &Vertex, pdf: Option<f64>, is_known: bool) -> Self {
        let is_diffuse = vertex.scatter.is_layered();
        Self {
            pdf: if is_known { Some(0.0) } else { pdf },
            light_weight_sum: vertex.light_weight_sum,
            sampled_pdf: pdf.filter(|&pdf| pdf > 0.0),
            is_scattered: false,
            is_spread: pdf.is_some_and(|pdf| self.is_spread || (pdf > 0.0 && is_diffuse)),
        }
    }

    /// Or by the camera.
    fn is_mirror(self) -> bool {
        self.pdf.is_none_or(|pdf| pdf == 0.0)
    }
}

impl Vertex {
    fn new(scene: &CompiledScene, ray: &Ray, hit: &Hit, footprint_m: f64) -> Self {
        let wo = -ray.direction;
        let is_inside = hit.n.dot(wo) < 0.0;
        let side = if is_inside { -1.0 } else { 1.0 };
        let geometric_n = side * hit.n;
        let n = match hit.shading_n == hit.n {
            true => geometric_n,
            false => visible_shading_normal(side * hit.shading_n, geometric_n, wo),
        };
        Self {
            point: hit.point,
            n,
            geometric_n,
            wo,
            primitive: hit.primitive,
            is_inside,
            scatter: Scatter::new(scene, hit, wo, footprint_m),
            light_weight_sum: light_weight_sum(&scene.area_lights, hit.point)
                / scene.area_light_probability(),
            is_regularised: false,
        }
    }

    /// The cosine at which light falls in from `wi`.
    fn cosine(&self, wi: DVec3) -> f64 {
        self.scatter.cosine(wi, self.n).abs()
    }

    /// Whether `wi` is on the other side of a surface than of the normal that it is shaded with; what lets no light pass
    /// has only one.
    fn is_below(&self, wi: DVec3) -> bool {
        let is_passed = self.scatter.lets_light_pass() && wi.dot(self.n) < 0.0;
        let height = wi.dot(self.geometric_n) * if is_passed { -1.0 } else { 1.0 };
        let is_smooth = self.n != self.geometric_n || self.scatter.has_clearcoat_normal();
        is_smooth && height <= 0.0
    }

    /// Draws a direction: one below the surface brings nothing.
    fn sample(&self, u: [f64; 4]) -> BsdfSample {
        let mut sample = self.scatter.sample(self.wo, self.n, u);
        if self.is_below(sample.wi) {
            sample.weight = DVec3::ZERO;
        }
        sample
    }

    /// Its mirror mollified, if it is to be.
    fn regularised(mut self, is_regularised: bool) -> Self {
        self.is_regularised = is_regularised;
        if !is_regularised {
            return self;
        }
        match &mut self.scatter {
            Scatter::Conductor(Conductor { alpha, .. }) => {
                *alpha = alpha.max(f64::from(ALPHA_MIN));
            }
            Scatter::MetallicRoughness(MetallicRoughness {
                alpha,
                clearcoat_alpha,
                ..
            }) => {
                *alpha = alpha.max(f64::from(ALPHA_MIN));
                *clearcoat_alpha = clearcoat_alpha.max(f64::from(ALPHA_MIN));
            }
            Scatter::Layered(_) | Scatter::Dielectric(_) => {}
        }
        self
    }

    /// The share of light from `wi` that a coat's mirror reflects where it is regularised, sr⁻¹.
    fn regularised_coat(&self, wi: DVec3) -> f64 {
        let cos_o = self.wo.dot(self.n);
        let mirrored = 2.0 * cos_o * self.n - self.wo;
        let is_in_cone = wi.dot(mirrored) > f64::from(CONE_COSINE) && wi.dot(self.n) > 0.0;
        if !self.is_regularised || !is_in_cone {
            return 0.0;
        }
        self.scatter.coat(cos_o) * f64::from(CONE_DENSITY)
    }

    /// How a ray towards `wi` begins: what is not transmissive is left outwards, on either side.
    fn ray_origin(&self, wi: DVec3) -> RayOrigin {
        let is_passed = wi.dot(self.n) < 0.0;
        RayOrigin {
            primitive: self.primitive,
            is_inside: self.scatter.is_dielectric() && self.is_inside != is_passed,
        }
    }
}

/// Weight of a sample drawn with density `chosen` where a second technique has density `other`
/// (Veach 1997, section 9.2.4, exponent 2).
fn power_heuristic(chosen: f64, other: f64) -> f64 {
    let ratio = other / chosen;
    1.0 / (1.0 + ratio * ratio)
}
