//! Materials: how surfaces scatter light, their patterns, and the media that fill bodies.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::{Axis, Layers, MaterialTextures, Opacity};

/// How a surface scatters light.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Material {
    /// Lambertian reflection: `f = albedo / π`.
    Diffuse {
        /// Fraction of light that is reflected, per channel, in [0, 1].
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
        /// Fraction `F_dr,int` of the light from the base that the coat reflects back, in [0,
        /// 0.99]. If absent, the exact integral for `ior`, which conserves energy; given to match
        /// renderers that use a fit.
        #[serde(default)]
        internal_reflectance: Option<f32>,
        /// A second colour in a band around the ball's local z axis.
        #[serde(default)]
        stripe: Option<Stripe>,
    },
    /// A painted or wooden base under a clear coat, as [`Material::SmoothPlastic`] with the exact
    /// internal reflectance. A rough coat reflects from GGX microfacets, and the light that it does
    /// not reflect reaches the base.
    Coated {
        /// Index of refraction of the coat against air, in [1, 1000]; varnish and phenolic resin
        /// 1.5.
        ior: f32,
        /// GGX width α of the coat, in [0, 1]; below [`super::validate::ALPHA_SMOOTH_MAX`] a perfect mirror.
        #[serde(default)]
        alpha: f32,
        /// Appearance of the base.
        #[serde(alias = "paint")]
        texture: ProceduralTexture,
    },
    /// Napped cloth: a Lambertian base and the sheen of upright fibres after Estevez and Kulla,
    /// "Production Friendly Microfacet Sheen BRDF" (SIGGRAPH 2017 course), with the shadowing of
    /// Neubelt and Pettineo, "Crafting a Next-Gen Material Pipeline for The Order: 1886" (2013).
    /// The base is attenuated by the maximum reflectance of the sheen, so that energy is never
    /// gained.
    Cloth {
        /// Albedo of the base, per channel, in [0, 1].
        albedo: Vec3,
        /// Strength of the sheen per channel, in [0, 1].
        sheen: Vec3,
        /// Width of the sheen, in [0.1, 1]: a narrow one is visible at grazing angles only.
        sheen_roughness: f32,
        /// Nap, chalk and wear of a table's cloth with its lines and spots; if absent, the cloth is
        /// uniform.
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
        /// GGX width α, in [0, 1]; below [`super::validate::ALPHA_SMOOTH_MAX`] a perfect mirror.
        #[serde(default)]
        alpha: f32,
        /// Number of a ball, up to 99, on two white discs of coated resin like those of
        /// [`ProceduralTexture::Ball`]; 0 for none.
        #[serde(default)]
        number: u8,
    },
    /// A dielectric boundary, smooth or GGX-rough (Walter et al. 2007), around the medium inside.
    /// Only solids (spheres, boxes and closed meshes) can have it; other bodies must not intersect
    /// them.
    Dielectric {
        /// Index of refraction against air, in [1, 1000]; glass 1.5.
        ior: f32,
        /// GGX width α, in [0, 1]; below [`super::validate::ALPHA_SMOOTH_MAX`] smooth.
        #[serde(default)]
        alpha: f32,
        /// Medium inside; if absent, one that neither absorbs nor scatters light.
        #[serde(default)]
        medium: Option<Medium>,
        /// Number of a ball, up to 99, on two white discs of coated resin like those of
        /// [`ProceduralTexture::Ball`]; 0 for none. Light from inside passes through the discs.
        #[serde(default)]
        number: u8,
    },
    /// The metallic-roughness material of glTF 2.0: a base, which is diffuse or, by the fraction
    /// `metallic`, a metal, under a GGX-rough reflection.
    /// `f = base·(1−metallic)/π · (1−F(cos θi))(1−F(cos θo))/(1−F_avg) + D·V·F`, with Schlick's `F`
    /// ([`crate::scalar::metallic_roughness`]), which at normal incidence is `base` for metals and
    /// given by `ior` for non-metals.
    MetallicRoughness {
        /// Albedo of non-metals and reflectance of metals, per channel, in [0, 1].
        base_color: Vec3,
        /// Fraction of metal, in [0, 1].
        metallic: f32,
        /// Square root of the GGX width α, in [0, 1]; an α below
        /// [`super::validate::ALPHA_SMOOTH_MAX`] is rendered as that.
        roughness: f32,
        /// Index of refraction of non-metals, in [1, 1000]; plastic 1.5.
        #[serde(default = "plastic_ior")]
        ior: f32,
        /// Radiance emitted uniformly on both sides, in W·sr⁻¹·m⁻² per channel. Spheres, discs,
        /// rectangles and triangles are sampled as lights in proportion to their power
        /// ([`crate::compiled::EmissiveSurfaces`]). Boxes and cones are only found by chance, so
        /// bright and small ones are noisy.
        #[serde(default)]
        emission: Vec3,
        /// Textures that multiply these values, on meshes with texture coordinates.
        #[serde(default)]
        textures: MaterialTextures,
        /// Partial coverage of meshes; other shapes are opaque.
        #[serde(default)]
        opacity: Opacity,
        /// Clear coat, sheen, strength of the reflection, and transmission.
        #[serde(default)]
        layers: Layers,
    },
}

/// Procedural appearance of a coated base.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ProceduralTexture {
    /// A pool ball with its number in white circles around the ball's local +x and −x axes, upright
    /// along z.
    Ball {
        /// Albedo, per channel, in [0, 1].
        albedo: Vec3,
        /// A second colour in a band around the ball's local z axis.
        #[serde(default)]
        stripe: Option<Stripe>,
        /// Number, 1 to 99; 0 for none.
        number: u8,
    },
    /// Wood with its grain along an axis of the world.
    Wood {
        /// Albedo of the wood between the rings, per channel, in [0, 1].
        light: Vec3,
        /// Albedo of the rings, per channel, in [0, 1].
        dark: Vec3,
        /// Axis of the grain.
        grain: Axis,
        /// Mother-of-pearl diamonds (none if their spacing is 0); the grain then follows four
        /// mitred rails around the origin.
        #[serde(default)]
        sights: Option<Sights>,
        /// Spatial frequency of the pattern, above 0: at 1 there are 17 rings per metre.
        #[serde(default = "one")]
        scale: f32,
    },
    /// A cue, on a truncated cone whose narrow end is the tip. Ferrule, shaft, collar, forearm,
    /// wrap and butt follow at the distances of a cue of 1.47 m. Other shapes have the butt's
    /// albedo everywhere.
    Cue {
        /// Albedo of the shaft, per channel, in [0, 1].
        shaft: Vec3,
        /// Albedo of the butt and the forearm.
        butt: Vec3,
    },
    /// Planks of 130 mm width along an axis of the world: a floor, or the panelling of walls.
    Planks {
        /// Albedo of the light wood, per channel, in [0, 1].
        light: Vec3,
        /// Albedo of the rings, per channel, in [0, 1].
        dark: Vec3,
        /// Axis along which they run; x by default.
        #[serde(default = "along_x")]
        grain: Axis,
    },
    /// Brick walls perpendicular to x or y, in running bond: bricks of 215 mm × 65 mm with joints
    /// of 10 mm.
    Bricks {
        /// Albedo of the lightest brick, per channel, in [0, 1].
        light: Vec3,
        /// Albedo of the darkest brick, per channel, in [0, 1].
        dark: Vec3,
        /// Albedo of the mortar, per channel, in [0, 1].
        mortar: Vec3,
    },
    /// A clock's dial with the numbers 1 to 12 between two dials with 0 to 9, on a board
    /// perpendicular to x, as seen along +x. The dials' centres are 2.3 radii apart.
    Scoreboard {
        /// Albedo of the dials, per channel, in [0, 1].
        face: Vec3,
        /// Albedo of the numbers and of the board, per channel, in [0, 1].
        ink: Vec3,
        /// Centre of the clock: y and z in metres.
        center: [f32; 2],
        /// Radius of the dials in metres.
        radius: f32,
    },
    /// A framed print on a wall perpendicular to x or y: a low sun over three ranges of hills. Its
    /// width is 1.5 times its height.
    Print {
        /// Albedo of the sky, per channel, in [0, 1].
        sky: Vec3,
        /// Albedo of the nearest hills, per channel, in [0, 1].
        hills: Vec3,
        /// Centre in metres.
        center: Vec3,
        /// Half of the height including the frame, in metres, above 0.
        half_height: f32,
    },
}

fn one() -> f32 {
    1.0
}

fn along_x() -> Axis {
    Axis::X
}

fn plastic_ior() -> f32 {
    1.5
}

/// The lines and spots on a table's cloth, in the table's frame: its centre is the origin, its head
/// is at −x, its cloth at z = 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClothMarks {
    /// Distance in metres from the centre towards the head at which a line crosses the table; 0 for
    /// none.
    pub line_x: f32,
    /// Radius in metres of the D that opens from the line towards the head; 0 for none.
    pub d_radius: f32,
    /// x in metres of spots on the long axis, besides the one on the line; equal values are one spot.
    pub spots_x: [f32; 3],
}

/// Diamonds in the rails, at multiples of a spacing from the table's axes: on a long rail three on
/// each side of the middle, on a short one the middle and one on each side.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sights {
    /// Distance in metres from one to the next, an eighth of the table's length; 0 for mitred rails
    /// without sights.
    pub spacing: f32,
    /// Distance in metres of the short rails' sights from the centre.
    pub end_x: f32,
    /// Distance in metres of the long rails' sights from the centre.
    pub side_y: f32,
}

/// A homogeneous medium that absorbs light and scatters it isotropically: tinted glass if the
/// albedo is 0; wax, marble or jade if it is near 1 (subsurface scattering by random walk).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Medium {
    /// Extinction coefficient σt per channel in m⁻¹, in [0, 1e6]. In a scattering medium it must be
    /// above 0, and in no channel more than [`super::validate::EXTINCTION_RATIO_MAX`] times that of
    /// another.
    pub extinction: Vec3,
    /// Single-scattering albedo per channel, in [0, 1].
    pub albedo: Vec3,
}

/// A band where `|n_ball · z| < half_width`, with `n_ball` the normal in the ball's frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stripe {
    /// Albedo inside the band, per channel, in [0, 1].
    pub albedo: Vec3,
    /// Sine of the band's half angle, in (0, 1]; 0.5 is a band from 60° to 120°.
    pub half_width: f32,
}

impl Material {
    /// A diffuse surface with this albedo per channel, in [0, 1].
    pub fn diffuse(albedo: impl Into<Vec3>) -> Self {
        let albedo = albedo.into();
        Self::Diffuse { albedo }
    }

    /// A diffuse grey surface with this albedo, in [0, 1].
    pub const fn grey(albedo: f32) -> Self {
        let albedo = Vec3::splat(albedo);
        Self::Diffuse { albedo }
    }

    /// A base with this albedo per channel, in [0, 1], under a smooth clear coat.
    pub fn plastic(albedo: impl Into<Vec3>) -> Self {
        Self::SmoothPlastic {
            albedo: albedo.into(),
            ior: 1.5,
            internal_reflectance: None,
            stripe: None,
        }
    }

    /// Clear glass.
    pub const fn glass() -> Self {
        Self::Dielectric {
            ior: 1.5,
            alpha: 0.0,
            medium: None,
            number: 0,
        }
    }

    /// Gold of GGX width `alpha` in [0, 1]: 0 is a mirror, 0.3 is satin.
    pub const fn gold(alpha: f32) -> Self {
        Self::Conductor {
            eta: Vec3::new(0.143, 0.375, 1.442),
            k: Vec3::new(3.983, 2.386, 1.603),
            alpha,
            number: 0,
        }
    }

    /// Steel of GGX width `alpha` in [0, 1].
    pub const fn steel(alpha: f32) -> Self {
        Self::Conductor {
            eta: Vec3::new(2.76, 2.54, 2.27),
            k: Vec3::new(3.84, 3.43, 3.04),
            alpha,
            number: 0,
        }
    }

    /// A non-metal of this colour per channel and this roughness (square root of the GGX width),
    /// both in [0, 1].
    pub fn rough(base_color: impl Into<Vec3>, roughness: f32) -> Self {
        Self::MetallicRoughness {
            base_color: base_color.into(),
            metallic: 0.0,
            roughness,
            ior: 1.5,
            emission: Vec3::ZERO,
            textures: MaterialTextures::NONE,
            opacity: Opacity::Opaque,
            layers: Layers::NONE,
        }
    }

    /// Sets the textures; only [`Material::MetallicRoughness`] has any.
    #[must_use]
    pub fn textured(mut self, with: MaterialTextures) -> Self {
        if let Self::MetallicRoughness { textures, .. } = &mut self {
            *textures = with;
        }
        self
    }

    /// Sets the opacity; only [`Material::MetallicRoughness`] can be other than opaque.
    #[must_use]
    pub fn with_opacity(mut self, with: Opacity) -> Self {
        if let Self::MetallicRoughness { opacity, .. } = &mut self {
            *opacity = with;
        }
        self
    }

    /// Sets the layers; only [`Material::MetallicRoughness`] has any.
    #[must_use]
    pub fn layered(mut self, with: Layers) -> Self {
        if let Self::MetallicRoughness { layers, .. } = &mut self {
            *layers = with;
        }
        self
    }

    /// The opacity.
    pub fn opacity(&self) -> Opacity {
        match self {
            Self::MetallicRoughness { opacity, .. } => *opacity,
            _ => Opacity::Opaque,
        }
    }

    /// Whether the material has textures.
    pub(crate) fn has_textures(&self) -> bool {
        self.textures().indices().next().is_some()
    }

    /// Whether the material has a clear coat.
    pub(crate) fn has_clearcoat(&self) -> bool {
        matches!(self, Self::MetallicRoughness { layers, .. } if layers.clearcoat > 0.0)
    }

    /// Whether the material is a thin wall, which transmits light without refraction.
    pub(crate) fn is_thin_wall(&self) -> bool {
        matches!(self, Self::MetallicRoughness { layers, .. } if layers.transmission > 0.0)
    }

    /// The textures.
    pub fn textures(&self) -> MaterialTextures {
        match self {
            Self::MetallicRoughness { textures, .. } => *textures,
            _ => MaterialTextures::default(),
        }
    }

    /// Varnished wood with its grain along an axis.
    pub const fn wood(grain: Axis) -> Self {
        Self::Coated {
            ior: 1.5,
            alpha: 0.0,
            texture: ProceduralTexture::Wood {
                light: Vec3::new(0.42, 0.24, 0.11),
                dark: Vec3::new(0.17, 0.08, 0.03),
                grain,
                sights: None,
                scale: 1.0,
            },
        }
    }
}
