//! Validation of opacity and of the layers of glTF's material.

use super::{Check, IOR, SHARE, channels, check_albedo, in_range};
use crate::scene::{Layers, MaterialTextures, Opacity};

/// Largest absolute scale of a normal map.
pub const NORMAL_SCALE_MAX: f32 = 1e3;
/// Largest alpha cutoff; above 1 nothing is covered.
pub const CUTOFF_MAX: f32 = 1e3;

pub(super) fn check_opacity(opacity: Opacity) -> Check {
    match opacity {
        Opacity::Opaque => Ok(()),
        Opacity::Mask { alpha, cutoff } => {
            in_range("the alpha of its opacity", alpha, SHARE)?;
            in_range("the cutoff of its opacity", cutoff, 0.0..=CUTOFF_MAX)
        }
        Opacity::Blend { alpha } => in_range("the alpha of its opacity", alpha, SHARE),
    }
}

pub(super) fn check_normal_scales(textures: &MaterialTextures) -> Check {
    let scales = -NORMAL_SCALE_MAX..=NORMAL_SCALE_MAX;
    let (base, coat) = (textures.normal_scale, textures.clearcoat_normal_scale);
    in_range("the normal_scale of its textures", base, scales.clone())?;
    in_range("the clearcoat_normal_scale of its textures", coat, scales)
}

pub(super) fn check_layers(layers: &Layers) -> Check {
    let (coat, coat_roughness) = (layers.clearcoat, layers.clearcoat_roughness);
    in_range("its clearcoat", coat, SHARE)?;
    in_range("its clearcoat_roughness", coat_roughness, SHARE)?;
    check_albedo("its sheen", layers.sheen)?;
    in_range("its sheen_roughness", layers.sheen_roughness, SHARE)?;
    in_range("its specular", layers.specular, SHARE)?;
    in_range("its transmission", layers.transmission, SHARE)?;
    channels("its specular_color", layers.specular_color, *IOR.end())
}
