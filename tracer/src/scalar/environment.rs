//! Environment lighting.

use std::f64::consts::PI;

use glam::DVec3;

use crate::CompiledScene;
use crate::compiled::CompiledEnvironment;

/// A direction sampled from the environment map.
#[derive(Clone, Copy, Debug)]
pub struct EnvironmentDirection {
    /// Unit direction.
    pub wi: DVec3,
    /// Reciprocal of the density of `wi` per solid angle, sr; 0 at the poles.
    pub inverse_pdf: f64,
    /// Radiance from that direction, W·sr⁻¹·m⁻².
    pub radiance: DVec3,
}

impl CompiledEnvironment {
    /// Draws a direction by its importance.
    pub fn sample_direction(&self, u: [f64; 2]) -> EnvironmentDirection {
        let sample = self.sample(u.map(|u| u as f32));
        let (wi, sine) = self.direction(sample.uv);
        EnvironmentDirection {
            wi,
            inverse_pdf: SQUARE_TO_SPHERE * sine / f64::from(sample.density),
            radiance: DVec3::from(self.radiance(sample.uv).map(f64::from)),
        }
    }

    /// Density per solid angle with which [`CompiledEnvironment::sample_direction`] draws a direction.
    pub fn pdf(&self, direction: DVec3) -> f64 {
        let (sine, uv) = self.uv(direction);
        f64::from(self.density(uv)) / (SQUARE_TO_SPHERE * sine)
    }
}

/// Solid angle per unit of the map's parameter square, divided by the sine of the colatitude: 2π · π.
pub const SQUARE_TO_SPHERE: f64 = 2.0 * PI * PI;

/// Radiance of the environment along a ray that leaves the scene.
pub fn environment_radiance(scene: &CompiledScene, direction: DVec3) -> DVec3 {
    let map = &scene.environment_map;
    if map.is_empty() {
        return scene.environment.as_dvec3();
    }
    let (_, uv) = map.uv(direction);
    DVec3::from(map.radiance(uv).map(f64::from))
}
