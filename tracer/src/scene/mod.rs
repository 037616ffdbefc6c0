//! Scenes: plain data in SI units, in a right-handed world with +z up.
//!
//! Radiance and albedo are linear Rec. 709 triples. [`mod@file`] reads and writes scenes as JSON,
//! [`validate`] defines the limits of every scene.

mod bounded;
mod construction;
mod environment_map;
pub mod file;
#[cfg(feature = "gltf")]
pub mod gltf_file;
mod image_texture;
mod layers;
mod material;
mod mesh;
pub mod mesh_file;
mod particles;
mod punctual_light;
pub mod validate;

use std::collections::BTreeMap;
use std::fmt;

use glam::{Quat, Vec3};
use serde::{Deserialize, Serialize};

pub use construction::{Cuboid, ObjectHandle, Plane, SceneIdentity, Sphere};
#[cfg(feature = "image-io")]
pub(crate) use environment_map::environment_bytes;
pub use environment_map::{ENVIRONMENT_EDGE_MAX, EnvironmentMap};
pub(crate) use image_texture::halved;
pub use image_texture::{
    ColorSpace, FileBytes, ImageSource, ImageTexture, MaterialTextures, TEXTURE_EDGE_MAX, Wrap,
};
#[cfg(feature = "image-io")]
pub(crate) use image_texture::{levels, texels_with_levels};
pub use layers::{Layers, Opacity};
pub use material::{ClothMarks, Material, Medium, ProceduralTexture, Sights, Stripe};
pub use mesh::Mesh;
pub use particles::{ParticleCloud, ParticleForm};
pub use punctual_light::{PunctualEmitter, PunctualLight};

/// Everything that is visible, and the camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// The camera of frames that do not specify one.
    pub camera: Camera,
    /// Light from outside of the scene.
    pub environment: Environment,
    /// Materials by name; [`Object::material`] refers to them.
    #[serde(deserialize_with = "bounded::materials")]
    pub materials: BTreeMap<String, Material>,
    /// Objects; [`ObjectPose::object`] is an index into this list.
    #[serde(deserialize_with = "bounded::objects")]
    pub objects: Vec<Object>,
    /// Rectangles that emit light and do not reflect any.
    #[serde(default, alias = "lamps", deserialize_with = "bounded::area_lights")]
    pub area_lights: Vec<AreaLight>,
    /// Image textures for meshes; [`MaterialTextures`] has indices into this list.
    #[serde(default, deserialize_with = "bounded::textures")]
    pub textures: Vec<ImageTexture>,
    /// Environment map, which is multiplied by [`Environment::radiance`].
    #[serde(default)]
    pub environment_map: Option<EnvironmentMap>,
    /// Punctual lights: points, spots and distant lights.
    #[serde(default, deserialize_with = "bounded::punctual_lights")]
    pub punctual_lights: Vec<PunctualLight>,
    /// Identity that the handles of its objects refer to; a default one for scenes without handles.
    #[serde(skip)]
    pub identity: SceneIdentity,
}

/// A camera with square pixels and a box filter; row 0 of its image is the top.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// The pinhole, or the centre of the lens, in metres.
    pub eye: Vec3,
    /// The point at the centre of the image, in metres.
    pub target: Vec3,
    /// The direction that is up in the image; any length but 0, not parallel to the view.
    pub up: Vec3,
    /// Full horizontal field of view in degrees, in [`validate::FOV_X_DEG`].
    pub fov_x_deg: f32,
    /// The lens, which determines the depth of field; a pinhole by default.
    #[serde(default)]
    pub lens: Lens,
    /// Distance of the near plane from the eye, along the view, in metres; 0 by default. What lies
    /// in front of it is invisible to camera rays, but still emits light, casts shadows and appears
    /// in reflections; solids that it intersects appear open.
    #[serde(default)]
    pub near_m: f32,
}

/// A thin lens (Pharr, Jakob and Humphreys, "Physically Based Rendering", 4th edition, section 5.2.3).
///
/// Only points at the focus distance are in focus. One at distance `d` along the view becomes a
/// disc whose radius, as seen from the eye, is `aperture_radius_m · |1 / d − 1 / focus_distance_m|`
/// in units of the image at distance 1. A wider aperture needs more samples for the same noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lens {
    /// Radius of the aperture in metres; 0 is a pinhole, which has everything in focus.
    pub aperture_radius_m: f32,
    /// Distance from the eye, along the view, that is in focus, in metres; above 0.
    pub focus_distance_m: f32,
}

impl Default for Lens {
    fn default() -> Self {
        Self {
            aperture_radius_m: 0.0,
            focus_distance_m: 1.0,
        }
    }
}

/// Constant radiance from every direction, or the factor of [`Scene::environment_map`] if there is
/// one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Environment {
    /// Radiance in W·sr⁻¹·m⁻², per channel, at least 0.
    pub radiance: Vec3,
}

/// A named object with a material.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Object {
    /// Name for messages and statistics; need not be unique.
    pub name: String,
    /// A key of [`Scene::materials`].
    pub material: String,
    /// Shape and position.
    pub shape: Shape,
}

/// A shape in world space.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A sphere. Spheres, truncated cones and meshes can be moved by a [`SceneUpdate`].
    Sphere {
        /// Centre in metres.
        center: Vec3,
        /// Radius in metres, above 0.
        radius: f32,
        /// Rotation from object to world space, a unit quaternion (x, y, z, w); it orients stripe
        /// and number.
        #[serde(default)]
        rotation: Quat,
    },
    /// A solid box with faces parallel to the axes.
    Box {
        /// Corner of the smallest coordinates, in metres.
        min: Vec3,
        /// Corner of the largest coordinates, in metres; above `min` on each axis.
        max: Vec3,
    },
    /// An axis-aligned box from which solids are subtracted: a slate with pockets, a bevelled
    /// cushion, a hollow lampshade.
    #[serde(alias = "carved")]
    CsgBox {
        /// Corner of the smallest coordinates, in metres.
        min: Vec3,
        /// Corner of the largest coordinates, in metres; above `min` on each axis.
        max: Vec3,
        /// Solids that are subtracted, at most [`validate::SUBTRACTIONS_MAX`]. Surfaces closer than
        /// [`validate::CSG_MARGIN_M`] to a subtraction count as inside it.
        #[serde(alias = "cuts", deserialize_with = "bounded::subtractions")]
        subtractions: Vec<Subtraction>,
    },
    /// A truncated circular cone: a cue.
    TruncatedCone {
        /// Centre of the narrow end, in metres.
        center: Vec3,
        /// Rotation from object to world space, a unit quaternion (x, y, z, w): the wide end lies
        /// along the cone's z axis.
        #[serde(default)]
        rotation: Quat,
        /// Distance between the ends in metres, above 0.
        length: f32,
        /// Radii of the narrow and of the wide end in metres, above 0. The slope of the lateral
        /// surface must be in [`validate::CONE_SLOPE`].
        radii: [f32; 2],
    },
    /// A flat circular disc, visible from both sides.
    Disc {
        /// Centre in metres.
        center: Vec3,
        /// Normal, any length but 0.
        normal: Vec3,
        /// Radius in metres, above 0.
        radius: f32,
    },
    /// A flat rectangle, visible from both sides.
    Rectangle {
        /// Centre in metres.
        center: Vec3,
        /// Vector from the centre to the middle of an edge, in metres.
        half_u: Vec3,
        /// Vector from the centre to the middle of an adjacent edge, in metres; perpendicular to
        /// `half_u`.
        half_v: Vec3,
    },
    /// Triangles that share vertices, visible from both sides.
    Mesh(Mesh),
}

/// A solid that is subtracted from a [`Shape::CsgBox`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Subtraction {
    /// The solid.
    #[serde(alias = "form")]
    pub solid: CsgSolid,
    /// Material of the surface exposed by the subtraction, a key of [`Scene::materials`]; by
    /// default the object's own.
    #[serde(default)]
    pub material: Option<String>,
}

/// The solid of a [`Subtraction`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum CsgSolid {
    /// All points beyond a plane: those with `normal · (p − point) > 0`.
    #[serde(alias = "beyond")]
    HalfSpace {
        /// A point on the plane, in metres.
        point: Vec3,
        /// Normal that points out of what remains, any length but 0.
        normal: Vec3,
    },
    /// An infinite vertical cylinder: a round hole.
    #[serde(alias = "bore")]
    Cylinder {
        /// A point on its axis, in metres; z does not matter.
        center: Vec3,
        /// Radius in metres.
        radius: f32,
    },
    /// A box with faces parallel to the axes.
    #[serde(alias = "hollow")]
    Box {
        /// Corner of the smallest coordinates, in metres.
        min: Vec3,
        /// Corner of the largest coordinates, in metres; above `min` on each axis.
        max: Vec3,
    },
    /// Everything outside a cone or cylinder: what remains is a post, a cue's cone, or a box with a
    /// rounded edge.
    #[serde(alias = "turned")]
    ConeExterior {
        /// Axis of the world to which the cone's axis is parallel.
        #[serde(default = "upright")]
        axis: Axis,
        /// Point on the cone's axis where the cone's radius is `radius`, in metres.
        center: Vec3,
        /// Radius at `center` in metres.
        radius: f32,
        /// Increase of the radius per length along the axis, in [−1, 1].
        #[serde(default)]
        taper: f32,
        /// Restricts the subtraction to points beyond the plane through `center + beyond`
        /// perpendicular to `beyond`, of which the component along the axis is ignored; if 0, there
        /// is no restriction.
        #[serde(default)]
        beyond: Vec3,
    },
}

/// A rectangle that emits light from one side and reflects none on either side.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AreaLight {
    /// Name for messages and statistics; need not be unique.
    pub name: String,
    /// Centre in metres.
    pub center: Vec3,
    /// Vector from the centre to the middle of an edge, in metres.
    pub half_u: Vec3,
    /// Vector from the centre to the middle of an adjacent edge, in metres; perpendicular to
    /// `half_u`. Light is emitted on the side of `half_u × half_v`.
    pub half_v: Vec3,
    /// Mean radiance in W·sr⁻¹·m⁻², per channel, at least 0.
    pub radiance: Vec3,
    /// Relative increase of the radiance at the edge that `half_u` points to, and decrease at the
    /// opposite one; per channel, in [−1, 1].
    #[serde(default)]
    pub gradient: Vec3,
}

fn upright() -> Axis {
    Axis::Z
}

/// An axis of the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// Along a pool table.
    X,
    /// Across a pool table.
    Y,
    /// Up.
    Z,
}

/// What changes from frame to frame: a few hundred bytes that describe a whole image.
#[derive(Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneUpdate {
    /// The frame's camera; the scene's own if absent.
    pub camera: Option<Camera>,
    /// Poses of objects that differ from those in the scene.
    pub poses: Vec<ObjectPose>,
    /// Dust, grains and drops: at most [`validate::CLOUDS_MAX`] clouds with
    /// [`validate::PARTICLES_MAX`] particles in total.
    pub particles: Vec<ParticleCloud>,
}

/// Omits `particles` if there are none: checkpoints identify images by this text.
impl fmt::Debug for SceneUpdate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut fields = f.debug_struct("SceneUpdate");
        fields.field("camera", &self.camera);
        fields.field("poses", &self.poses);
        if !self.particles.is_empty() {
            fields.field("particles", &self.particles);
        }
        fields.finish()
    }
}

impl SceneUpdate {
    /// Sets the camera.
    #[must_use]
    pub fn camera(self, camera: Camera) -> Self {
        Self {
            camera: Some(camera),
            ..self
        }
    }

    /// Sets the particles.
    #[must_use]
    pub fn particles(self, particles: Vec<ParticleCloud>) -> Self {
        Self { particles, ..self }
    }

    /// Adds the pose of an object, see [`Scene::pose`].
    #[must_use]
    pub fn pose(mut self, pose: ObjectPose) -> Self {
        self.poses.push(pose);
        self
    }
}

/// The pose of a movable object.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectPose {
    /// Index into [`Scene::objects`] of a sphere, a truncated cone or a mesh.
    pub object: u32,
    /// Centre of the sphere, of the cone's narrow end, or the mesh's origin, in metres.
    pub position: Vec3,
    /// Rotation from object to world space, a unit quaternion.
    pub rotation: Quat,
    /// `false` hides the object.
    pub visible: bool,
}
