//! Lights without extent as back ends read them.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::scene::{PunctualEmitter, PunctualLight};

/// A light without extent.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct PunctualLightData {
    /// Its place, metres; 0 of a distant one.
    pub center: [f32; 3],
    /// 1 of a distant one, 0 of the others.
    pub is_distant: u32,
    /// Unit direction in which it shines; 0 of a point.
    pub direction: [f32; 3],
    /// Factor on the cosine to the direction; a spot's light is the square of that plus `cone_offset`, from 0 to 1.
    pub cone_scale: f32,
    /// Intensity, W·sr⁻¹; of a distant one irradiance, W·m⁻².
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
