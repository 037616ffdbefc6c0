//! Where a ray meets the scene.

use glam::DVec3;

use crate::CompiledScene;
use crate::compiled::{BoxData, DiscData, Primitive, SphereData};

/// A half-line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it begins, metres.
    pub origin: DVec3,
    /// Unit direction.
    pub direction: DVec3,
}

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance from the ray's origin, metres, above 0.
    pub t: f64,
    /// The point, on the surface to the rounding of f64.
    pub point: DVec3,
    /// Unit normal: out of a solid, along the normal of a plate or lamp, whichever side is met.
    pub n: DVec3,
    /// What was met.
    pub primitive: Primitive,
}

/// The nearest hit of all primitives, lamps among them; of equal distances the first in the order
/// spheres, boxes, discs, rectangles, lamps.
pub fn intersect(scene: &CompiledScene, ray: &Ray) -> Option<Hit> {
    intersect_from(scene, ray, None)
}

/// [`intersect`] for a ray that leaves the surface of `left`, which is skipped.
pub fn intersect_from(scene: &CompiledScene, ray: &Ray, left: Option<Primitive>) -> Option<Hit> {
    let mut nearest: Option<Hit> = None;
    let mut offer = |primitive, met: Option<(f64, DVec3)>| {
        let Some((t, n)) = met else { return };
        if t > 0.0 && nearest.is_none_or(|hit| t < hit.t) && left != Some(primitive) {
            let point = ray.origin + t * ray.direction;
            nearest = Some(Hit {
                t,
                point,
                n,
                primitive,
            });
        }
    };
    for (i, sphere) in (0..).zip(&scene.spheres) {
        offer(Primitive::Sphere(i), meet_sphere(sphere, ray));
    }
    for (i, slabs) in (0..).zip(&scene.boxes) {
        offer(Primitive::Box(i), meet_box(slabs, ray));
    }
    for (i, disc) in (0..).zip(&scene.discs) {
        offer(Primitive::Disc(i), meet_disc(disc, ray));
    }
    for (i, plate) in (0..).zip(&scene.rectangles) {
        let met = meet_rectangle(ray, plate.center, plate.half_u, plate.half_v);
        offer(Primitive::Rectangle(i), met);
    }
    for (i, lamp) in (0..).zip(&scene.lamps) {
        let met = meet_rectangle(ray, lamp.center, lamp.half_u, lamp.half_v);
        offer(Primitive::Lamp(i), met);
    }
    nearest.map(|hit| on_surface(scene, hit))
}

/// Puts a sphere's hit back on its surface: far from the ray's origin, `origin + t·direction`
/// alone misses it by more than small balls can bear.
fn on_surface(scene: &CompiledScene, hit: Hit) -> Hit {
    let Primitive::Sphere(i) = hit.primitive else {
        return hit;
    };
    let sphere = &scene.spheres[i as usize];
    Hit {
        point: vector(sphere.center) + f64::from(sphere.radius) * hit.n,
        ..hit
    }
}

/// Discriminant and normal from the ray's point nearest to the centre: right for balls seen from
/// ten thousand kilometres (Haines, Günther and Akenine-Möller, Ray Tracing Gems, chapter 7).
fn meet_sphere(sphere: &SphereData, ray: &Ray) -> Option<(f64, DVec3)> {
    let radius = f64::from(sphere.radius);
    let from_center = ray.origin - vector(sphere.center);
    let t_nearest = -from_center.dot(ray.direction);
    let nearest = from_center + t_nearest * ray.direction;
    let distance = nearest.length();
    if distance >= radius {
        return None;
    }
    let half_chord = ((radius - distance) * (radius + distance)).sqrt();
    let outside = t_nearest - half_chord > 0.0;
    let along = if outside { -half_chord } else { half_chord };
    let n = (nearest + along * ray.direction).normalize();
    Some((t_nearest + along, n))
}

/// Slabs; a ray within a face or through an edge hits. The far face counts from inside.
fn meet_box(slabs: &BoxData, ray: &Ray) -> Option<(f64, DVec3)> {
    let (min, max) = (vector(slabs.min), vector(slabs.max));
    let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
    let (mut near_axis, mut far_axis) = (0, 0);
    for axis in 0..3 {
        let (origin, direction) = (ray.origin[axis], ray.direction[axis]);
        if direction == 0.0 {
            if origin < min[axis] || origin > max[axis] {
                return None;
            }
            continue;
        }
        let (a, b) = (
            (min[axis] - origin) / direction,
            (max[axis] - origin) / direction,
        );
        if a.min(b) > near {
            (near, near_axis) = (a.min(b), axis);
        }
        if a.max(b) < far {
            (far, far_axis) = (a.max(b), axis);
        }
    }
    if near > far {
        return None;
    }
    let (t, axis, sign) = if near > 0.0 {
        (near, near_axis, -1.0)
    } else {
        (far, far_axis, 1.0)
    };
    Some((t, DVec3::AXES[axis] * ray.direction[axis].signum() * sign))
}

fn meet_disc(disc: &DiscData, ray: &Ray) -> Option<(f64, DVec3)> {
    let n = vector(disc.normal).normalize();
    let (t, offset) = meet_plane(ray, vector(disc.center), n)?;
    (offset.length() <= f64::from(disc.radius)).then_some((t, n))
}

fn meet_rectangle(
    ray: &Ray,
    center: [f32; 3],
    half_u: [f32; 3],
    half_v: [f32; 3],
) -> Option<(f64, DVec3)> {
    let (u, v) = (vector(half_u), vector(half_v));
    let n = u.cross(v).normalize();
    let (t, offset) = meet_plane(ray, vector(center), n)?;
    let inside = offset.dot(u).abs() <= u.dot(u) && offset.dot(v).abs() <= v.dot(v);
    inside.then_some((t, n))
}

/// Distance to a plane, and the point met relative to `center`.
fn meet_plane(ray: &Ray, center: DVec3, n: DVec3) -> Option<(f64, DVec3)> {
    let to_center = center - ray.origin;
    let cos = ray.direction.dot(n);
    if cos == 0.0 {
        return None;
    }
    let t = to_center.dot(n) / cos;
    Some((t, t * ray.direction - to_center))
}

/// An f32 triple in f64.
pub(super) fn vector(v: [f32; 3]) -> DVec3 {
    glam::Vec3::from_array(v).as_dvec3()
}
