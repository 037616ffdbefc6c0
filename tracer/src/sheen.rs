//! The sheen of napped cloth: retroreflective and grazing scattering by upright fibres.
//!
//! The distribution is equation 2 of Estevez and Kulla, "Production Friendly Microfacet Sheen BRDF"
//! (SIGGRAPH 2017 course "Physically Based Shading"); the shadowing term is that of Neubelt and
//! Pettineo, "Crafting a Next-Gen Material Pipeline for The Order: 1886" (SIGGRAPH 2013 course).

use std::f64::consts::PI;

use glam::DVec3;

/// 2π times the sheen's BRDF for a strength of 1, from the cosines of both directions and of the
/// half vector to the normal, all above 0.
pub fn sheen(roughness: f64, cos_o: f64, cos_i: f64, cos_h: f64) -> f64 {
    let exponent = 1.0 / roughness;
    let sine2 = (1.0 - cos_h * cos_h).max(0.0);
    let distribution = (2.0 + exponent) * sine2.powf(0.5 * exponent);
    distribution / (4.0 * (cos_o + cos_i - cos_o * cos_i))
}

/// Upper bound on the directional reflectance of a sheen of strength 1, over all directions, with a
/// margin of 1 %.
pub fn sheen_reflectance_max(roughness: f64) -> f64 {
    // Squaring concentrates the evaluated cosines near 0, at grazing angles, where reflectance is
    // highest.
    let most = (0..STEPS).map(|i| reflectance(roughness, midpoint(i).powi(2)));
    1.01 * most.fold(0.0, f64::max)
}

/// Approximate directional reflectance of a sheen of strength 1 and a width in [0.1, 1], at cosines
/// whose square roots are 0, 1/5, … 1. Values in between are interpolated linearly in the root (see
/// [`interpolated`]) and are never below the true reflectance. Values exceed 1 at grazing angles
/// for widths below 0.2.
pub fn sheen_reflectances(roughness: f64) -> [f64; 6] {
    let last = SHEEN_REFLECTANCES.len() - 1;
    let narrowest = f64::from(SHEEN_ROOT_MIN);
    let place = (roughness.sqrt() - narrowest) / (1.0 - narrowest) * last as f64;
    let place = place.clamp(0.0, last as f64);
    let row = (place as usize).min(last - 1);
    let share = place - row as f64;
    let [narrower, wider] = [row, row + 1].map(|row| SHEEN_REFLECTANCES[row].map(f64::from));
    std::array::from_fn(|node| narrower[node] + share * (wider[node] - narrower[node]))
}

/// Table of [`sheen_reflectances`]: one row per width, whose square roots are evenly spaced from
/// [`SHEEN_ROOT_MIN`] to 1. Computed with the midpoint rule, raised until no linear interpolation
/// is below the true reflectance, and by a further 1 %.
pub const SHEEN_REFLECTANCES: [[f32; 6]; 9] = [
    [1.4111, 1.0907, 0.6150, 0.2778, 0.0751, 0.0023],
    [1.1502, 0.9270, 0.5832, 0.3146, 0.1181, 0.0116],
    [0.9888, 0.8189, 0.5526, 0.3317, 0.1527, 0.0286],
    [0.8813, 0.7436, 0.5266, 0.3400, 0.1792, 0.0499],
    [0.8060, 0.6892, 0.5052, 0.3439, 0.1993, 0.0722],
    [0.7512, 0.6487, 0.4877, 0.3455, 0.2147, 0.0933],
    [0.7102, 0.6179, 0.4736, 0.3459, 0.2267, 0.1122],
    [0.6786, 0.5939, 0.4621, 0.3456, 0.2363, 0.1290],
    [0.6539, 0.5749, 0.4527, 0.3451, 0.2441, 0.1436],
];

/// Square root of the smallest width of a sheen, 0.1.
pub const SHEEN_ROOT_MIN: f32 = 0.316_227_77;

/// Linear interpolation in √cos between values at six cosines whose square roots are 0, 1/5, … 1.
pub fn interpolated(nodes: &[f64; 6], cos: f64) -> f64 {
    let place = 5.0 * cos.clamp(0.0, 1.0).sqrt();
    // Hat functions instead of an index, in the same form as in SIMD.
    let hats = nodes.iter().zip(0..);
    hats.map(|(value, node)| value * (1.0 - (place - f64::from(node)).abs()).max(0.0))
        .sum()
}

const STEPS: usize = 64;

fn midpoint(i: usize) -> f64 {
    (i as f64 + 0.5) / STEPS as f64
}

/// Directional reflectance of a sheen of strength 1 towards a direction, by the midpoint rule.
fn reflectance(roughness: f64, cos_o: f64) -> f64 {
    let wo = DVec3::new((1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o);
    let mut sum = 0.0;
    for place in 0..STEPS * STEPS {
        // By symmetry half of the azimuths suffice; the mean over them absorbs the factor 2π of
        // `sheen`.
        let (cos_i, phi) = (midpoint(place / STEPS), PI * midpoint(place % STEPS));
        let sine = (1.0 - cos_i * cos_i).sqrt();
        let wi = DVec3::new(sine * phi.cos(), sine * phi.sin(), cos_i);
        sum += sheen(roughness, cos_o, cos_i, (wo + wi).normalize().z) * cos_i;
    }
    sum / (STEPS * STEPS) as f64
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
    fn interpolated_reflectance_is_just_above_what_is_reflected() {
        for step in 0..=37 {
            let root = f64::from(SHEEN_ROOT_MIN);
            let roughness = (root + (1.0 - root) * f64::from(step) / 37.0).powi(2);
            let nodes = sheen_reflectances(roughness);
            for i in 1..40 {
                let cos = (f64::from(i) / 40.0).powi(2);
                let (bound, exact) = (interpolated(&nodes, cos), reflectance(roughness, cos));
                assert!(bound >= exact, "{roughness} {cos}: {bound} {exact}");
                assert!(
                    bound <= 1.02 * exact + 0.06,
                    "{roughness} {cos}: {bound} {exact}"
                );
            }
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
