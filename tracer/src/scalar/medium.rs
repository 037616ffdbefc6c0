//! Free flight through the homogeneous medium inside a dielectric.

use std::f64::consts::PI;

use glam::DVec3;

use super::intersect::vector;
use crate::compiled::MaterialData;

/// A homogeneous medium with an isotropic phase function.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Medium {
    /// Extinction coefficient, m⁻¹.
    extinction: DVec3,
    /// Scattering coefficient over `sampling_density`.
    scattering: DVec3,
    /// Rate of the exponential distribution of distances, m⁻¹; 0 if the medium does not scatter.
    sampling_density: f64,
}

/// Result of a free flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeFlight {
    /// Distance of the scattering event, metres, if it is before the boundary.
    pub scattered_at: Option<f64>,
    /// Factor of the throughput: transmittance per channel, and scattering coefficient if scattered, over
    /// the density.
    pub weight: DVec3,
}

impl Medium {
    /// Medium inside a body of this material.
    pub fn new(material: &MaterialData) -> Self {
        Self {
            extinction: vector(material.extinction),
            scattering: vector(material.scattering),
            sampling_density: f64::from(material.sampling_density),
        }
    }

    /// Samples a flight towards a boundary at `t` metres: the distance is drawn by `u` from the
    /// exponential distribution of the channel of least extinction.
    pub fn sample_distance(&self, t: f64, u: f64) -> FreeFlight {
        let distance = -(1.0 - u).ln() / self.sampling_density;
        // Transmittance exp(−σt t) over exp(−rate t), the probability of reaching t; the density rate ·
        // exp(−rate t) of scattering has its factor `rate` in `scattering` already.
        let left = |t: f64| (-(self.extinction - self.sampling_density) * t).map(f64::exp);
        // Without scattering the rate is 0 and the distance ∞, or NaN for u = 0; neither is below t.
        if distance < t {
            return FreeFlight {
                scattered_at: Some(distance),
                weight: self.scattering * left(distance),
            };
        }
        FreeFlight {
            scattered_at: None,
            weight: left(t),
        }
    }

    /// Transmittance over `t` metres.
    pub fn transmittance(&self, t: f64) -> DVec3 {
        (-self.extinction * t).map(f64::exp)
    }
}

/// Direction uniform on the sphere.
pub fn uniform_direction(u1: f64, u2: f64) -> DVec3 {
    let z = 1.0 - 2.0 * u1;
    let sine = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (2.0 * PI * u2).sin_cos();
    DVec3::new(sine * cos, sine * sin, z)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over many flights, light that passes is e^(−σt·t), and light that is scattered the albedo's
    /// share of the rest, in each channel.
    #[test]
    fn free_flights_keep_beer_s_law_and_the_albedo() {
        const FLIGHTS: u32 = 200_000;
        let (extinction, albedo) = (DVec3::new(2.0, 3.0, 5.0), DVec3::new(1.0, 0.8, 0.0));
        let medium = Medium {
            extinction,
            scattering: albedo * extinction / 2.0,
            sampling_density: 2.0,
        };
        let (mut passed, mut scattered) = (DVec3::ZERO, DVec3::ZERO);
        for i in 0..FLIGHTS {
            let u = (f64::from(i) + 0.5) / f64::from(FLIGHTS);
            let flight = medium.sample_distance(0.4, u);
            match flight.scattered_at {
                Some(distance) => {
                    assert!((0.0..0.4).contains(&distance));
                    scattered += flight.weight / f64::from(FLIGHTS);
                }
                None => passed += flight.weight / f64::from(FLIGHTS),
            }
        }
        let expected = (-extinction * 0.4).map(f64::exp);
        assert!((passed - expected).length() < 1e-4, "{passed} {expected}");
        assert!(
            (scattered - albedo * (1.0 - expected)).length() < 1e-4,
            "{scattered}"
        );
    }

    #[test]
    fn what_does_not_scatter_only_absorbs() {
        let medium = Medium {
            extinction: DVec3::new(0.0, 1.0, 10.0),
            scattering: DVec3::ZERO,
            sampling_density: 0.0,
        };
        for u in [0.0, 0.5, 0.999] {
            let flight = medium.sample_distance(0.3, u);
            assert_eq!(flight.scattered_at, None);
            let expected = DVec3::new(1.0, (-0.3f64).exp(), (-3f64).exp());
            assert!((flight.weight - expected).length() < 1e-12);
        }
    }

    #[test]
    fn directions_are_even() {
        let mut mean = DVec3::ZERO;
        for i in 0..128 * 128 {
            let place = |i: i32| (f64::from(i) + 0.5) / 128.0;
            let w = uniform_direction(place(i % 128), place(i / 128));
            assert!((w.length() - 1.0).abs() < 1e-12);
            mean += w / f64::from(128 * 128);
        }
        assert!(mean.length() < 1e-12, "{mean}");
    }
}
