//! Punctual lights as read by back ends.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::scene::{PunctualEmitter, PunctualLight};

/// A punctual light: point, spot or distant.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct PunctualLightData {
    /// Position, metres; 0 for a distant light.
    pub center: [f32; 3],
    /// 1 for a distant light, else 0.
    pub is_distant: u32,
    /// Unit direction in which it shines; 0 for a point light.
    pub direction: [f32; 3],
    /// Factor of the cosine to `direction`: a spot's intensity is scaled by the square of
    /// `cosine · cone_scale + cone_offset`, clamped to [0, 1].
    pub cone_scale: f32,
    /// Intensity, W·sr⁻¹; for a distant light irradiance, W·m⁻².
    pub strength: [f32; 3],
    /// See `cone_scale`.
    pub cone_offset: f32,
}

impl From<&PunctualLight> for PunctualLightData {
    fn from(light: &PunctualLight) -> Self {
        let unit = |v: Vec3| v.as_dvec3().normalize().as_vec3().to_array();
        let even = Self {
            strength: light.strength().to_array(),
            cone_offset: 1.0,
            ..Self::zeroed()
        };
        match light.emitter {
            PunctualEmitter::Point { center, .. } => Self {
                center: center.to_array(),
                ..even
            },
            PunctualEmitter::Spot {
                center,
                direction,
                inner_deg,
                outer_deg,
                ..
            } => {
                let [inner, outer] =
                    [inner_deg, outer_deg].map(|deg| f64::from(deg).to_radians().cos());
                let scale = 1.0 / (inner - outer).max(1e-3);
                Self {
                    center: center.to_array(),
                    direction: unit(direction),
                    cone_scale: scale as f32,
                    cone_offset: (-outer * scale) as f32,
                    ..even
                }
            }
            PunctualEmitter::Distant { direction, .. } => Self {
                is_distant: 1,
                direction: unit(direction),
                ..even
            },
        }
    }
}
