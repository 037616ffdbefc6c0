//! Rays, and conversion of vectors to f64.

use glam::DVec3;

use crate::compiled::Primitive;

/// A ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Origin, metres.
    pub origin: DVec3,
    /// Unit direction.
    pub direction: DVec3,
}

/// Primitive on which a ray starts, or inside which it travels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayOrigin {
    /// The primitive that the ray leaves, or that encloses it.
    pub primitive: Primitive,
    /// Whether the ray travels inside the body.
    pub is_inside: bool,
}

/// Converts an f32 triple to a vector in f64.
pub(crate) fn vector(v: [f32; 3]) -> DVec3 {
    glam::Vec3::from_array(v).as_dvec3()
}
