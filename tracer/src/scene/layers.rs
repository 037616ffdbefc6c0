//! Opacity, clear coat, sheen and transmission of glTF's metallic-roughness material.

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Coverage of a surface: rays pass through the rest unchanged.
///
/// A surface's alpha is the one given here times those of its base colour's texture and of its
/// vertex colours. Each ray decides randomly whether it hits the surface (Enderton et al.,
/// "Stochastic Transparency", I3D 2010), including shadow rays: so the right fraction of light
/// passes at the price of noise, in any depth order. The covered part is visible from both sides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Opacity {
    /// Fully covered, whatever the alpha.
    #[default]
    Opaque,
    /// Covered where alpha is at least `cutoff`: leaves, fences.
    Mask {
        /// Alpha, in [0, 1].
        #[serde(default = "one")]
        alpha: f32,
        /// Threshold, at least 0; above 1 nothing is covered.
        #[serde(default = "half")]
        cutoff: f32,
    },
    /// Covered with a probability equal to alpha: smoke, thin cloth.
    Blend {
        /// Alpha, in [0, 1].
        #[serde(default = "one")]
        alpha: f32,
    },
}

/// A clear coat and a sheen over [`super::Material::MetallicRoughness`], and the strength of its
/// own reflection and transmission: glTF's `KHR_materials_clearcoat`, `KHR_materials_sheen`,
/// `KHR_materials_specular` and `KHR_materials_transmission`.
///
/// The coat is the top layer. Both layers attenuate what is below by what they reflect, in both
/// directions, so energy is never gained. Each value can be multiplied by a texture, and the coat
/// can have normals of its own: see [`super::MaterialTextures`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Layers {
    /// Strength of the clear coat (of index of refraction 1.5), in [0, 1].
    pub clearcoat: f32,
    /// Square root of the coat's GGX width, in [0, 1].
    pub clearcoat_roughness: f32,
    /// Colour of the sheen per channel, in [0, 1]; the same sheen as that of
    /// [`super::Material::Cloth`].
    pub sheen: Vec3,
    /// Square root of the sheen's width, in [0, 1]; widths below 0.1 are rendered as 0.1.
    pub sheen_roughness: f32,
    /// Strength of the specular reflection of non-metals, in [0, 1].
    pub specular: f32,
    /// Colour of that reflection at normal incidence, at least 0; reflectances above 1 are clamped.
    pub specular_color: Vec3,
    /// Fraction of the light in the base of non-metals that is transmitted to the other side,
    /// tinted by the base colour, rather than reflected diffusely, in [0, 1]. Such a surface is a
    /// thin wall: it does not refract light, and scatters it according to its roughness. Allowed
    /// for meshes, discs and rectangles.
    pub transmission: f32,
}

impl Layers {
    /// No layers, full reflection, no transmission.
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
