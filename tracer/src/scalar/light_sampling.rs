//! Next-event estimation towards area lights, environment maps, punctual lights and emissive surfaces, out
//! of scattering balls, and towards area lights reflected by coats.

use std::f64::consts::PI;

use glam::DVec3;

use super::area_light::{LightDirection, sample_light};
use super::emissive_surface::{EmissiveDirection, sample_emissive_surface};
use super::integrator::{PathTracer, power_heuristic};
use super::intersect::{Ray, RayOrigin, intersect_from, nearest_area_light, vector};
use super::medium::Medium;
use super::punctual_light::sample_punctual_light;
use super::refracted_nee::RefractedPath;
use super::vertex::Vertex;
use crate::compiled::{EMISSIVE_SURFACE_REACH, Primitive};
use crate::fresnel::fresnel_dielectric;
use crate::sampling::BELOW_1;

impl PathTracer<'_> {
    /// Light of the area light that a coat's mirror reflects: by BSDF sampling alone this small, bright
    /// reflection would be most of the noise on a ball.
    pub(super) fn coat_reflected_light(&self, vertex: &Vertex, rays: &mut u64) -> DVec3 {
        let cos_o = vertex.wo.dot(vertex.n);
        let reflectance = vertex.scatter.coat(cos_o);
        if reflectance == 0.0 {
            return DVec3::ZERO;
        }
        let ray = Ray {
            origin: vertex.point,
            direction: vertex.scatter.mirrored(vertex.wo, vertex.n),
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
        reflectance * light.radiance_at(ray.origin + distance * ray.direction)
    }

    /// Next-event estimation: light from one point of an emissive surface, a punctual light, the
    /// environment map, or an area light.
    pub(super) fn direct_light(&self, vertex: &Vertex, [u, v]: [f64; 2], rays: &mut u64) -> DVec3 {
        // One number chooses the kind of light and is rescaled within its interval.
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
        // Power heuristic by the inverse density, which is 0 at the poles, where the density is infinite.
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
        let radiance = light.radiance_at(vertex.point + distance * wi);
        reflected * radiance * (inverse_pdf / probability)
    }

    /// Whether anything other than area light `index` lies before `distance`.
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

    /// Next-event estimation through a boundary, for light scattered isotropically at `point` inside.
    pub(super) fn sample_light_through_boundary(
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
        // Radiance inside is higher by the square of the refractive index.
        let passed = passed * boundary.ior * boundary.ior * medium.transmittance(inside);
        // The reciprocal density is converted from solid angle of straight directions to area on the light
        // by d² / cos, and to solid angle of the refracted path's first segment by the new cosine over the
        // spread.
        let cosines = refracted.outer.dot(normal) / straight.wi.dot(normal);
        let inverse_pdf = straight.inverse_pdf / chosen.probability;
        let inverse_pdf = inverse_pdf * straight.distance.powi(2) * cosines / refracted.spread;
        passed * light.radiance_at(target) * (inverse_pdf.max(0.0) / (4.0 * PI))
    }
}
