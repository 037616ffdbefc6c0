//! Rays, and vectors in f64.

use glam::DVec3;

use crate::compiled::Primitive;

/// A half-line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it begins, metres.
    pub origin: DVec3,
    /// Unit direction.
    pub direction: DVec3,
}

/// Where a ray begins, other than in the open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayOrigin {
    /// The primitive whose surface the ray leaves, or whose inside it crosses.
    pub primitive: Primitive,
    /// The ray goes through the inside.
    pub is_inside: bool,
}

/// An f32 triple in f64.
pub(crate) fn vector(v: [f32; 3]) -> DVec3 {
    glam::Vec3::from_array(v).as_dvec3()
}
