//! Light sampling of points on emissive surfaces; [`crate::compiled::EmissiveSurfaces`] defines the choice
//! of surface.
//!
//! A sphere whose centre is at a distance `d` subtends the solid angle `2π(1 − cos θ)`, `sin θ = r / d`, in
//! which directions are drawn uniformly. Divided by its area that is `1 / (2(d² + d·√(d² − r²)))`, which
//! takes the place of the `cos / t²` of flat surfaces at a distance `t`. From within, spheres are found by
//! BSDF sampling alone.

use std::f64::consts::TAU;

use glam::DVec3;

use super::basis::basis;
use super::intersect::vector;
use crate::CompiledScene;
use crate::compiled::{MaterialData, Primitive, ShapeKind, SphereData};
use crate::sampling::BELOW_1;

/// A sampled point on an emissive surface.
pub struct EmissiveSurfaceSample {
    /// Direction to it.
    pub direction: EmissiveDirection,
    /// Density per solid angle for MIS, equal to [`emissive_surface_density`] at the point.
    pub density: f64,
    /// Reciprocal of the density per solid angle with which it was drawn, sr.
    pub inverse_pdf: f64,
    /// Emitted radiance, W·sr⁻¹·m⁻².
    pub emission: DVec3,
}

/// A direction to a point on an emissive surface.
#[derive(Clone, Copy, Debug)]
pub struct EmissiveDirection {
    /// Unit vector.
    pub wi: DVec3,
    /// Distance of the surface, metres.
    pub distance: f64,
    /// Solid angle per area, sr·m⁻².
    pub angle_per_area: f64,
}

/// Draws a point as seen from `point`, by two numbers in [0, 1]; `None` where no light would arrive.
pub fn sample_emissive_surface(
    scene: &CompiledScene,
    point: DVec3,
    [u, v]: [f64; 2],
) -> Option<EmissiveSurfaceSample> {
    let lights = &scene.emissive_surfaces;
    let u = u.min(BELOW_1) as f32;
    let surface = &lights.surfaces[lights.sample_index(u)];
    // Within the interval of the chosen surface the number is rescaled to be uniform again.
    let within = f64::from((u - surface.before) / surface.probability).clamp(0.0, 1.0);
    let mut weights = [1.0, 0.0, 0.0];
    let (direction, unit_area) = if surface.kind() == ShapeKind::Sphere {
        let sphere = &scene.spheres[surface.index as usize];
        let direction = direction_to_sphere(sphere, point, [within, v])?;
        (direction, f64::from(sphere.radius).powi(2))
    } else {
        weights = corner_weights(surface.kind(), [within, v]);
        let corners = scene
            .emissive_corners(surface)
            .map(|corner| corner.as_dvec3());
        direction_to_flat(corners, weights, point)?
    };
    let area = surface.kind().area_factor()? * unit_area;
    // 1/pdf = area · (solid angle per area) / P(surface).
    let probability = f64::from(surface.probability) * f64::from(lights.probability());
    let material = scene.material_of(surface.primitive())?;
    Some(EmissiveSurfaceSample {
        density: point_density(scene, material) / direction.angle_per_area,
        inverse_pdf: area * direction.angle_per_area / probability,
        emission: scene
            .emission_at(surface, weights.map(|weight| weight as f32))
            .as_dvec3(),
        direction,
    })
}

/// Density per solid angle with which light sampling draws a direction from `origin` to a primitive at
/// `distance`, where `cosine` is that between direction and normal; 0 for primitives that it does not
/// sample.
pub fn emissive_surface_density(
    scene: &CompiledScene,
    primitive: Primitive,
    origin: DVec3,
    distance: f64,
    cosine: f64,
) -> f64 {
    let material = scene.material_of(primitive);
    let per_area = material.map_or(0.0, |material| point_density(scene, material));
    let area_per_angle = match primitive {
        Primitive::Sphere(index) => {
            let sphere = &scene.spheres[index as usize];
            let squared = (vector(sphere.center) - origin).length_squared();
            angle_per_area_of_sphere(sphere, squared).map_or(0.0, f64::recip)
        }
        Primitive::Disc(_) | Primitive::Rectangle(_) | Primitive::Triangle(_) => {
            distance * distance / cosine
        }
        Primitive::Box(_) | Primitive::CsgFace(_) | Primitive::AreaLight(_) => 0.0,
    };
    match per_area > 0.0 {
        true => per_area * area_per_angle,
        false => 0.0,
    }
}

/// Density by area with which light sampling draws points on surfaces of a material, m⁻².
fn point_density(scene: &CompiledScene, material: &MaterialData) -> f64 {
    f64::from(material.sampling_density) * f64::from(scene.emissive_surfaces.probability())
}

/// Weights of [`CompiledScene::emissive_corners`] for a point uniform in the area of a flat shape.
fn corner_weights(shape: ShapeKind, [u, v]: [f64; 2]) -> [f64; 3] {
    // A fraction r of the way from the first corner, or from the centre, bounds the fraction r² of the
    // area, hence the square root.
    let root = u.sqrt();
    let [b, c] = match shape {
        ShapeKind::Triangle => [root * (1.0 - v), root * v],
        ShapeKind::Disc => [root * (TAU * v).cos(), root * (TAU * v).sin()],
        _ => [u, v],
    };
    [1.0 - b - c, b, c]
}

/// Direction to the point of a flat shape with these corner weights, and the area of the corners'
/// parallelogram; `None` if it is seen edge-on.
fn direction_to_flat(
    [a, b, c]: [DVec3; 3],
    [wa, wb, wc]: [f64; 3],
    point: DVec3,
) -> Option<(EmissiveDirection, f64)> {
    let across = (b - a).cross(c - a);
    let parallelogram = across.length();
    let to_light = wa * a + wb * b + wc * c - point;
    let distance = to_light.length();
    let wi = to_light / distance;
    let cosine = (wi.dot(across) / parallelogram).abs();
    let direction = EmissiveDirection {
        wi,
        distance,
        angle_per_area: cosine / (distance * distance),
    };
    // Written so that degenerate triangles (NaN) and points in the triangle's own plane are rejected.
    let is_seen = cosine > 0.0 && distance > 0.0;
    is_seen.then_some((direction, parallelogram))
}

/// Direction uniform in the solid angle of a sphere; `None` from within.
fn direction_to_sphere(
    sphere: &SphereData,
    point: DVec3,
    [u, v]: [f64; 2],
) -> Option<EmissiveDirection> {
    let to_center = vector(sphere.center) - point;
    let squared = to_center.length_squared();
    let angle_per_area = angle_per_area_of_sphere(sphere, squared)?;
    let (distance, radius) = (squared.sqrt(), f64::from(sphere.radius));
    // 1 − cos θ of the direction. Kept in this form, as 1 − cos θ of a small angle would cancel.
    let within = u * 2.0 * radius * radius * angle_per_area;
    let sine_squared = within * (2.0 - within);
    let axis = to_center / distance;
    let (t, b) = basis(axis);
    let (sin, cos) = (TAU * v).sin_cos();
    // The nearer intersection is at d·cos θ less half the chord, whose square is r² − d² sin² θ.
    let half_chord = (radius * radius - squared * sine_squared).max(0.0).sqrt();
    Some(EmissiveDirection {
        wi: (1.0 - within) * axis + sine_squared.sqrt() * (cos * t + sin * b),
        distance: distance * (1.0 - within) - half_chord,
        angle_per_area,
    })
}

/// Solid angle per area of a sphere, sr·m⁻², from a point at the square root of `squared` from its centre;
/// `None` from within.
fn angle_per_area_of_sphere(sphere: &SphereData, squared: f64) -> Option<f64> {
    let beyond = squared - f64::from(sphere.radius).powi(2);
    (beyond > 0.0).then(|| 0.5 / (squared + (squared * beyond).sqrt()))
}
