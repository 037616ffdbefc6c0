//! Textures of glTF's layers and specular reflection, stored apart from the base textures, as few scenes
//! have any.

use bytemuck::{Pod, Zeroable};

use crate::scene::Material;

/// Textures of a material's sheen, specular reflection and clear coat, as indices into
/// [`super::CompiledTextures::images`].
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct LayerTextureData {
    /// See [`crate::MaterialTextures::sheen`].
    pub sheen: u32,
    /// See [`crate::MaterialTextures::sheen_roughness`]; index of a view with alpha as colour.
    pub sheen_roughness: u32,
    /// See [`crate::MaterialTextures::specular`]; index of a view with alpha as colour.
    pub specular: u32,
    /// See [`crate::MaterialTextures::specular_color`].
    pub specular_color: u32,
    /// See [`crate::MaterialTextures::clearcoat_normal`].
    pub clearcoat_normal: u32,
    /// See [`crate::MaterialTextures::clearcoat_normal_scale`].
    pub clearcoat_normal_scale: f32,
    /// 1 if its clear coat has normals other than its base's, else 0.
    pub has_coat_normal: u32,
}

impl LayerTextureData {
    /// Index that stands for no texture.
    pub const NONE: u32 = u32::MAX;

    /// Whether a texture scales the sheen or the specular reflection.
    pub(crate) fn has_factors(&self) -> bool {
        let textures = [
            self.sheen,
            self.sheen_roughness,
            self.specular,
            self.specular_color,
        ];
        textures != [Self::NONE; 4]
    }

    /// Whether the material has any of these.
    pub(super) fn is_some(&self) -> bool {
        self.has_factors() || self.has_coat_normal == 1
    }

    /// Textures of a material; `alpha_of` returns the view of a texture's alpha.
    pub(super) fn new(material: &Material, mut alpha_of: impl FnMut(u32) -> u32) -> Self {
        let textures = material.textures();
        let index = |texture: Option<u32>| texture.unwrap_or(Self::NONE);
        let mut alpha = |texture: Option<u32>| texture.map_or(Self::NONE, &mut alpha_of);
        let coat = (textures.clearcoat_normal, textures.clearcoat_normal_scale);
        let has_coat_normal = material.has_clearcoat()
            && (textures.normal, textures.normal_scale) != coat
            && textures.normal.or(coat.0).is_some();
        Self {
            sheen: index(textures.sheen),
            sheen_roughness: alpha(textures.sheen_roughness),
            specular: alpha(textures.specular),
            specular_color: index(textures.specular_color),
            clearcoat_normal: index(coat.0),
            clearcoat_normal_scale: coat.1,
            has_coat_normal: u32::from(has_coat_normal),
        }
    }
}
