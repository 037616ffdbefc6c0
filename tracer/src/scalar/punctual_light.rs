//! Punctual lights: irradiance at a point, and light sampling.

use glam::DVec3;

use super::intersect::vector;
use crate::compiled::PunctualLightData;
use crate::sampling::BELOW_1;

/// Light at a point from a punctual light.
#[derive(Clone, Copy, Debug)]
pub struct PunctualIncidence {
    /// Unit direction to the light.
    pub wi: DVec3,
    /// Distance, metres; infinite for a distant light.
    pub distance: f64,
    /// Irradiance on a surface at the point that faces the light, W·m⁻².
    pub irradiance: DVec3,
}

impl PunctualIncidence {
    /// Light from `light` at `point`.
    pub fn new(light: &PunctualLightData, point: DVec3) -> Self {
        let direction = vector(light.direction);
        if light.is_distant == 1 {
            return Self {
                wi: -direction,
                distance: f64::INFINITY,
                irradiance: vector(light.strength),
            };
        }
        let to_light = vector(light.center) - point;
        let distance = to_light.length();
        let wi = to_light / distance;
        let (scale, offset) = (f64::from(light.cone_scale), f64::from(light.cone_offset));
        // Linear in the cosine between the inner and outer cone, then squared, as in KHR_lights_punctual.
        let cone = (-wi.dot(direction) * scale + offset).clamp(0.0, 1.0);
        Self {
            wi,
            distance,
            irradiance: vector(light.strength) * (cone * cone / (distance * distance)),
        }
    }

    fn weight(&self) -> f64 {
        self.irradiance.element_sum()
    }
}

/// Draws a light in proportion to its irradiance by `u`, and returns it over its probability; `None` if no
/// light arrives.
pub fn sample_punctual_light(
    lights: &[PunctualLightData],
    point: DVec3,
    mut u: f64,
) -> Option<PunctualIncidence> {
    let mut sum = 0.0;
    let mut chosen: Option<PunctualIncidence> = None;
    for light in lights {
        let next = PunctualIncidence::new(light, point);
        let weight = next.weight();
        if weight <= 0.0 {
            continue;
        }
        let before = sum;
        sum += weight;
        let at = u * sum;
        // Weighted reservoir sampling with one random number, rescaled to be uniform within the part of [0,
        // `sum`) that it falls in.
        if at >= before {
            chosen = Some(next);
            u = (at - before) / weight;
        } else {
            u = at / before;
        }
        u = u.min(BELOW_1);
    }
    chosen.map(|chosen| PunctualIncidence {
        irradiance: chosen.irradiance * (sum / chosen.weight()),
        ..chosen
    })
}
