//! Validation of image textures and environment maps.

use super::{Check, TEXTURED, count, in_range, name, refuse_material, require};
use crate::SceneError;
use crate::scene::{ImageSource, ImageTexture, Material, Object, Scene, Shape};

/// Maximum number of textures in a scene.
pub const TEXTURES_MAX: usize = 1024;
/// Maximum size in bytes of all decoded textures of a scene with their mip levels, in each tracer:
/// four bytes per texel plus a third.
pub const TEXTURE_BYTES_MAX: u64 = 4 << 30;
/// Largest absolute texture coordinate; beyond it, the rounding of f32 would be visible in the
/// largest textures.
pub const UV_MAX: f32 = 1e3;

impl Scene {
    /// Size in bytes of all textures with their mip levels and of the environment map after
    /// decoding, from the dimensions in their files.
    ///
    /// # Errors
    /// The texture at fault, and the reason.
    pub fn texture_bytes(&self) -> Result<u64, SceneError> {
        let mut bytes = 0;
        for (index, texture) in self.textures.iter().enumerate() {
            bytes += bytes_of(texture).map_err(|fault| texture.fault(index, fault))?;
        }
        if let Some(map) = &self.environment_map {
            bytes += map_bytes(&map.image).map_err(map_fault)?;
        }
        Ok(bytes)
    }

    pub(super) fn check_environment_map(&self) -> Check {
        let Some(map) = &self.environment_map else {
            return Ok(());
        };
        map_bytes(&map.image).map_err(map_fault)?;
        let turn = map.turn_deg;
        in_range("the environment map's turn_deg", turn, -360.0..=360.0)
    }

    pub(super) fn check_textures(&self) -> Check {
        count("textures", self.textures.len(), TEXTURES_MAX)?;
        self.textures
            .iter()
            .try_for_each(|texture| name(&texture.name))?;
        let bytes = self.texture_bytes()?;
        require(bytes <= TEXTURE_BYTES_MAX, || {
            SceneError::rule(format!(
                "its textures take {bytes} bytes once decoded: at most {TEXTURE_BYTES_MAX} are allowed"
            ))
        })
    }

    pub(super) fn check_material_textures(&self, material: &Material) -> Check {
        let count = self.textures.len();
        let mut indices = material.textures().indices();
        match indices.find(|index| *index as usize >= count) {
            Some(index) => Err(SceneError::rule(format!(
                "its texture {index} is not among the scene's {count}"
            ))),
            None => Ok(()),
        }
    }

    /// Checks that an object has texture coordinates if its material has textures.
    pub(super) fn check_textured(&self, object: &Object) -> Check {
        let is_mapped = matches!(&object.shape, Shape::Mesh(mesh) if !mesh.uvs.is_empty());
        match self.materials[&object.material].has_textures() && !is_mapped {
            true => refuse_material(&object.material, TEXTURED),
            false => Ok(()),
        }
    }
}

impl ImageTexture {
    pub(crate) fn fault(&self, index: usize, why: String) -> SceneError {
        SceneError::rule(why).of(format!("texture {index} `{}`", self.name))
    }
}

/// A fault of the environment map's file.
pub(crate) fn map_fault(why: String) -> SceneError {
    SceneError::rule(why).of("the environment map")
}

#[cfg(feature = "image-io")]
fn bytes_of(texture: &ImageTexture) -> Result<u64, String> {
    let size = crate::texture_file::size(file(&texture.image)?)?;
    Ok(4 * crate::scene::texels_with_levels(size))
}

#[cfg(feature = "image-io")]
fn map_bytes(image: &ImageSource) -> Result<u64, String> {
    let size = crate::environment_file::size(file(image)?)?;
    Ok(crate::scene::environment_bytes(size.width, size.height))
}

/// Without decoders the size is unknown until the scene is compiled, which then fails.
#[cfg(not(feature = "image-io"))]
fn bytes_of(texture: &ImageTexture) -> Result<u64, String> {
    file(&texture.image).map(|_| 0)
}

#[cfg(not(feature = "image-io"))]
fn map_bytes(image: &ImageSource) -> Result<u64, String> {
    file(image).map(|_| 0)
}

fn file(image: &ImageSource) -> Result<&[u8], String> {
    match image {
        ImageSource::Encoded(bytes) => Ok(&bytes.0),
        ImageSource::File(file) => Err(format!(
            "its file `{file}` is read only by `Scene::load`: open the scene from a file beside it"
        )),
    }
}
