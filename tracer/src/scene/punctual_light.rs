//! Lights without extent: points, spots and suns.

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A light without extent, which makes sharp shadows and is not seen itself, nor in mirrors.
///
/// As in glTF's `KHR_lights_punctual`, but in radiometric units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PunctualLight {
    /// Shown in messages; need not be unique.
    pub name: String,
    /// Where its light comes from.
    pub emitter: PunctualEmitter,
}

/// Where the light of a [`PunctualLight`] comes from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PunctualEmitter {
    /// A point.
    Point {
        /// Its place in metres.
        center: Vec3,
        /// Radiant intensity in W·sr⁻¹ per channel, at least 0.
        intensity: Vec3,
    },
    /// A point that shines into a cone: evenly up to an angle, then less until another one, by a cosine's square.
    Spot {
        /// Its place in metres.
        center: Vec3,
        /// The axis of the cone, away from the light; any length but 0.
        direction: Vec3,
        /// Radiant intensity along the axis in W·sr⁻¹ per channel, at least 0.
        intensity: Vec3,
        /// Angle from the axis up to which it shines evenly, in degrees, from 0 to `outer_deg`.
        inner_deg: f32,
        /// Angle from the axis from which on it is dark, in degrees, at most 90.
        outer_deg: f32,
    },
    /// A sun: light of one direction from afar.
    Distant {
        /// The direction that it shines in; any length but 0.
        direction: Vec3,
        /// Irradiance of a surface that faces it, in W·m⁻² per channel, at least 0.
        irradiance: Vec3,
    },
}

impl PunctualLight {
    /// A point that shines evenly.
    pub fn point(center: impl Into<Vec3>, intensity: impl Into<Vec3>) -> Self {
        Self::new(PunctualEmitter::Point {
            center: center.into(),
            intensity: intensity.into(),
        })
    }

    /// A sun that shines in a direction.
    pub fn distant(direction: impl Into<Vec3>, irradiance: impl Into<Vec3>) -> Self {
        Self::new(PunctualEmitter::Distant {
            direction: direction.into(),
            irradiance: irradiance.into(),
        })
    }

    /// Called "light".
    pub fn new(emitter: PunctualEmitter) -> Self {
        let name = "light".to_owned();
        Self { name, emitter }
    }

    /// What messages call it.
    #[must_use]
    pub fn named(self, name: impl Into<String>) -> Self {
        let name = name.into();
        Self { name, ..self }
    }

    /// Intensity in W·sr⁻¹ or irradiance in W·m⁻².
    pub fn strength(&self) -> Vec3 {
        match self.emitter {
            PunctualEmitter::Point { intensity, .. } | PunctualEmitter::Spot { intensity, .. } => {
                intensity
            }
            PunctualEmitter::Distant { irradiance, .. } => irradiance,
        }
    }
}
