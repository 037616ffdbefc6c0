//! Punctual lights, which have no extent: points, spots and distant lights.

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A light without extent. It casts sharp shadows and is itself invisible, also in reflections.
///
/// The same as in glTF's `KHR_lights_punctual`, but in radiometric units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PunctualLight {
    /// Name for messages; need not be unique.
    pub name: String,
    /// Type and parameters of the emitter.
    pub emitter: PunctualEmitter,
}

/// The emitter of a [`PunctualLight`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PunctualEmitter {
    /// A point that shines uniformly in all directions.
    Point {
        /// Position in metres.
        center: Vec3,
        /// Radiant intensity in W·sr⁻¹ per channel, at least 0.
        intensity: Vec3,
    },
    /// A point that shines into a cone: uniformly up to an inner angle, then falling off to 0 at an
    /// outer one, with the square of an interpolation of the cosine.
    Spot {
        /// Position in metres.
        center: Vec3,
        /// Axis of the cone, pointing away from the light; any length but 0.
        direction: Vec3,
        /// Radiant intensity along the axis in W·sr⁻¹ per channel, at least 0.
        intensity: Vec3,
        /// Angle from the axis in degrees up to which it shines uniformly, from 0 to `outer_deg`.
        inner_deg: f32,
        /// Angle from the axis in degrees beyond which it is dark, at most 90.
        outer_deg: f32,
    },
    /// A distant light such as the sun: parallel light from one direction.
    Distant {
        /// Direction in which the light travels; any length but 0.
        direction: Vec3,
        /// Irradiance on a surface that faces the light, in W·m⁻² per channel, at least 0.
        irradiance: Vec3,
    },
}

impl PunctualLight {
    /// A point light.
    pub fn point(center: impl Into<Vec3>, intensity: impl Into<Vec3>) -> Self {
        Self::new(PunctualEmitter::Point {
            center: center.into(),
            intensity: intensity.into(),
        })
    }

    /// A distant light that shines in a direction.
    pub fn distant(direction: impl Into<Vec3>, irradiance: impl Into<Vec3>) -> Self {
        Self::new(PunctualEmitter::Distant {
            direction: direction.into(),
            irradiance: irradiance.into(),
        })
    }

    /// A light with the name "light".
    pub fn new(emitter: PunctualEmitter) -> Self {
        let name = "light".to_owned();
        Self { name, emitter }
    }

    /// Sets the name.
    #[must_use]
    pub fn named(self, name: impl Into<String>) -> Self {
        let name = name.into();
        Self { name, ..self }
    }

    /// Intensity in W·sr⁻¹ or, for distant lights, irradiance in W·m⁻².
    pub fn strength(&self) -> Vec3 {
        match self.emitter {
            PunctualEmitter::Point { intensity, .. } | PunctualEmitter::Spot { intensity, .. } => {
                intensity
            }
            PunctualEmitter::Distant { irradiance, .. } => irradiance,
        }
    }
}
