//! The sheen of napped cloth: fibres that stand up, seen against the light.
//!
//! The distribution is that of Estevez and Kulla, "Production Friendly Microfacet Sheen BRDF"
//! (SIGGRAPH 2017 course "Physically Based Shading"), equation 2; the shadowing that of Neubelt and
//! Pettineo, "Crafting a Next-Gen Material Pipeline for The Order: 1886" (SIGGRAPH 2013 course).

use std::f64::consts::PI;

use glam::DVec3;

/// The sheen's `f` times 2π for strength 1, from the cosines of both directions and of the
/// half vector to the normal, all above 0.
pub fn sheen(roughness: f64, cos_o: f64, cos_i: f64, cos_h: f64) -> f64 {
    let exponent = 1.0 / roughness;
    let sine2 = (1.0 - cos_h * cos_h).max(0.0);
    let distribution = (2.0 + exponent) * sine2.powf(0.5 * exponent);
    distribution / (4.0 * (cos_o + cos_i - cos_o * cos_i))
}

/// The most of the light from any direction that a sheen of strength 1 reflects, with 1 % to spare.
pub fn sheen_reflectance_max(roughness: f64) -> f64 {
    const STEPS: usize = 64;
    let midpoint = |i: usize, steps: usize| (i as f64 + 0.5) / steps as f64;
    let reflectance = |cos_o: f64| {
        let wo = DVec3::new((1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o);
        let mut sum = 0.0;
        for place in 0..STEPS * STEPS {
            let (cos_i, phi) = (
                midpoint(place / STEPS, STEPS),
                PI * midpoint(place % STEPS, STEPS),
            );
            let sine = (1.0 - cos_i * cos_i).sqrt();
            let wi = DVec3::new(sine * phi.cos(), sine * phi.sin(), cos_i);
            sum += sheen(roughness, cos_o, cos_i, (wo + wi).normalize().z) * cos_i;
        }
        sum / (STEPS * STEPS) as f64
    };
    let most = (0..STEPS).map(|i| reflectance(midpoint(i, STEPS).powi(2)));
    1.01 * most.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sheen_is_reciprocal_and_peaks_at_grazing() {
        for roughness in [0.1, 0.3, 1.0] {
            assert_eq!(
                sheen(roughness, 0.3, 0.8, 0.9),
                sheen(roughness, 0.8, 0.3, 0.9)
            );
            assert!(sheen(roughness, 0.1, 0.1, 0.1) > sheen(roughness, 1.0, 1.0, 1.0));
        }
    }

    #[test]
    fn sheen_reflectance_bound_is_plausible() {
        for roughness in [0.2, 0.3, 0.5, 1.0] {
            let most = sheen_reflectance_max(roughness);
            assert!((0.05..1.3).contains(&most), "{roughness}: {most}");
        }
    }
}
