//! Alpha modes, clear coats, sheens and transmission of a glTF file's materials.

use glam::Vec3;
use gltf_json::material::{AlphaMode, NormalTexture};
use gltf_json::texture::Info;
use gltf_json::validation::Checked;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::Refusal;
use crate::scene::{Layers, Opacity};

/// `KHR_materials_clearcoat`, which `gltf-json` does not provide.
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Clearcoat {
    clearcoat_factor: f32,
    clearcoat_roughness_factor: f32,
    /// The factor is multiplied by the red channel.
    pub(super) clearcoat_texture: Option<Info>,
    /// The roughness is multiplied by the green channel.
    pub(super) clearcoat_roughness_texture: Option<Info>,
    pub(super) clearcoat_normal_texture: Option<NormalTexture>,
}

/// `KHR_materials_sheen`, which `gltf-json` does not provide.
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct FabricSheen {
    sheen_color_factor: [f32; 3],
    sheen_roughness_factor: f32,
    /// The colour is multiplied by the red, green and blue channels.
    pub(super) sheen_color_texture: Option<Info>,
    /// The roughness is multiplied by the alpha channel.
    pub(super) sheen_roughness_texture: Option<Info>,
}

/// The alpha mode of a material.
pub(super) fn opacity(from: &gltf_json::Material, what: &str) -> Result<Opacity, Refusal> {
    let [.., alpha] = from.pbr_metallic_roughness.base_color_factor.0;
    let cutoff = from.alpha_cutoff.as_ref().map_or(0.5, |cutoff| cutoff.0);
    match from.alpha_mode {
        Checked::Valid(AlphaMode::Opaque) => Ok(Opacity::Opaque),
        Checked::Valid(AlphaMode::Mask) => Ok(Opacity::Mask { alpha, cutoff }),
        Checked::Valid(AlphaMode::Blend) => Ok(Opacity::Blend { alpha }),
        Checked::Invalid => Err(format!(
            "{what}: its alphaMode must be OPAQUE, MASK or BLEND"
        )),
    }
}

/// The layers of a material, and its clear coat and sheen extensions, for their textures.
pub(super) fn layers(
    from: &gltf_json::Material,
    what: &str,
) -> Result<(Layers, Clearcoat, FabricSheen), Refusal> {
    let coat: Clearcoat = extension(from, "KHR_materials_clearcoat", what)?;
    let sheen: FabricSheen = extension(from, "KHR_materials_sheen", what)?;
    let mut layers = Layers {
        clearcoat: coat.clearcoat_factor,
        clearcoat_roughness: coat.clearcoat_roughness_factor,
        sheen: Vec3::from(sheen.sheen_color_factor),
        sheen_roughness: sheen.sheen_roughness_factor,
        ..Layers::NONE
    };
    let extensions = from.extensions.as_ref();
    if let Some(specular) = extensions.and_then(|all| all.specular.as_ref()) {
        layers.specular = specular.specular_factor.0;
        layers.specular_color = Vec3::from(specular.specular_color_factor.0);
    }
    if let Some(transmission) = extensions.and_then(|all| all.transmission.as_ref()) {
        layers.transmission = transmission.transmission_factor.0;
    }
    Ok((layers, coat, sheen))
}

/// The values of an extension, or its defaults if the material does not have it.
fn extension<T: Default + DeserializeOwned>(
    from: &gltf_json::Material,
    name: &str,
    what: &str,
) -> Result<T, Refusal> {
    let extensions = from.extensions.as_ref();
    let Some(value) = extensions.and_then(|all| all.others.get(name)) else {
        return Ok(T::default());
    };
    T::deserialize(value).map_err(|error| format!("{what}: its {name}: {error}"))
}
