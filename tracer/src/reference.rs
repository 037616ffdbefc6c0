//! Reference path tracer: f64, one path at a time, BSDF sampling and light sampling combined by
//! multiple importance sampling (Veach 1997, chapter 9), as in Pharr, Jakob and Humphreys,
//! "Physically Based Rendering", 4th edition, sections 13.4 and 14.2.
//!
//! The other tracers agree with it in expectation. It shares only basic functions with [`crate::scalar`]:
//! intersection, and evaluation and sampling of BSDFs. Lights, media and MIS weights are implemented
//! independently, image textures are sampled at the finest level, and random numbers are independent: any
//! generator will do.

use glam::DVec3;

use crate::CompiledScene;
use crate::compiled::{AreaLightData, MaterialData, Primitive, PunctualLightData};
use crate::scalar::environment::environment_radiance;
use crate::scalar::intersect::{Hit, Ray, RayOrigin, intersect_from, vector};
use crate::scalar::punctual_light::PunctualIncidence;
use crate::scalar::triangle::visible_shading_normal;
use crate::scalar::{medium::uniform_direction, scatter::Scatter};

/// Radiance estimate of one path along `ray` with at most `max_depth` scattering events. `random` returns
/// independent numbers, uniform in [0, 1).
pub fn radiance(
    scene: &CompiledScene,
    mut ray: Ray,
    max_depth: u32,
    random: &mut dyn FnMut() -> f64,
) -> DVec3 {
    let (mut radiance, mut beta) = (DVec3::ZERO, DVec3::ONE);
    let mut ray_origin: Option<RayOrigin> = None;
    // Density of the ray's direction; `None` where light sampling could not have drawn it.
    let mut bsdf_pdf = None;
    for depth in 0..=max_depth {
        let Some(hit) = intersect_from(scene, &ray, ray_origin) else {
            let map = &scene.environment_map;
            let weight = match bsdf_pdf {
                Some(pdf) if !map.is_empty() => {
                    power_heuristic(pdf, map.pdf(ray.direction) * choice(scene))
                }
                _ => 1.0,
            };
            return radiance + beta * weight * environment_radiance(scene, ray.direction);
        };
        let enclosing = ray_origin.filter(|ray_origin| ray_origin.is_inside);
        if let Some(medium) = enclosing.and_then(|body| scene.material_of(body.primitive)) {
            let (scattered_at, weight) = sample_distance(medium, hit.t, random);
            beta *= weight;
            if let Some(distance) = scattered_at {
                ray.origin += distance * ray.direction;
                ray.direction = uniform_direction(random(), random());
                bsdf_pdf = None;
                continue;
            }
        }
        if let Primitive::AreaLight(index) = hit.primitive {
            let light = &scene.area_lights[index as usize];
            let Some(light_pdf) = light_pdf(scene, light, &ray, hit.t) else {
                break;
            };
            let weight = bsdf_pdf.map_or(1.0, |pdf| power_heuristic(pdf, light_pdf));
            return radiance + beta * weight * light.radiance_at(hit.point);
        }
        let vertex = SurfaceVertex::new(scene, &ray, hit, random);
        // Emissive surfaces are found by BSDF sampling alone, with weight 1.
        radiance += beta * vertex.bsdf.emission();
        if depth == max_depth {
            break;
        }
        radiance += beta * direct_light(scene, &vertex, random);
        let sample = (vertex.bsdf).sample(vertex.wo, vertex.n, [(); 4].map(|()| random()));
        if vertex.is_below(sample.wi) {
            break;
        }
        beta *= sample.weight;
        let left = vertex.ray_origin(sample.wi);
        // A mirror has no density, and light is not sampled inside bodies.
        bsdf_pdf = sample.pdf.filter(|&pdf| pdf > 0.0 && !left.is_inside);
        (ray.origin, ray.direction) = (vertex.hit.point, sample.wi);
        ray_origin = Some(left);
    }
    radiance
}

/// Light sampling: a light drawn uniformly, and a point uniform on its area.
fn direct_light(
    scene: &CompiledScene,
    vertex: &SurfaceVertex,
    random: &mut dyn FnMut() -> f64,
) -> DVec3 {
    let index = (random() / choice(scene)) as usize;
    let Some(light) = scene.area_lights.get(index) else {
        let index = index - scene.area_lights.len();
        return match scene.punctual_lights.get(index) {
            Some(light) => punctual_light(scene, vertex, light),
            None if scene.environment_map.is_empty() => DVec3::ZERO,
            None => environment_light(scene, vertex, random),
        };
    };
    let [u, v] = (light.half_edges()).map(|half| (2.0 * random() - 1.0) * vector(half));
    let to_light = vector(light.center) + u + v - vertex.hit.point;
    let (origin, direction) = (vertex.hit.point, to_light.normalize());
    let shadow_ray = Ray { origin, direction };
    let ray_origin = vertex.ray_origin(direction);
    // Full intersection instead of an occlusion test: shadow rays see exactly what camera rays would.
    let nearest = intersect_from(scene, &shadow_ray, Some(ray_origin));
    let is_visible = nearest.is_some_and(|hit| hit.primitive == Primitive::AreaLight(index as u32));
    match light_pdf(scene, light, &shadow_ray, to_light.length()) {
        Some(light_pdf) if is_visible && !ray_origin.is_inside && !vertex.is_below(direction) => {
            let (f, bsdf_pdf) = vertex.bsdf.eval(vertex.wo, direction, vertex.n);
            let weight = power_heuristic(light_pdf, bsdf_pdf);
            let radiance = light.radiance_at(vertex.hit.point + to_light);
            f * radiance * (vertex.cosine(direction) * weight / light_pdf)
        }
        _ => DVec3::ZERO,
    }
}

/// Light sampling of the environment map by its density.
fn environment_light(
    scene: &CompiledScene,
    vertex: &SurfaceVertex,
    random: &mut dyn FnMut() -> f64,
) -> DVec3 {
    let chosen = scene.environment_map.sample_direction([random(), random()]);
    let (origin, direction) = (vertex.hit.point, chosen.wi);
    let ray_origin = vertex.ray_origin(direction);
    let nearest = intersect_from(scene, &Ray { origin, direction }, Some(ray_origin));
    if nearest.is_some() || ray_origin.is_inside || vertex.is_below(direction) {
        return DVec3::ZERO;
    }
    let (f, bsdf_pdf) = vertex.bsdf.eval(vertex.wo, direction, vertex.n);
    let inverse_pdf = chosen.inverse_pdf / choice(scene);
    let weight = 1.0 / (1.0 + (bsdf_pdf * inverse_pdf).powi(2));
    f * chosen.radiance * (vertex.cosine(direction) * weight * inverse_pdf)
}

/// Light of a punctual light, over its probability.
fn punctual_light(
    scene: &CompiledScene,
    vertex: &SurfaceVertex,
    light: &PunctualLightData,
) -> DVec3 {
    let incidence = PunctualIncidence::new(light, vertex.hit.point);
    let (origin, direction) = (vertex.hit.point, incidence.wi);
    let ray_origin = vertex.ray_origin(direction);
    let nearest = intersect_from(scene, &Ray { origin, direction }, Some(ray_origin));
    let is_dark = nearest.is_some_and(|hit| hit.t < incidence.distance);
    if is_dark || ray_origin.is_inside || vertex.is_below(direction) {
        return DVec3::ZERO;
    }
    let (f, _) = vertex.bsdf.eval(vertex.wo, direction, vertex.n);
    f * incidence.irradiance * (vertex.cosine(direction) / choice(scene))
}

/// Probability of each light: area lights, punctual lights and the environment map.
fn choice(scene: &CompiledScene) -> f64 {
    let map = usize::from(!scene.environment_map.is_empty());
    1.0 / (scene.area_lights.len() + scene.punctual_lights.len() + map) as f64
}

/// Density of light sampling per solid angle for an area light hit at distance `t`; `None` from behind.
fn light_pdf(scene: &CompiledScene, light: &AreaLightData, ray: &Ray, t: f64) -> Option<f64> {
    let cosine = -ray.direction.dot(vector(light.normal));
    let area = 4.0 * f64::from(light.length_u) * f64::from(light.length_v);
    (cosine > 0.0).then(|| t * t * choice(scene) / (cosine * area))
}

/// MIS weight of a sample of density `chosen` where another technique has density `other` (Veach 1997,
/// exponent 2).
fn power_heuristic(chosen: f64, other: f64) -> f64 {
    chosen * chosen / (chosen * chosen + other * other)
}

/// Samples a free flight towards a surface at distance `t`: returns where it is scattered, if so, and its
/// weight. A channel is drawn uniformly, then a distance from its exponential distribution (3rd edition,
/// section 15.2.1).
fn sample_distance(
    medium: &MaterialData,
    t: f64,
    random: &mut dyn FnMut() -> f64,
) -> (Option<f64>, DVec3) {
    let extinction = vector(medium.extinction);
    // Compiled as scattering coefficient over sampling rate, which is undone here.
    let scattering = f64::from(medium.sampling_density) * vector(medium.scattering);
    let channel = (3.0 * random()) as usize;
    let distance = -(1.0 - random()).ln() / extinction[channel];
    let transmittance = (-extinction * distance.min(t)).map(f64::exp);
    if distance < t {
        let pdf = (extinction * transmittance).element_sum() / 3.0;
        return (Some(distance), scattering * (transmittance / pdf));
    }
    (None, transmittance / (transmittance.element_sum() / 3.0))
}

/// Surface point at which a path scatters; the shading normal `n` is on the side of `wo`.
struct SurfaceVertex {
    hit: Hit,
    wo: DVec3,
    n: DVec3,
    is_inside: bool,
    bsdf: Scatter,
}

impl SurfaceVertex {
    fn new(scene: &CompiledScene, ray: &Ray, hit: Hit, random: &mut dyn FnMut() -> f64) -> Self {
        let is_inside = ray.direction.dot(hit.n) > 0.0;
        let side = if is_inside { -1.0 } else { 1.0 };
        let (wo, n) = (-ray.direction, side * hit.n);
        let n = match hit.shading_n == hit.n {
            true => n,
            false => visible_shading_normal(side * hit.shading_n, n, wo),
        };
        let bsdf = Scatter::new(scene, &hit, wo, 0.0);
        Self {
            wo,
            n,
            is_inside,
            bsdf: bsdf.with_facet(wo, n, || [random(), random()]),
            hit,
        }
    }

    /// Cosine of the incident direction `wi`.
    fn cosine(&self, wi: DVec3) -> f64 {
        self.bsdf.cosine(wi, self.n).abs()
    }

    /// Whether shading and geometric normal of a triangle disagree on the side of `wi`.
    fn is_below(&self, wi: DVec3) -> bool {
        let is_passed = self.bsdf.lets_light_pass() && wi.dot(self.n) < 0.0;
        let side = wi.dot(self.hit.n) * self.wo.dot(self.hit.n);
        let is_far = if is_passed { side >= 0.0 } else { side <= 0.0 };
        let is_flat = self.hit.shading_n == self.hit.n && !self.bsdf.has_clearcoat_normal();
        is_far && !is_flat
    }

    /// Origin of a ray along `wi`, with the side of the surface on which it continues.
    fn ray_origin(&self, wi: DVec3) -> RayOrigin {
        let is_transmitted = wi.dot(self.n) < 0.0;
        RayOrigin {
            primitive: self.hit.primitive,
            is_inside: self.bsdf.is_dielectric() && self.is_inside != is_transmitted,
        }
    }
}
