//! Materials: how surfaces scatter light, what patterns they show, and what fills bodies.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::{Axis, Layers, MaterialTextures, Opacity};

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
    /// A painted or wooden base under a clear coat, as [`Material::SmoothPlastic`] with the exact internal
    /// reflectance. A rough coat reflects from GGX microfacets, and what they do not reflect passes to the base.
    Coated {
        /// Index of refraction of the coat against air, in [1, 1000]; varnish and phenolic resin
        /// 1.5.
        ior: f32,
        /// GGX width α of the coat, in [0, 1]; below [`super::validate::ALPHA_SMOOTH_MAX`] a perfect mirror.
        #[serde(default)]
        alpha: f32,
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
        /// GGX width α, in [0, 1]; below [`super::validate::ALPHA_SMOOTH_MAX`] a perfect mirror.
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
        /// GGX width α, in [0, 1]; below [`super::validate::ALPHA_SMOOTH_MAX`] smooth.
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
        /// Square root of the GGX width α, in [0, 1]; α below [`super::validate::ALPHA_SMOOTH_MAX`] is drawn as that.
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
    /// Planks along an axis of the world, 130 mm wide: a floor, or the panelling of walls.
    Planks {
        /// Albedo of the light wood, per channel, in [0, 1].
        light: Vec3,
        /// Albedo of the rings, per channel, in [0, 1].
        dark: Vec3,
        /// What they are parallel to: x if it is left out.
        #[serde(default = "along_x")]
        grain: Axis,
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
    /// A framed print on a wall across x or y: a low sun over three ranges of hills. It is 1.5 times as wide as it is high.
    Print {
        /// Albedo of the sky, per channel, in [0, 1].
        sky: Vec3,
        /// Albedo of the nearest hills, per channel, in [0, 1].
        hills: Vec3,
        /// Its middle, metres.
        center: Vec3,
        /// Half its height with the frame, metres, above 0.
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
    /// 0 and no channel more than [`super::validate::EXTINCTION_RATIO_MAX`] times another.
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

impl Material {
    /// A matt surface that reflects this share of light per channel, in [0, 1].
    pub fn diffuse(albedo: impl Into<Vec3>) -> Self {
        let albedo = albedo.into();
        Self::Diffuse { albedo }
    }

    /// A matt grey surface that reflects this share of light, in [0, 1].
    pub const fn grey(albedo: f32) -> Self {
        let albedo = Vec3::splat(albedo);
        Self::Diffuse { albedo }
    }

    /// A glossy surface of this albedo per channel, in [0, 1], under a clear coat.
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

    /// Gold of GGX width `alpha` in [0, 1]: 0 is a mirror, 0.3 satin.
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

    /// What is no metal, of this colour per channel and this roughness, in [0, 1]: the square root of its GGX width.
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

    /// With these textures; other materials than [`Material::MetallicRoughness`] have none.
    #[must_use]
    pub fn textured(mut self, with: MaterialTextures) -> Self {
        if let Self::MetallicRoughness { textures, .. } = &mut self {
            *textures = with;
        }
        self
    }

    /// As much of it there; other materials than [`Material::MetallicRoughness`] are opaque.
    #[must_use]
    pub fn with_opacity(mut self, with: Opacity) -> Self {
        if let Self::MetallicRoughness { opacity, .. } = &mut self {
            *opacity = with;
        }
        self
    }

    /// With these layers; other materials than [`Material::MetallicRoughness`] have none.
    #[must_use]
    pub fn layered(mut self, with: Layers) -> Self {
        if let Self::MetallicRoughness { layers, .. } = &mut self {
            *layers = with;
        }
        self
    }

    /// How much of it is there.
    pub fn opacity(&self) -> Opacity {
        match self {
            Self::MetallicRoughness { opacity, .. } => *opacity,
            _ => Opacity::Opaque,
        }
    }

    /// Whether it has textures.
    pub(crate) fn has_textures(&self) -> bool {
        self.textures().indices().next().is_some()
    }

    /// Whether there is a clear coat over it.
    pub(crate) fn has_clearcoat(&self) -> bool {
        matches!(self, Self::MetallicRoughness { layers, .. } if layers.clearcoat > 0.0)
    }

    /// Whether light passes it without bending.
    pub(crate) fn is_thin_wall(&self) -> bool {
        matches!(self, Self::MetallicRoughness { layers, .. } if layers.transmission > 0.0)
    }

    /// The textures that it has.
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
