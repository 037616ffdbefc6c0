//! Opacity, clear coat, sheen and transmission of glTF's material.

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// How much of a surface is there: rays of all kinds pass the rest unbent.
///
/// A surface's alpha is that given here times the alphas of its base colour's texture and of its vertex colours. Each ray that
/// meets it draws once whether it is met (Enderton et al., "Stochastic Transparency", I3D 2010), rays to lights too: so light
/// passes in proportion at the price of noise, whatever lies one behind the other. What is there is seen from both sides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Opacity {
    /// Everywhere, whatever its alpha.
    #[default]
    Opaque,
    /// Where its alpha is at least `cutoff`: leaves, fences.
    Mask {
        /// In [0, 1].
        #[serde(default = "one")]
        alpha: f32,
        /// At least 0; above 1 nothing is there.
        #[serde(default = "half")]
        cutoff: f32,
    },
    /// With the probability that its alpha is: smoke, thin cloth.
    Blend {
        /// In [0, 1].
        #[serde(default = "one")]
        alpha: f32,
    },
}

/// A clear coat and a sheen over [`super::Material::MetallicRoughness`], and how strongly that itself reflects and how much it
/// lets pass: glTF's `KHR_materials_clearcoat`, `KHR_materials_sheen`, `KHR_materials_specular` and
/// `KHR_materials_transmission`.
///
/// The coat lies on top. Both dim what is below by what they reflect, in both directions, so that no light is gained. Textures
/// multiply each of the numbers, and the coat may have normals of its own: see [`super::MaterialTextures`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Layers {
    /// Strength of the clear coat, whose index of refraction is 1.5, in [0, 1].
    pub clearcoat: f32,
    /// Square root of the coat's GGX width, in [0, 1].
    pub clearcoat_roughness: f32,
    /// Colour of the sheen per channel, in [0, 1]; the cloth of [`super::Material::Cloth`] has the same one.
    pub sheen: Vec3,
    /// Square root of the sheen's width, in [0, 1]; widths below 0.1 are drawn as that.
    pub sheen_roughness: f32,
    /// Strength of the reflection of what is no metal, in [0, 1].
    pub specular: f32,
    /// Its colour towards the normal, at least 0; where it would reflect more than comes, it reflects all.
    pub specular_color: Vec3,
    /// Share of the light in the base of what is no metal that passes to the other side, coloured by the base colour, rather
    /// than being reflected diffusely, in [0, 1]. Such a surface is a thin wall: it bends no light, and spreads it as far as its
    /// roughness says. Its objects are meshes, discs or rectangles.
    pub transmission: f32,
}

impl Layers {
    /// Nothing on top, and all of the reflection.
    pub const NONE: Self = Self {
        clearcoat: 0.0,
        clearcoat_roughness: 0.0,
        sheen: Vec3::ZERO,
        sheen_roughness: 0.0,
        specular: 1.0,
        specular_color: Vec3::ONE,
        transmission: 0.0,
    };
}

impl Default for Layers {
    fn default() -> Self {
        Self::NONE
    }
}

fn one() -> f32 {
    1.0
}

fn half() -> f32 {
    0.5
}
