//! AOVs of first hits in f64.

use glam::DVec3;

use super::environment::environment_radiance;
use super::integrator::{PathTracer, camera_ray};
use super::intersect::{Hit, Ray, RayOrigin, intersect_from, vector};
use super::vertex::Vertex;
use crate::compiled::Primitive;
use crate::sampling::{BLOCK_CAMERA, BLOCK_LENS, pair, pixel_key, sample_key};
use crate::{Aovs, Tile};

/// Sums of AOVs over samples.
#[derive(Clone, Copy, Default)]
struct Sum {
    albedo: DVec3,
    normal: DVec3,
    inverse_depth: f64,
    emission: DVec3,
}

impl PathTracer<'_> {
    /// AOVs of each pixel of a tile: means over its samples.
    pub(super) fn aovs(&self, tile: Tile) -> Vec<Aovs> {
        let rows = tile.y..tile.y + tile.height;
        let pixels = rows.flat_map(|y| (tile.x..tile.x + tile.width).map(move |x| (x, y)));
        pixels.map(|(x, y)| self.pixel_aovs(x, y)).collect()
    }

    pub(super) fn pixel_aovs(&self, x: u32, y: u32) -> Aovs {
        let mut sum = Sum::default();
        for taken in 0..self.settings.samples {
            let sample = self.settings.first_sample.wrapping_add(taken);
            let (pixel, sample) = (pixel_key(x, y), sample_key(sample));
            let random = |block| pair(pixel, sample, block, self.settings.seed).map(f64::from);
            let [u, v] = random(BLOCK_CAMERA);
            let film = [f64::from(x) + u, f64::from(y) + v];
            self.add(&mut sum, &camera_ray(&self.frame, film, random(BLOCK_LENS)));
        }
        let share = 1.0 / f64::from(self.settings.samples);
        let mean = |sum: DVec3| (sum * share).as_vec3().to_array();
        Aovs {
            albedo: mean(sum.albedo),
            normal: mean(sum.normal),
            inverse_depth: (sum.inverse_depth * share) as f32,
            emission: mean(sum.emission),
        }
    }

    /// Adds the AOVs of one camera ray.
    fn add(&self, sum: &mut Sum, ray: &Ray) {
        let hit = intersect_from(self.scene, ray, None);
        let Some(hit) = hit.filter(|hit| !matches!(hit.primitive, Primitive::AreaLight(_))) else {
            sum.emission += self.emission(ray, hit.as_ref());
            return;
        };
        let vertex = Vertex::new(self.scene, ray, &hit, self.footprint_m(&hit, 0));
        let axis = vector(self.frame.dx)
            .cross(-vector(self.frame.dy))
            .normalize();
        sum.albedo += vertex.scatter.albedo();
        sum.normal += vertex.n;
        let beyond_near = hit.t * ray.direction.dot(-axis);
        sum.inverse_depth += 1.0 / (f64::from(self.frame.near_m) + beyond_near);
        // One mirror bounce is followed for the emission, so that reflections of lamps stay sharp.
        let mirror = vertex.scatter.mirror(vertex.wo, vertex.n);
        if mirror != DVec3::ZERO {
            let mirrored = Ray {
                origin: vertex.point,
                direction: vertex.scatter.mirrored(vertex.wo, vertex.n),
            };
            let left = RayOrigin {
                primitive: vertex.primitive,
                is_inside: false,
            };
            let met = intersect_from(self.scene, &mirrored, Some(left));
            sum.emission += mirror * self.emission(&mirrored, met.as_ref());
        }
    }

    /// Radiance of the area light or environment at which a ray ends; 0 at other surfaces.
    fn emission(&self, ray: &Ray, met: Option<&Hit>) -> DVec3 {
        match met.map(|hit| (hit, hit.primitive)) {
            None => environment_radiance(self.scene, ray.direction),
            Some((hit, Primitive::AreaLight(light))) if ray.direction.dot(hit.n) < 0.0 => {
                self.scene.area_lights[light as usize].radiance_at(hit.point)
            }
            Some(_) => DVec3::ZERO,
        }
    }
}
