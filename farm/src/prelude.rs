//! Names for applications: `use carom_farm::prelude::*;`.

pub use carom_tracer::glam::{self, Quat, Vec3};
pub use carom_tracer::{
    AreaLight, Axis, Camera, Cuboid, Environment, ImageSize, Lens, Material, ObjectHandle, Plane,
    RadianceImage, RenderSettings, Scene, SceneUpdate, Shape, Sphere,
};

pub use crate::{
    Error, Farm, FarmConfig, FarmEvent, Film, FilmJob, FilmProgress, Live, LiveView, LocalNode,
    NodeStatus, Picture, Still, StillJob, StillProgress,
};
