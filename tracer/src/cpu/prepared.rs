//! A scene with its settings, laid out for the lanes.

use super::area_light::AreaLights;
use super::emissive_surface::EmissiveSurfaceSampler;
use super::environment::Environment;
use super::geometry::Geometry;
use super::surface::Surfaces;
use crate::compiled::{CameraFrame, CompiledScene, PunctualLightData};
use crate::{ImageSize, RenderSettings};

/// A scene for one picture, laid out for the lanes.
pub(super) struct Prepared {
    pub(super) camera: CameraFrame,
    pub(super) environment: Environment,
    pub(super) geometry: Geometry,
    pub(super) surfaces: Surfaces,
    pub(super) area_lights: AreaLights,
    /// Triangles that emit, if there are any.
    pub(super) emissive_surfaces: Option<EmissiveSurfaceSampler>,
    /// Some surface emits.
    pub(super) has_emission: bool,
    pub(super) punctual_lights: Vec<PunctualLightData>,
    /// With which light sampling aims at those, and at area lights.
    pub(super) punctual_probability: f32,
    pub(super) area_light_probability: f32,
    /// The scene has what the game's have not: triangles, glTF's material, an environment map, punctual lights.
    pub(super) is_general: bool,
    pub(super) has_coat: bool,
    /// How wide the surface is that a pixel sees at a distance of 1 m, in metres.
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
