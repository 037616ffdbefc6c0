//! Fresnel reflectance of smooth surfaces, for one direction and for diffuse light.

//!
//! Directions are on the side of index 1; seen from inside a body of index η, the relative index is
//! 1/η.

use glam::DVec3;

/// Unpolarised Fresnel reflectance of a smooth dielectric of relative index `eta`, for an angle of
/// cosine `cos_theta` to the normal; 1 for total internal reflection (possible if `eta` < 1).
pub fn fresnel_dielectric(cos_theta: f64, eta: f64) -> f64 {
    let cos_i = cos_theta.clamp(0.0, 1.0);
    if eta < 1.0 && (eta - 1.0) * (eta + 1.0) + cos_i * cos_i <= 0.0 {
        return 1.0;
    }
    // η²cos²θt = (η²−1) + cos²θi, factored so that an index of 1 reflects exactly nothing.
    let cos_t = ((eta - 1.0) * (eta + 1.0) + cos_i * cos_i).max(0.0).sqrt() / eta;
    let parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    let perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    if cos_i == 0.0 && cos_t == 0.0 {
        return 0.0; // an index of 1 at grazing incidence: there is no surface
    }
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// Unpolarised Fresnel reflectance, per channel, of a metal of complex index `eta + i·k` (Born and
/// Wolf, "Principles of Optics", section 14.2).
pub fn fresnel_conductor(cos_theta: f64, eta: DVec3, k: DVec3) -> DVec3 {
    let cos2 = cos_theta.clamp(0.0, 1.0).powi(2);
    let sin2 = 1.0 - cos2;
    let difference = eta * eta - k * k - sin2;
    let sum = (difference * difference + 4.0 * eta * eta * k * k).map(f64::sqrt);
    let a = (0.5 * (sum + difference)).max(DVec3::ZERO).map(f64::sqrt);
    let (even, odd) = (sum + cos2, 2.0 * cos2.sqrt() * a);
    let perpendicular = (even - odd) / (even + odd);
    // Rp = Rs · (cos²θ(a²+b²) + sin⁴θ − 2a cosθ sin²θ) / (… + …), where `sum` is a²+b².
    let (even, odd) = (cos2 * sum + sin2 * sin2, odd * sin2);
    0.5 * perpendicular * (1.0 + (even - odd) / (even + odd))
}

/// The fraction of diffuse light from inside that a smooth dielectric of index `eta` ≥ 1 reflects
/// back: `1 − F_dr,int = (1 − F_dr,ext) / η²` by reciprocity (d'Eon, "A Hitchhiker's Guide to
/// Multiple Scattering", 2016), with a midpoint rule for `F_dr,ext = ∫ F(c) 2c dc`.
pub fn internal_diffuse_reflectance(eta: f64) -> f64 {
    const STEPS: u32 = 4096;
    let external: f64 = (0..STEPS)
        .map(|i| (f64::from(i) + 0.5) / f64::from(STEPS))
        .map(|cos_theta| fresnel_dielectric(cos_theta, eta) * 2.0 * cos_theta / f64::from(STEPS))
        .sum();
    1.0 - (1.0 - external) / (eta * eta)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fresnel_has_its_known_values() {
        assert!((fresnel_dielectric(1.0, 1.5) - 0.04).abs() < 1e-15);
        assert_eq!(fresnel_dielectric(0.0, 1.5), 1.0);
        // At Brewster's angle only perpendicular light is reflected: ((η²−1)/(η²+1))² / 2.
        let brewster = 1.5f64.atan().cos();
        let expected = (1.25f64 / 3.25).powi(2) / 2.0;
        assert!((fresnel_dielectric(brewster, 1.5) - expected).abs() < 1e-12);
        for step in 0..=1000 {
            let cos = f64::from(step) / 1000.0;
            assert_eq!(fresnel_dielectric(cos, 1.0), 0.0, "an index of 1 at {cos}");
            for eta in [1.0 + 1e-6, 1.3, 1000.0] {
                assert!(
                    (0.0..=1.0).contains(&fresnel_dielectric(cos, eta)),
                    "{cos} {eta}"
                );
            }
        }
    }

    #[test]
    fn fresnel_inside_equals_outside_or_is_total() {
        for step in 0..=1000 {
            let inside = f64::from(step) / 1000.0;
            let sine2_outside = 2.25 * (1.0 - inside * inside);
            let expected = if sine2_outside >= 1.0 {
                1.0
            } else {
                fresnel_dielectric((1.0 - sine2_outside).sqrt(), 1.5)
            };
            assert!((fresnel_dielectric(inside, 1.0 / 1.5) - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn metal_without_absorption_is_a_dielectric() {
        let gold = (
            DVec3::new(0.143, 0.375, 1.442),
            DVec3::new(3.983, 2.386, 1.603),
        );
        for step in 0..=1000 {
            let cos = f64::from(step) / 1000.0;
            let clear = fresnel_conductor(cos, DVec3::splat(1.5), DVec3::ZERO);
            assert!(
                (clear.x - fresnel_dielectric(cos, 1.5)).abs() < 1e-12,
                "{cos}"
            );
            let f = fresnel_conductor(cos, gold.0, gold.1);
            assert!(f.min_element() >= 0.0 && f.max_element() <= 1.0 + 1e-12);
        }
        // ((η−1)² + k²) / ((η+1)² + k²) at normal incidence.
        let normal = fresnel_conductor(1.0, gold.0, gold.1);
        let k2 = gold.1 * gold.1;
        let expected =
            ((gold.0 - 1.0) * (gold.0 - 1.0) + k2) / ((gold.0 + 1.0) * (gold.0 + 1.0) + k2);
        assert!((normal - expected).length() < 1e-12);
        assert!((fresnel_conductor(0.0, gold.0, gold.1) - DVec3::ONE).length() < 1e-12);
    }

    #[test]
    fn internal_reflectance_has_its_known_values() {
        assert_eq!(internal_diffuse_reflectance(1.0), 0.0);
        assert!((internal_diffuse_reflectance(1.5) - 0.596_346).abs() < 1e-6);
    }

    /// Compared with the definition, an integral over directions inside.
    #[test]
    fn internal_reflectance_is_the_integral_from_inside() {
        for eta in [1.1f64, 1.33, 1.5, 2.4] {
            let inside = |cos: f64| {
                let sine2_outside = eta * eta * (1.0 - cos * cos);
                if sine2_outside >= 1.0 {
                    return 1.0;
                }
                fresnel_dielectric((1.0 - sine2_outside).sqrt(), eta)
            };
            let cosines = (0..200_000).map(|i| (f64::from(i) + 0.5) / 2e5);
            let integral = cosines
                .map(|cos| inside(cos) * 2.0 * cos / 2e5)
                .sum::<f64>();
            let difference = (integral - internal_diffuse_reflectance(eta)).abs();
            assert!(difference < 1e-5, "{eta}: {integral}, off by {difference}");
        }
    }
}
