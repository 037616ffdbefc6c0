//! Scenes: plain data in SI units, in a right-handed world with +z up.
//!
//! Radiance and albedo are linear Rec. 709 triples. [`mod@file`] reads and writes scenes as JSON,
//! [`validate`] holds the limits that every scene must keep.

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

/// Everything that can be seen, and from where.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// The camera of frames that bring none of their own.
    pub camera: Camera,
    /// The light that rays find when they leave the scene.
    pub environment: Environment,
    /// Materials by name; [`Object::material`] refers to them.
    #[serde(deserialize_with = "bounded::materials")]
    pub materials: BTreeMap<String, Material>,
    /// Surfaces. Their index here is what [`ObjectPose::object`] names.
    #[serde(deserialize_with = "bounded::objects")]
    pub objects: Vec<Object>,
    /// Rectangles that emit light and reflect none.
    #[serde(default, alias = "lamps", deserialize_with = "bounded::area_lights")]
    pub area_lights: Vec<AreaLight>,
    /// Pictures for meshes; [`MaterialTextures`] has their index here.
    #[serde(default, deserialize_with = "bounded::textures")]
    pub textures: Vec<ImageTexture>,
    /// A picture of the surroundings, which [`Environment::radiance`] multiplies.
    #[serde(default)]
    pub environment_map: Option<EnvironmentMap>,
    /// Points, spots and suns.
    #[serde(default, deserialize_with = "bounded::punctual_lights")]
    pub punctual_lights: Vec<PunctualLight>,
    /// What the handles of its objects belong to; [`SceneIdentity::default`] for those without.
    #[serde(skip)]
    pub identity: SceneIdentity,
}

/// A camera with square pixels and a box filter; row 0 of its image is the top.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// The pinhole, or the middle of the lens, in metres.
    pub eye: Vec3,
    /// The point at the centre of the image, in metres.
    pub target: Vec3,
    /// The direction that is upright in the image; any length but 0, not parallel to the view.
    pub up: Vec3,
    /// Full horizontal field of view in degrees, in (0, 180).
    pub fov_x_deg: f32,
    /// What gives the image its depth of field; a pinhole by default.
    #[serde(default)]
    pub lens: Lens,
    /// Distance of the near plane from the eye, along the view, in metres; 0 by default. What lies before it is not seen,
    /// but lights, shades and is mirrored as ever; solids that it cuts are open there.
    #[serde(default)]
    pub near_m: f32,
}

/// A thin lens (Pharr, Jakob and Humphreys, "Physically Based Rendering", 4th edition, section 5.2.3).
///
/// Only points at the focus distance are sharp. One at distance `d` along the view blurs to a disc whose radius, seen
/// from the eye, is `aperture_radius_m · |1 / d − 1 / focus_distance_m|` in units of the image at distance 1. A wider
/// aperture needs more samples for the same noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lens {
    /// Radius of the aperture in metres; 0 is a pinhole, with which everything is sharp.
    pub aperture_radius_m: f32,
    /// Distance from the eye, along the view, at which things are sharp, in metres; above 0.
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

/// Constant radiance from every direction, or with [`Scene::environment_map`] what its picture is multiplied by.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Environment {
    /// Radiance in W·sr⁻¹·m⁻², per channel, at least 0.
    pub radiance: Vec3,
}

/// A named surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Object {
    /// Shown in messages and statistics; need not be unique.
    pub name: String,
    /// A key of [`Scene::materials`].
    pub material: String,
    /// Form and place.
    pub shape: Shape,
}

/// A form in world space.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A ball. Balls, truncated cones and meshes are what a [`SceneUpdate`] can move.
    Sphere {
        /// Centre in metres.
        center: Vec3,
        /// Radius in metres, above 0.
        radius: f32,
        /// `world_from_ball`, a unit quaternion (x, y, z, w); turns stripe and number.
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
    /// A box with faces parallel to the axes from which parts are taken away: a slate with its
    /// pockets, a bevelled cushion, a hollow lampshade.
    #[serde(alias = "carved")]
    CsgBox {
        /// Corner of the smallest coordinates, in metres.
        min: Vec3,
        /// Corner of the largest coordinates, in metres; above `min` on each axis.
        max: Vec3,
        /// What is taken away, at most [`validate::SUBTRACTIONS_MAX`]. Surfaces closer than
        /// [`validate::CSG_MARGIN_M`] to a subtraction count as within it.
        #[serde(alias = "cuts", deserialize_with = "bounded::subtractions")]
        subtractions: Vec<Subtraction>,
    },
    /// A round cone that is cut off at both ends: a cue.
    TruncatedCone {
        /// Centre of the narrow end, in metres.
        center: Vec3,
        /// `world_from_cone`, a unit quaternion (x, y, z, w): the wide end lies along the cone's z.
        #[serde(default)]
        rotation: Quat,
        /// From end to end in metres, above 0.
        length: f32,
        /// Radii of the narrow and of the wide end in metres, above 0. The slope of the side is in
        /// [`validate::CONE_SLOPE`].
        radii: [f32; 2],
    },
    /// A flat round disc, seen from both sides.
    Disc {
        /// Centre in metres.
        center: Vec3,
        /// Normal, any length but 0.
        normal: Vec3,
        /// Radius in metres, above 0.
        radius: f32,
    },
    /// A flat rectangle, seen from both sides.
    Rectangle {
        /// Centre in metres.
        center: Vec3,
        /// From the centre to the middle of one edge, in metres.
        half_u: Vec3,
        /// From the centre to the middle of the next edge; at right angles to `half_u`.
        half_v: Vec3,
    },
    /// Triangles that share vertices, seen from both sides.
    Mesh(Mesh),
}

/// A solid that is subtracted from a [`Shape::CsgBox`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Subtraction {
    /// The solid.
    #[serde(alias = "form")]
    pub solid: CsgSolid,
    /// A key of [`Scene::materials`] for the surface that the subtraction lays open; the object's own if
    /// absent.
    #[serde(default)]
    pub material: Option<String>,
}

/// The solid of a [`Subtraction`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum CsgSolid {
    /// All beyond a plane: where `normal · (p − point) > 0`.
    #[serde(alias = "beyond")]
    HalfSpace {
        /// A point of the plane, in metres.
        point: Vec3,
        /// Normal out of what remains, any length but 0.
        normal: Vec3,
    },
    /// An infinite upright cylinder: a round hole.
    #[serde(alias = "bore")]
    Cylinder {
        /// Its axis, in metres; z does not matter.
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
        /// What its axis is parallel to.
        #[serde(default = "upright")]
        axis: Axis,
        /// Where its axis is `radius` away from its surface, in metres.
        center: Vec3,
        /// Radius in metres.
        radius: f32,
        /// By how much the radius grows along the axis, in [−1, 1].
        #[serde(default)]
        taper: f32,
        /// Only what lies farther from the axis in this direction is subtracted: beyond the plane through
        /// `center + beyond` at right angles to it. What it has along the axis does not matter; with 0 all round.
        #[serde(default)]
        beyond: Vec3,
    },
}

/// A rectangle that emits from one side and is black from both.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AreaLight {
    /// Shown in messages and statistics; need not be unique.
    pub name: String,
    /// Centre in metres.
    pub center: Vec3,
    /// From the centre to the middle of one edge, in metres.
    pub half_u: Vec3,
    /// From the centre to the middle of the next edge; at right angles to `half_u`.
    /// Light leaves on the side of `half_u × half_v`.
    pub half_v: Vec3,
    /// Radiance in W·sr⁻¹·m⁻², per channel, at least 0: the mean.
    pub radiance: Vec3,
    /// The share by which the radiance is higher at the edge that `half_u` leads to, and lower at the opposite one; per
    /// channel, in [−1, 1].
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
    /// Along the table.
    X,
    /// Across it.
    Y,
    /// Up.
    Z,
}

/// What differs from frame to frame: a few hundred bytes that describe a whole picture.
#[derive(Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneUpdate {
    /// The frame's camera; the scene's own if absent.
    pub camera: Option<Camera>,
    /// Objects that are elsewhere than the scene has them.
    pub poses: Vec<ObjectPose>,
    /// Dust, grains and drops: at most [`validate::CLOUDS_MAX`] of [`validate::PARTICLES_MAX`] together.
    pub particles: Vec<ParticleCloud>,
}

/// Without particles as it was before there were any: checkpoints know pictures by this text.
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
    /// Seen by this camera.
    #[must_use]
    pub fn camera(self, camera: Camera) -> Self {
        Self {
            camera: Some(camera),
            ..self
        }
    }

    /// With these particles.
    #[must_use]
    pub fn particles(self, particles: Vec<ParticleCloud>) -> Self {
        Self { particles, ..self }
    }

    /// With an object here, see [`Scene::pose`].
    #[must_use]
    pub fn pose(mut self, pose: ObjectPose) -> Self {
        self.poses.push(pose);
        self
    }
}

/// Where a movable object is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectPose {
    /// Index into [`Scene::objects`]; must be a sphere, a truncated cone or a mesh.
    pub object: u32,
    /// Centre of the sphere or of the cone's narrow end, or the mesh's own origin, in metres.
    pub position: Vec3,
    /// `world_from_ball`, `world_from_cone` or `world_from_mesh`, a unit quaternion.
    pub rotation: Quat,
    /// `false` leaves the object out of the picture.
    pub visible: bool,
}
