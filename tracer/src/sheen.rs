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
    let most = (0..STEPS).map(|i| reflectance(roughness, midpoint(i).powi(2)));
    1.01 * most.fold(0.0, f64::max)
}

/// About the share of light that a sheen of strength 1 reflects to cosines whose square roots are 0, 1/5, … 1, at least as much as
/// it does, with 1 % to spare: what is between is interpolated in the root, see [`interpolated`].
pub fn sheen_reflectances(roughness: f64) -> [f64; 6] {
    let reflectances: Vec<f64> = (0..=5 * NODE_STEPS)
        .map(|i| root_reflectance(roughness, i))
        .collect();
    std::array::from_fn(|node| {
        let around = (node * NODE_STEPS).saturating_sub(NODE_STEPS)
            ..=(node * NODE_STEPS + NODE_STEPS).min(5 * NODE_STEPS);
        // What the lines to both neighbours must be raised by.
        let own = reflectances[node * NODE_STEPS];
        let chord = |i: usize| {
            let first = i / NODE_STEPS * NODE_STEPS;
            let next = (first + NODE_STEPS).min(5 * NODE_STEPS);
            let share = (i - first) as f64 / NODE_STEPS as f64;
            reflectances[first] + share * (reflectances[next] - reflectances[first])
        };
        let excess = around.map(|i| reflectances[i] - chord(i));
        1.01 * (own + excess.fold(0.0, f64::max))
    })
}

/// A value between those at six cosines whose square roots are 0, 1/5, … 1.
pub fn interpolated(nodes: &[f64; 6], cos: f64) -> f64 {
    let place = 5.0 * cos.clamp(0.0, 1.0).sqrt();
    let hats = nodes.iter().zip(0..);
    hats.map(|(value, node)| value * (1.0 - (place - f64::from(node)).abs()).max(0.0))
        .sum()
}

const STEPS: usize = 64;
/// Between two nodes.
const NODE_STEPS: usize = 4;

fn midpoint(i: usize) -> f64 {
    (i as f64 + 0.5) / STEPS as f64
}

fn root_reflectance(roughness: f64, step: usize) -> f64 {
    let root = step as f64 / (5 * NODE_STEPS) as f64;
    // What is seen edge-on reflects as what nearly is.
    reflectance(roughness, (root * root).max(1e-4))
}

/// The share of light from all directions that a sheen of strength 1 reflects to one.
fn reflectance(roughness: f64, cos_o: f64) -> f64 {
    let wo = DVec3::new((1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o);
    let mut sum = 0.0;
    for place in 0..STEPS * STEPS {
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
        for roughness in [0.1, 0.25, 0.5, 1.0] {
            let nodes = sheen_reflectances(roughness);
            for i in 1..100 {
                let cos = f64::from(i) / 100.0;
                let (bound, exact) = (interpolated(&nodes, cos), reflectance(roughness, cos));
                assert!(bound >= exact, "{roughness} {cos}: {bound} {exact}");
                assert!(
                    bound <= 1.3 * exact + 0.05,
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
