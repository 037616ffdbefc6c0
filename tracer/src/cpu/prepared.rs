//! Scene and settings in the data layout of the SIMD kernels.

use super::area_light::AreaLights;
use super::emissive_surface::EmissiveSurfaceSampler;
use super::environment::Environment;
use super::geometry::Geometry;
use super::surface::Surfaces;
use crate::compiled::{CameraFrame, CompiledScene, PunctualLightData};
use crate::{ImageSize, RenderSettings};

/// A scene for one image, in the data layout of the SIMD kernels.
pub(super) struct Prepared {
    pub(super) camera: CameraFrame,
    pub(super) environment: Environment,
    pub(super) geometry: Geometry,
    pub(super) surfaces: Surfaces,
    pub(super) area_lights: AreaLights,
    /// Sampler of emissive surfaces, if there are any.
    pub(super) emissive_surfaces: Option<EmissiveSurfaceSampler>,
    /// Whether any surface emits.
    pub(super) has_emission: bool,
    pub(super) punctual_lights: Vec<PunctualLightData>,
    /// Probability with which light sampling chooses punctual lights.
    pub(super) punctual_probability: f32,
    /// Probability with which light sampling chooses area lights.
    pub(super) area_light_probability: f32,
    /// Whether the scene has features that the game's scenes lack: triangles, glTF's material, environment
    /// map, punctual lights. Selects the general variant of the shading kernel.
    pub(super) is_general: bool,
    pub(super) has_coat: bool,
    /// Width of the surface that a pixel covers at a distance of 1 m, metres.
    pub(super) footprint: f32,
    pub(super) settings: RenderSettings,
}

impl Prepared {
    pub(super) fn new(scene: &CompiledScene, size: ImageSize, settings: RenderSettings) -> Self {
        let camera = scene.camera_frame(size);
        let surfaces = Surfaces::new(scene);
        let is_general = surfaces.is_general()
            || scene.punctual_probability > 0.0
            || !scene.environment_map.is_empty();
        Self {
            footprint: glam::Vec3::from(camera.dx).length(),
            camera,
            environment: Environment::new(scene),
            geometry: Geometry::new(scene),
            surfaces,
            area_lights: AreaLights::new(&scene.area_lights),
            emissive_surfaces: EmissiveSurfaceSampler::new(scene),
            has_emission: scene.has_emission(),
            punctual_lights: scene.punctual_lights.clone(),
            punctual_probability: scene.punctual_probability,
            area_light_probability: scene.area_light_probability() as f32,
            is_general,
            has_coat: scene.materials.iter().any(|material| material.ior > 0.0),
            settings,
        }
    }
}
