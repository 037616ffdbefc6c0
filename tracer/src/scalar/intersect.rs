//! Intersection of rays with the scene, in f64.

use glam::DVec3;

use super::csg::intersect_csg_box;
pub(crate) use super::ray::vector;
pub use super::ray::{Ray, RayOrigin};
use super::triangle::{RayFrame, TriangleSurface, nearest_triangle};
use crate::CompiledScene;
use crate::compiled::{AreaLightData, BoxData, DiscData, Primitive, SphereData};

/// Hit of a ray on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance from the ray's origin, metres, above 0.
    pub t: f64,
    /// Point on the surface, accurate to the rounding of f64.
    pub point: DVec3,
    /// Unit normal: outward for a solid, along the normal of a disc, triangle or area light, whichever side
    /// is hit.
    pub n: DVec3,
    /// Shading normal of a triangle with vertex normals or a normal map, on the side of `n`; else `n`.
    pub shading_n: DVec3,
    /// Primitive that was hit.
    pub primitive: Primitive,
}

/// Nearest hit among all primitives including area lights; at equal distances the first in the order
/// spheres, boxes, discs, rectangles, CSG boxes, triangles, area lights.
pub fn intersect(scene: &CompiledScene, ray: &Ray) -> Option<Hit> {
    intersect_from(scene, ray, None)
}

/// [`intersect`] for a ray that starts on or in a primitive: one that it leaves outwards is skipped; of a
/// sphere or box that it is inside of it hits the far side, wherever rounding has put its origin; inside a
/// mesh it hits any triangle.
pub fn intersect_from(scene: &CompiledScene, ray: &Ray, start: Option<RayOrigin>) -> Option<Hit> {
    let skipped = start
        .filter(|start| !start.is_inside)
        .map(|start| start.primitive);
    let enclosing = start
        .filter(|start| start.is_inside)
        .map(|start| start.primitive);
    let mut nearest: Option<Hit> = None;
    let offer = |nearest: &mut Option<Hit>, primitive, met: Option<(f64, DVec3)>| {
        let Some((t, n)) = met else { return };
        let is_ahead = t > 0.0 || enclosing == Some(primitive);
        if is_ahead && nearest.is_none_or(|hit| t < hit.t) && skipped != Some(primitive) {
            let point = ray.origin + t * ray.direction;
            *nearest = Some(Hit {
                t,
                point,
                n,
                shading_n: n,
                primitive,
            });
        }
    };
    for (i, sphere) in (0..).zip(&scene.spheres) {
        let primitive = Primitive::Sphere(i);
        let met = if enclosing == Some(primitive) {
            Some(exit_sphere(sphere, ray))
        } else {
            intersect_sphere(sphere, ray)
        };
        offer(&mut nearest, primitive, met);
    }
    for (i, slabs) in (0..).zip(&scene.boxes) {
        let primitive = Primitive::Box(i);
        let met = if enclosing == Some(primitive) {
            Some(exit_box(slabs, ray))
        } else {
            intersect_box(slabs, ray)
        };
        offer(&mut nearest, primitive, met);
    }
    for (i, disc) in (0..).zip(&scene.discs) {
        offer(&mut nearest, Primitive::Disc(i), intersect_disc(disc, ray));
    }
    for (i, plate) in (0..).zip(&scene.rectangles) {
        let met = intersect_rectangle(ray, plate.center, plate.half_u, plate.half_v);
        offer(&mut nearest, Primitive::Rectangle(i), met);
    }
    if let Some(hit) = nearest_csg_face(scene, ray, skipped, nearest) {
        nearest = Some(hit);
    }
    if let Some((t, index)) = nearest_triangle(scene, ray, start, nearest.map(|hit| hit.t)) {
        // Point and normals are computed once the triangle is known to be the nearest hit.
        offer(
            &mut nearest,
            Primitive::Triangle(index),
            Some((t, DVec3::Z)),
        );
    }
    for (i, light) in (0..).zip(&scene.area_lights) {
        let met = intersect_area_light(ray, light);
        offer(&mut nearest, Primitive::AreaLight(i), met);
    }
    nearest.map(|hit| on_surface(scene, ray, hit))
}

/// Nearest hit on a face of a CSG box ahead of the ray, if it is nearer than `nearest`.
fn nearest_csg_face(
    scene: &CompiledScene,
    ray: &Ray,
    skipped: Option<Primitive>,
    mut nearest: Option<Hit>,
) -> Option<Hit> {
    let mut found = None;
    for csg_box in &scene.csg_boxes {
        let own = csg_box.first_face..csg_box.first_face + csg_box.face_count;
        let is_left = matches!(skipped, Some(Primitive::CsgFace(face)) if own.contains(&face));
        if let Some((t, n, face)) = intersect_csg_box(scene, csg_box, ray, is_left) {
            let is_nearest = nearest.is_none_or(|hit| t < hit.t);
            if t > 0.0 && is_nearest {
                nearest = Some(Hit {
                    t,
                    point: ray.origin + t * ray.direction,
                    n,
                    shading_n: n,
                    primitive: Primitive::CsgFace(face),
                });
                found = nearest;
            }
        }
    }
    found
}

/// Index and distance of the nearest area light along a ray, ignoring occluders.
pub(super) fn nearest_area_light(scene: &CompiledScene, ray: &Ray) -> Option<(usize, f64)> {
    let met = scene
        .area_lights
        .iter()
        .enumerate()
        .filter_map(|(index, light)| {
            let (t, _) = intersect_area_light(ray, light)?;
            (t > 0.0).then_some((index, t))
        });
    met.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Moves a sphere's or triangle's hit back onto its surface: for distant origins `origin + t·direction`
/// misses small balls by more than their shading tolerates.
fn on_surface(scene: &CompiledScene, ray: &Ray, hit: Hit) -> Hit {
    match hit.primitive {
        Primitive::Sphere(i) => {
            let sphere = &scene.spheres[i as usize];
            Hit {
                point: vector(sphere.center) + f64::from(sphere.radius) * hit.n,
                ..hit
            }
        }
        Primitive::Triangle(i) => {
            let met = RayFrame::new(ray).intersect(&scene.meshes.triangles[i as usize]);
            let surface = met.map(|met| TriangleSurface::new(scene, i, met.barycentric));
            surface.map_or(hit, |surface| Hit {
                point: surface.point,
                n: surface.n,
                shading_n: surface.shading_n,
                ..hit
            })
        }
        _ => hit,
    }
}

/// Discriminant and normal are computed from the ray's point nearest to the centre, which is accurate for
/// balls seen from 10,000 km (Haines, Günther and Akenine-Möller, Ray Tracing Gems, chapter 7).
fn intersect_sphere(sphere: &SphereData, ray: &Ray) -> Option<(f64, DVec3)> {
    let radius = f64::from(sphere.radius);
    let from_center = ray.origin - vector(sphere.center);
    let t_nearest = -from_center.dot(ray.direction);
    let nearest = from_center + t_nearest * ray.direction;
    let distance = nearest.length();
    if distance >= radius {
        return None;
    }
    // r² − d², factored: the difference of squares would cancel near the silhouette.
    let half_chord = ((radius - distance) * (radius + distance)).sqrt();
    let outside = t_nearest - half_chord > 0.0;
    let along = if outside { -half_chord } else { half_chord };
    let n = (nearest + along * ray.direction).normalize();
    Some((t_nearest + along, n))
}

/// Far side of a sphere, from inside; at distance 0 if rounding has put the origin outside.
fn exit_sphere(sphere: &SphereData, ray: &Ray) -> (f64, DVec3) {
    let radius = f64::from(sphere.radius);
    let from_center = ray.origin - vector(sphere.center);
    let t_nearest = -from_center.dot(ray.direction);
    let nearest = from_center + t_nearest * ray.direction;
    let distance = nearest.length();
    // A grazing ray that rounding has put outside leaves at the point nearest to the centre.
    let half_chord = ((radius - distance) * (radius + distance)).max(0.0).sqrt();
    let n = (nearest + half_chord * ray.direction).normalize();
    ((t_nearest + half_chord).max(0.0), n)
}

/// Face through which a ray leaves a box; at distance 0 if rounding has put the origin outside.
fn exit_box(slabs: &BoxData, ray: &Ray) -> (f64, DVec3) {
    let (min, max) = (vector(slabs.min), vector(slabs.max));
    let (mut far, mut n) = (f64::INFINITY, DVec3::Z);
    for axis in 0..3 {
        let direction = ray.direction[axis];
        if direction == 0.0 {
            continue;
        }
        // By the sign of the direction alone, as only exits are sought, on whichever side of the plane
        // rounding has put the origin.
        let face = if direction > 0.0 { max } else { min }[axis];
        let t = (face - ray.origin[axis]) / direction;
        if t < far {
            (far, n) = (t, DVec3::AXES[axis] * direction.signum());
        }
    }
    (far.max(0.0), n)
}

/// Slab test; a ray within a face or through an edge hits. From inside the far face is hit.
fn intersect_box(slabs: &BoxData, ray: &Ray) -> Option<(f64, DVec3)> {
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
    // A zero or NaN direction leaves the far side unbounded.
    if near > far || far.is_infinite() {
        return None;
    }
    let (t, axis, sign) = if near > 0.0 {
        (near, near_axis, -1.0)
    } else {
        (far, far_axis, 1.0)
    };
    Some((t, DVec3::AXES[axis] * ray.direction[axis].signum() * sign))
}

fn intersect_disc(disc: &DiscData, ray: &Ray) -> Option<(f64, DVec3)> {
    let n = vector(disc.normal).normalize();
    let (t, offset) = intersect_plane(ray, vector(disc.center), n)?;
    (offset.length() <= f64::from(disc.radius)).then_some((t, n))
}

fn intersect_area_light(ray: &Ray, light: &AreaLightData) -> Option<(f64, DVec3)> {
    let [half_u, half_v] = light.half_edges();
    intersect_rectangle(ray, light.center, half_u, half_v)
}

fn intersect_rectangle(
    ray: &Ray,
    center: [f32; 3],
    half_u: [f32; 3],
    half_v: [f32; 3],
) -> Option<(f64, DVec3)> {
    let (u, v) = (vector(half_u), vector(half_v));
    let n = u.cross(v).normalize();
    let (t, offset) = intersect_plane(ray, vector(center), n)?;
    let inside = offset.dot(u).abs() <= u.dot(u) && offset.dot(v).abs() <= v.dot(v);
    inside.then_some((t, n))
}

/// Distance to a plane, and the intersection relative to `center`.
fn intersect_plane(ray: &Ray, center: DVec3, n: DVec3) -> Option<(f64, DVec3)> {
    let to_center = center - ray.origin;
    let cos = ray.direction.dot(n);
    if cos == 0.0 {
        return None;
    }
    let t = to_center.dot(n) / cos;
    Some((t, t * ray.direction - to_center))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray {
            origin: DVec3::from_array(origin),
            direction: DVec3::from_array(direction).normalize(),
        }
    }

    fn unit_ball(center: [f32; 3]) -> SphereData {
        SphereData {
            center,
            radius: 1.0,
            stripe_axis: [0.0, 0.0, 1.0],
            material: 0,
            number_axis: [1.0, 0.0, 0.0],
            allows_refracted_nee: 0,
        }
    }

    const CUBE: BoxData = BoxData {
        min: [-1.0; 3],
        material: 0,
        max: [1.0; 3],
        padding: 0,
    };

    #[test]
    fn pool_ball_is_hit_from_10_000_km() {
        for distance in [1.0, 1e3, 1e5, 1e7] {
            let ball = SphereData {
                radius: 0.028_575,
                ..unit_ball([distance as f32, 0.0, 0.0])
            };
            let radius = f64::from(ball.radius);
            for impact in [0.0, 0.5, 0.99, 1.01] {
                let ray = ray([0.0, impact * radius, 0.0], [1.0, 0.0, 0.0]);
                let met = intersect_sphere(&ball, &ray);
                assert_eq!(met.is_some(), impact < 1.0, "{distance} {impact}");
                let Some((t, n)) = met else { continue };
                let depth = (1.0 - impact * impact).sqrt();
                assert!((t - (distance - radius * depth)).abs() < 1e-15 * distance + 1e-12);
                assert!((n - DVec3::new(-depth, impact, 0.0)).length() < 1e-8, "{n}");
            }
        }
    }

    #[test]
    fn ball_is_hit_from_inside_not_from_behind() {
        let ball = unit_ball([0.0; 3]);
        let (t, n) = intersect_sphere(&ball, &ray([0.0; 3], [0.0, 0.0, 1.0])).unwrap();
        assert_eq!((t, n), (1.0, DVec3::Z));
        let (t, n) = intersect_sphere(&ball, &ray([0.5, 0.0, 0.0], [1.0, 0.0, 0.0])).unwrap();
        assert_eq!((t, n), (0.5, DVec3::X));
        let (t, _) = intersect_sphere(&ball, &ray([2.0, 0.0, 0.0], [1.0, 0.0, 0.0])).unwrap();
        assert!(t < 0.0);
        let hidden = SphereData {
            radius: 0.0,
            ..ball
        };
        assert_eq!(
            intersect_sphere(&hidden, &ray([0.0; 3], [1.0, 0.0, 0.0])),
            None
        );
    }

    #[test]
    fn box_is_hit_on_faces_edges_and_from_inside() {
        let met = |origin, direction| intersect_box(&CUBE, &ray(origin, direction));
        let to_x = [1.0, 0.0, 0.0];
        assert_eq!(met([-3.0, 0.5, 0.5], to_x), Some((2.0, DVec3::NEG_X)));
        assert_eq!(
            met([-3.0, 0.5, 0.5], [1.0, -0.0, -0.0]),
            Some((2.0, DVec3::NEG_X))
        );
        assert_eq!(met([0.0; 3], to_x), Some((1.0, DVec3::X)));
        assert_eq!(met([0.0; 3], [-1.0, 0.0, 0.0]), Some((1.0, DVec3::NEG_X)));
        // Along a face and along an edge: the box is closed, so both hit.
        assert_eq!(met([-3.0, 1.0, 0.0], to_x), Some((2.0, DVec3::NEG_X)));
        assert_eq!(met([-3.0, 1.0, -1.0], to_x), Some((2.0, DVec3::NEG_X)));
        assert_eq!(met([-3.0, 1.0 + 1e-9, 0.0], to_x), None);
        assert_eq!(met([-3.0, 2.0, 0.0], [1.0, 1.0, 0.0]), None);
    }

    #[test]
    fn plates_end_at_their_edges() {
        let disc = DiscData {
            center: [0.0; 3],
            radius: 1.0,
            normal: [0.0, 0.0, 1.0],
            material: 0,
        };
        let down = |x| ray([x, 0.0, 2.0], [0.0, 0.0, -1.0]);
        assert_eq!(intersect_disc(&disc, &down(0.999)), Some((2.0, DVec3::Z)));
        assert_eq!(intersect_disc(&disc, &down(1.001)), None);
        assert_eq!(
            intersect_disc(&disc, &ray([-2.0, 0.0, 0.0], [1.0, 0.0, 0.0])),
            None
        );
        let plate = |ray| intersect_rectangle(&ray, [0.0; 3], [0.5, 0.0, 0.0], [0.0, 2.0, 0.0]);
        assert_eq!(plate(down(0.499)), Some((2.0, DVec3::Z)));
        assert_eq!(plate(down(0.501)), None);
    }

    #[test]
    fn numbers_that_are_none_miss() {
        let directions = [[f64::NAN, 0.0, 1.0], [0.0; 3], [f64::INFINITY, 0.0, 0.0]];
        for bad in directions.map(|direction| ray([0.0, 0.0, -5.0], direction)) {
            let t = |met: Option<(f64, DVec3)>| met.is_some_and(|(t, _)| t > 0.0);
            assert!(!t(intersect_sphere(&unit_ball([0.0; 3]), &bad)), "{bad:?}");
            assert!(!t(intersect_box(&CUBE, &bad)), "{bad:?}");
        }
    }
}
