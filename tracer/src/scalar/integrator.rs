//! Integrator: traces one path from the camera to its end.

use std::f64::consts::TAU;
use std::sync::atomic::Ordering;

use glam::DVec3;
use rayon::prelude::*;

use super::emissive_surface::emissive_surface_density;
use super::environment::environment_radiance;
use super::intersect::{Hit, Ray, RayOrigin, intersect_from, vector};
use super::medium::{Medium, uniform_direction};
use super::vertex::Vertex;
use crate::compiled::{AreaLightData, CameraFrame, Primitive, SphereData};
use crate::regularisation::KEY_MASK;
use crate::sampling::{
    BLOCK_CAMERA, BLOCK_LENS, ROULETTE_DEPTH, SURVIVAL_PER_THROUGHPUT, block_choice, block_coat,
    block_light, block_scatter, pair, pixel_key, sample_key,
};
use crate::tracer::{TraceJob, TraceStats};
use crate::{CompiledScene, RenderSettings, Tile};

/// Camera ray from the near plane on, through film position `(x, y)`, in pixels from the image's top left
/// corner, and through the point of the lens to which `lens` in the unit square is mapped.
pub fn camera_ray(frame: &CameraFrame, [x, y]: [f64; 2], lens: [f64; 2]) -> Ray {
    let (dx, dy) = (vector(frame.dx), vector(frame.dy));
    // Square root of the first number: uniform on the disc of the lens.
    let [u, v] = [lens[0].sqrt(), TAU * lens[1]];
    let (u, v) = (u * v.cos(), u * v.sin());
    let (lens_steps, lens_film) = (f64::from(frame.lens_steps), f64::from(frame.lens_film));
    let (film_x, film_y) = (x - lens_film * u, y - lens_film * v);
    let direction = vector(frame.corner) + film_x * dx + film_y * dy;
    Ray {
        origin: vector(frame.eye)
            + lens_steps * (u * dx + v * dy)
            + f64::from(frame.near_m) * direction,
        direction: direction.normalize(),
    }
}

/// State shared by all paths of an image.
#[derive(Clone, Copy)]
pub(super) struct PathTracer<'a> {
    pub(super) scene: &'a CompiledScene,
    pub(super) frame: CameraFrame,
    pub(super) settings: RenderSettings,
}

/// Results of one row of a tile.
#[derive(Default)]
pub(super) struct TileRow {
    /// Mean radiance per pixel.
    pub(super) radiance: Vec<[f32; 3]>,
    /// Mean radiance of the first half of the samples.
    pub(super) half: Vec<[f32; 3]>,
    pub(super) dropped_samples: u32,
    rays: u64,
}

impl<'a> PathTracer<'a> {
    pub(super) fn new(scene: &'a CompiledScene, job: &TraceJob<'_>) -> Self {
        Self {
            scene,
            frame: scene.camera_frame(job.size),
            settings: job.settings,
        }
    }

    /// Traces a job and passes the rows of each tile to `sink`.
    pub(super) fn trace(
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

    /// Traces a tile and passes it to `sink`; returns its numbers of pixels and rays, 0 if cancelled.
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
                // Reached before the first sample of the second half.
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

    /// Radiance estimate of one path.
    #[expect(clippy::too_many_lines, reason = "one path's steps in order")]
    fn path(&self, x: u32, y: u32, sample: u32, rays: &mut u64) -> DVec3 {
        let (pixel, key) = (pixel_key(x, y), sample_key(sample));
        let random = |block| pair(pixel, key, block, self.settings.seed).map(f64::from);
        let [u, v] = random(BLOCK_CAMERA);
        // Every random number is addressed by its block. So a path that skips a decision shifts no later
        // ones, and CPU, GPU and this tracer follow the same path sample by sample.
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
                    // The refraction counts as a scattering event.
                    if depth + 2 <= self.settings.max_depth {
                        let u = random(block_light(depth));
                        radiance += beta
                            * self
                                .sample_light_through_boundary(enclosing, &medium, point, u, rays);
                    }
                    // `start` stays: the path is inside the same body, whose far side is still the next
                    // boundary.
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
            // The last edge only collects light: at a surface its emission.
            if is_last && !self.scene.has_emission() {
                return radiance;
            }
            let footprint_m = self.footprint_m(&hit, depth);
            let vertex = Vertex::new(self.scene, &ray, &hit, footprint_m);
            radiance += beta * self.surface_emission_with_mis(&vertex, &hit, prev);
            if is_last {
                return radiance;
            }
            let vertex = vertex
                .regularised(prev.is_spread && key & KEY_MASK == 0)
                .with_facet(|| random(block_coat(depth)));
            let is_traced_apart =
                self.settings.denoise && depth == 0 && !vertex.scatter.has_rough_coat();
            if !vertex.is_regularised && !is_traced_apart {
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
            // The number that a free flight at the next depth would use.
            beta *= survival_weight(depth, start, beta, || random(block_choice(depth + 1))[1]);
            if beta == DVec3::ZERO {
                return radiance;
            }
        }
        radiance
    }

    /// Approximate width of the surface that a pixel covers at a camera ray's hit, metres; 0 at later hits.
    pub(super) fn footprint_m(&self, hit: &Hit, depth: u32) -> f64 {
        match depth {
            0 => (f64::from(self.frame.near_m) + hit.t) * vector(self.frame.dx).length(),
            _ => 0.0,
        }
    }

    /// Whether the light at a path's end is part of the first-hit emission AOV, which denoised images trace
    /// separately.
    fn is_emission(&self, prev: PrevVertex, start: Option<RayOrigin>) -> bool {
        let is_outside = start.is_none_or(|start| !start.is_inside);
        self.settings.denoise && prev.is_mirror && is_outside
    }

    /// Medium that a ray travels through, and the body that it fills.
    fn medium(&self, start: Option<RayOrigin>) -> Option<(Medium, Primitive)> {
        let enclosing = start.filter(|start| start.is_inside)?.primitive;
        let material = self.scene.material_of(enclosing)?;
        Some((Medium::new(material), enclosing))
    }

    /// The ball around a path, if next-event estimation through its boundary is allowed.
    pub(super) fn nee_boundary(&self, enclosing: Primitive) -> Option<NeeBoundary<'a>> {
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

    /// Whether a ray scattered inside leaves, after `length`, by a path that refracted next-event
    /// estimation covers.
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

    /// MIS-weighted radiance of an area light that a ray has hit.
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
        // Density with which the previous vertex would have drawn this direction.
        let density = f64::from(light.brightness) / prev.light_weight_sum;
        let weight = prev.pdf.map_or(1.0, |pdf| power_heuristic(pdf, density));
        weight * light.radiance_at(hit.point)
    }

    /// MIS-weighted radiance of an emissive surface that a ray has hit.
    fn surface_emission_with_mis(&self, vertex: &Vertex, hit: &Hit, prev: PrevVertex) -> DVec3 {
        let emission = vertex.scatter.emission();
        let Some(pdf) = prev.sampled_pdf else {
            return emission;
        };
        // The ray's origin, recovered from its hit.
        let origin = vertex.point + hit.t * vertex.wo;
        let cosine = vertex.wo.dot(vertex.geometric_n).abs();
        let density = emissive_surface_density(self.scene, hit.primitive, origin, hit.t, cosine);
        emission * power_heuristic(pdf, density)
    }

    /// MIS-weighted radiance of the environment at which a ray ends.
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
}

/// A ball for next-event estimation through its boundary.
pub(super) struct NeeBoundary<'a> {
    pub(super) sphere: &'a SphereData,
    pub(super) ior: f64,
    pub(super) primitive: Primitive,
}

/// Origin of a ray: the data for MIS of light found along it.
#[derive(Clone, Copy)]
struct PrevVertex {
    /// [`super::bsdf::BsdfSample::pdf`] of its direction.
    pdf: Option<f64>,
    /// [`super::area_light::light_weight_sum`] at its origin.
    light_weight_sum: f64,
    /// Density of its direction per solid angle, if there is one.
    sampled_pdf: Option<f64>,
    /// Its origin is a scattering event inside a body.
    is_scattered: bool,
    /// It comes from a diffuse surface, directly or via coats and metals.
    is_spread: bool,
    /// It is a camera ray or a smooth mirror's, so that first-hit AOVs contain the light it finds.
    is_mirror: bool,
}

impl PrevVertex {
    /// Of a camera ray.
    const UNWEIGHED: Self = Self {
        pdf: None,
        light_weight_sum: 0.0,
        sampled_pdf: None,
        is_scattered: false,
        is_spread: false,
        is_mirror: true,
    };
    /// Of a scattering event in a medium.
    const SCATTERED: Self = Self {
        is_scattered: true,
        ..Self::UNWEIGHED
    };

    /// Data of a direction drawn at `vertex`; `is_known` if area lights along it have been sampled already.
    fn next(self, vertex: &Vertex, pdf: Option<f64>, is_known: bool) -> Self {
        let is_diffuse = vertex.scatter.is_layered();
        Self {
            pdf: if is_known { Some(0.0) } else { pdf },
            light_weight_sum: vertex.light_weight_sum,
            sampled_pdf: pdf.filter(|&pdf| pdf > 0.0),
            is_scattered: false,
            // A mirror's direction (no density) resets the flag: reflections seen in it stay sharp, like
            // what is seen directly.
            is_spread: pdf.is_some_and(|pdf| self.is_spread || (pdf > 0.0 && is_diffuse)),
            is_mirror: (is_known || pdf.is_none_or(|pdf| pdf == 0.0))
                && !vertex.scatter.has_rough_coat(),
        }
    }
}

/// Factor of the throughput by Russian roulette: 0 if the path is terminated.
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

/// MIS weight of a sample of density `chosen` where a second technique has density `other`
/// (Veach 1997, section 9.2.4, exponent 2).
pub(super) fn power_heuristic(chosen: f64, other: f64) -> f64 {
    // By the ratio, as squares of large densities would overflow.
    let ratio = other / chosen;
    1.0 / (1.0 + ratio * ratio)
}
