//! GGX microfacet distribution: density of normals, shadowing and sampling of visible normals.

use std::f64::consts::PI;

use glam::DVec3;

use super::basis::basis;

/// Density of microfacet normals at `cos` to the surface normal, sr⁻¹.
pub fn ggx(alpha: f64, cos: f64) -> f64 {
    let alpha2 = alpha * alpha;
    let root = cos * cos * (alpha2 - 1.0) + 1.0;
    alpha2 / (PI * root * root)
}

/// Smith's `G1(cos) / cos` for a direction at `cos` to the normal. In this form no density divides by a
/// cosine, so that nothing overflows at grazing incidence.
pub fn visibility(alpha: f64, cos: f64) -> f64 {
    let alpha2 = alpha * alpha;
    2.0 / (cos + (alpha2 + (1.0 - alpha2) * cos * cos).sqrt())
}

/// Draws a microfacet normal visible from `wo`, with density `visibility(wo·n) · (wo·h) · ggx(h·n)`:
/// Heitz, "Sampling the GGX Distribution of Visible Normals", JCGT 7(4), 2018, by the spherical caps of
/// Dupuy and Benyoub (CGF 42(8), 2023), which need no basis around `wo`.
pub fn sample_visible(alpha: f64, wo: DVec3, n: DVec3, u1: f64, u2: f64) -> DVec3 {
    let (t, b) = basis(n);
    let stretched = DVec3::new(alpha * wo.dot(t), alpha * wo.dot(b), wo.dot(n)).normalize();
    // Uniform point on the cap of the unit sphere above −stretched.z: its sum with `stretched` is the
    // visible normal of the hemisphere.
    let z = (1.0 - u1) * (1.0 + stretched.z) - stretched.z;
    let sine = (1.0 - z * z).max(0.0).sqrt();
    let (sin_phi, cos_phi) = (2.0 * PI * u2).sin_cos();
    let cap = DVec3::new(sine * cos_phi, sine * sin_phi, z) + stretched;
    let h = DVec3::new(alpha * cap.x, alpha * cap.y, cap.z.max(0.0)).normalize();
    h.x * t + h.y * b + h.z * n
}
