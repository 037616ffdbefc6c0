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
    /// Radiance in W·sr⁻¹·m⁻², per channel, at least 0.
    pub radiance: Vec3,
}

/// How a surface scatters light.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Material {
    /// Lambert: `f = albedo / π`.
    Diffuse {
        /// Share of light that is reflected, per channel, in [0, 1].
        albedo: Vec3,
    },
    /// A diffuse base under a smooth dielectric coat: a perfect mirror of weight `F(cos θi)` over
    /// `f = albedo/π · (1−F(cos θi))(1−F(cos θo)) / (η²(1−F_dr,int))`, the internal diffuse
    /// reflectance being that of the dielectric (Mitsuba's `plastic` with `nonlinear = false`).
    SmoothPlastic {
        /// Albedo of the base, per channel, in [0, 1].
        albedo: Vec3,
        /// Index of refraction of the coat against air, in [1, 1000]; phenolic resin 1.5.
        ior: f32,
        /// Share of light from the base that the coat throws back, `F_dr,int`, in [0, 0.99]. Absent:
        /// the exact integral for `ior`, which conserves energy. Given: to match a renderer that
        /// uses a fit.
        #[serde(default)]
        internal_reflectance: Option<f32>,
        /// A second colour in a band round the ball's local z axis.
        #[serde(default)]
        stripe: Option<Stripe>,
    },
    /// A painted or wooden base under a smooth clear coat, as [`Material::SmoothPlastic`] with the
    /// exact internal reflectance.
    Coated {
        /// Index of refraction of the coat against air, in [1, 1000]; varnish and phenolic resin
        /// 1.5.
        ior: f32,
        /// What the base looks like.
        #[serde(alias = "paint")]
        texture: ProceduralTexture,
    },
    /// Napped cloth: Lambert and the sheen of fibres that stand up from it, after Estevez and Kulla,
    /// "Production Friendly Microfacet Sheen BRDF" (SIGGRAPH 2017 course), with the shadowing of
    /// Neubelt and Pettineo, "Crafting a Next-Gen Material Pipeline for The Order: 1886" (2013).
    /// The base is darkened by the most that the sheen reflects, so that light is never gained.
    Cloth {
        /// Albedo of the base, per channel, in [0, 1].
        albedo: Vec3,
        /// Strength of the sheen per channel, in [0, 1].
        sheen: Vec3,
        /// Width of the sheen, in [0.1, 1]: small shows at grazing angles alone.
        sheen_roughness: f32,
        /// Nap, chalk and wear of a table's cloth with its lines and spots; absent: even.
        #[serde(default)]
        marks: Option<ClothMarks>,
    },
    /// Metal: a GGX microfacet mirror (Walter et al., "Microfacet Models for Refraction through
    /// Rough Surfaces", EGSR 2007) with the Fresnel term of a complex index of refraction.
    Conductor {
        /// Real part of the index per channel, in (0, 1000]; gold (0.143, 0.375, 1.442).
        eta: Vec3,
        /// Imaginary part per channel, in [0, 1000]; gold (3.983, 2.386, 1.603).
        k: Vec3,
        /// GGX width α, in [0, 1]; below [`validate::ALPHA_SMOOTH_MAX`] a perfect mirror.
        #[serde(default)]
        alpha: f32,
        /// Of balls, up to 99, on two white discs of coated resin as those of [`ProceduralTexture::Ball`]; 0 for none.
        #[serde(default)]
        number: u8,
    },
    /// A dielectric boundary, smooth or GGX-rough (Walter et al. 2007), round what fills the body. Only
    /// solids (spheres and boxes) can be of it; other bodies must not reach into them.
    Dielectric {
        /// Index of refraction against air, in [1, 1000]; glass 1.5.
        ior: f32,
        /// GGX width α, in [0, 1]; below [`validate::ALPHA_SMOOTH_MAX`] smooth.
        #[serde(default)]
        alpha: f32,
        /// What fills it; absent: nothing that takes or scatters light.
        #[serde(default)]
        medium: Option<Medium>,
        /// Of balls, up to 99, on two white discs of coated resin as those of [`ProceduralTexture::Ball`]; 0 for none.
        /// Light from within passes the discs.
        #[serde(default)]
        number: u8,
    },
    /// The material of glTF 2.0: a base that is diffuse or, by the share `metallic`, a metal, under a GGX-rough reflection.
    /// `f = base·(1−metallic)/π · (1−F(cos θi))(1−F(cos θo))/(1−F_avg) + D·V·F`, with Schlick's `F`
    /// ([`crate::scalar::metallic_roughness`]): towards the normal it is `base` for metals and that of `ior` for all else.
    MetallicRoughness {
        /// Albedo of what is no metal, reflectance of what is, per channel, in [0, 1].
        base_color: Vec3,
        /// Share of metal, in [0, 1].
        metallic: f32,
        /// Square root of the GGX width α, in [0, 1]; α below [`validate::ALPHA_SMOOTH_MAX`] is drawn as that.
        roughness: f32,
        /// Index of refraction of what is no metal, in [1, 1000]; plastic 1.5.
        #[serde(default = "plastic_ior")]
        ior: f32,
        /// Radiance that the surface emits evenly to both sides, in W·sr⁻¹·m⁻² per channel. Spheres, discs,
        /// rectangles and triangles are lights: they are aimed at by their power ([`crate::compiled::EmissiveSurfaces`]). Boxes
        /// and cones are found by chance alone: bright and small they are noisy.
        #[serde(default)]
        emission: Vec3,
        /// Pictures that multiply these numbers, on meshes with texture coordinates.
        #[serde(default)]
        textures: MaterialTextures,
        /// Where rays pass the surface as if it were not there; other shapes than meshes are opaque.
        #[serde(default)]
        opacity: Opacity,
        /// A clear coat and a sheen over it, the strength of its reflection, and how much of the rest passes.
        #[serde(default)]
        layers: Layers,
    },
}

/// What a coated base looks like.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ProceduralTexture {
    /// A pool ball: its number stands in white circles round the ball's local +x and −x, upright
    /// along z.
    Ball {
        /// Albedo, per channel, in [0, 1].
        albedo: Vec3,
        /// A second colour in a band round the ball's local z axis.
        #[serde(default)]
        stripe: Option<Stripe>,
        /// 1 to 99; 0 for none.
        number: u8,
    },
    /// Wood, with grain along an axis of the world.
    Wood {
        /// Albedo of the light wood between the rings, per channel, in [0, 1].
        light: Vec3,
        /// Albedo of the rings, per channel, in [0, 1].
        dark: Vec3,
        /// The axis of the grain.
        grain: Axis,
        /// Mother-of-pearl diamonds, or none if their spacing is 0; the grain then follows four mitred
        /// rails round the origin.
        #[serde(default)]
        sights: Option<Sights>,
        /// Size of the pattern, above 0: 1 has 17 rings to the metre.
        #[serde(default = "one")]
        scale: f32,
    },
    /// A cue, on a truncated cone whose narrow end is the tip: ferrule, shaft, collar, forearm, wrap and
    /// butt follow at the distances of a cue 1.47 m long. Other shapes have the butt's albedo all over.
    Cue {
        /// Albedo of the shaft, per channel, in [0, 1].
        shaft: Vec3,
        /// Albedo of the butt and the forearm.
        butt: Vec3,
    },
    /// A floor of planks along x.
    Planks {
        /// Albedo of the light wood, per channel, in [0, 1].
        light: Vec3,
        /// Albedo of the rings, per channel, in [0, 1].
        dark: Vec3,
    },
    /// Walls across x or y of bricks in running bond, 215 mm long and 65 mm high with joints of 10 mm.
    Bricks {
        /// Albedo of the lightest brick, per channel, in [0, 1].
        light: Vec3,
        /// Albedo of the darkest brick, per channel, in [0, 1].
        dark: Vec3,
        /// Albedo of the mortar, per channel, in [0, 1].
        mortar: Vec3,
    },
    /// A clock's dial with the numbers 1 to 12 between two with 0 to 9, on a board across x as it is seen along +x. The middles of
    /// the dials are 2.3 radii apart.
    Scoreboard {
        /// Albedo of the dials, per channel, in [0, 1].
        face: Vec3,
        /// Albedo of the numbers and of the board, per channel, in [0, 1].
        ink: Vec3,
        /// Middle of the clock, its y and z in metres.
        center: [f32; 2],
        /// Radius of the dials in metres.
        radius: f32,
    },
}

fn one() -> f32 {
    1.0
}

fn plastic_ior() -> f32 {
    1.5
}

/// The lines and spots on a table's cloth, in a table's own frame: its middle is the origin, its head lies
/// along −x, its cloth at z = 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClothMarks {
    /// Where a line crosses the table, in metres from the middle towards the head; 0 for none.
    pub line_x: f32,
    /// Radius in metres of the D that opens from the line towards the head; 0 for none.
    pub d_radius: f32,
    /// Spots on the long middle line beside the one on the line, as x in metres; one that is given twice
    /// is one.
    pub spots_x: [f32; 3],
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

/// Diamonds in the rails, at the multiples of a spacing from the table's middle lines: three each
/// side of the middle of a long rail, one each side of that of a short one and one there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sights {
    /// From one to the next in metres: an eighth of the table's length; 0 for mitred rails without any.
    pub spacing: f32,
    /// Distance of the short rails' sights from the middle in metres.
    pub end_x: f32,
    /// Distance of the long rails' sights from the middle in metres.
    pub side_y: f32,
}

/// A homogeneous medium that absorbs and scatters evenly into all directions: with albedo 0 tinted
/// glass, with albedo near 1 wax, marble or jade (subsurface scattering by random walk).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Medium {
    /// Extinction coefficient σt per channel in m⁻¹, in [0, 1e6]. In a medium that scatters, above
    /// 0 and no channel more than [`validate::EXTINCTION_RATIO_MAX`] times another.
    pub extinction: Vec3,
    /// Share of the extinction that scatters, per channel, in [0, 1].
    pub albedo: Vec3,
}

/// A band where `|n_ball · z| < half_width`, `n_ball` the normal in the ball's own frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stripe {
    /// Albedo inside the band, per channel, in [0, 1].
    pub albedo: Vec3,
    /// Sine of the band's half angle, in (0, 1]; 0.5 is a band from 60° to 120°.
    pub half_width: f32,
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
