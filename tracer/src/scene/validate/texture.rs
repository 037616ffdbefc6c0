//! The rules that image textures keep.

use super::{Check, count, in_range, name};
use crate::SceneError;
use crate::scene::{ImageSource, ImageTexture, Material, Object, Scene, Shape};

/// The most textures in a scene.
pub const TEXTURES_MAX: usize = 1024;
/// The most bytes that all textures of a scene take with their levels of detail, decoded, on each back end:
/// four to a texel and a third on top.
pub const TEXTURE_BYTES_MAX: u64 = 4 << 30;
/// The largest texture coordinate: beyond, rounding to f32 shows in the largest textures.
pub const UV_MAX: f32 = 1e3;

impl Scene {
    /// Bytes that all textures and the environment map take once they are decoded, with their levels of detail, by the sizes in their files.
    ///
    /// # Errors
    /// The texture that is at fault, and why.
    pub fn texture_bytes(&self) -> Result<u64, SceneError> {
        let textures = self.textures.iter().enumerate();
        let bytes = textures.map(|(index, texture)| {
            bytes_of(texture).map_err(|fault| SceneError::Texture {
                index,
                name: texture.name.clone(),
                fault,
            })
        });
        let bytes = bytes.sum::<Result<u64, SceneError>>()?;
        let map = self.environment_map.as_ref();
        let map = map.map_or(Ok(0), |map| map_bytes(&map.image));
        Ok(bytes + map.map_err(SceneError::EnvironmentMap)?)
    }

    pub(super) fn check_environment_map(&self) -> Check {
        let Some(map) = &self.environment_map else {
            return Ok(());
        };
        map_bytes(&map.image).map_err(SceneError::EnvironmentMap)?;
        in_range(
            "the environment map's turn_deg",
            map.turn_deg,
            &(-360.0..=360.0),
        )
    }

    pub(super) fn check_textures(&self) -> Check {
        count("textures", self.textures.len(), TEXTURES_MAX)?;
        self.textures
            .iter()
            .try_for_each(|texture| name(&texture.name))?;
        let bytes = self.texture_bytes()?;
        if bytes > TEXTURE_BYTES_MAX {
            let max = TEXTURE_BYTES_MAX;
            return Err(SceneError::TextureBytes { bytes, max });
        }
        Ok(())
    }

    pub(super) fn check_material_textures(&self, material: &Material) -> Check {
        let count = self.textures.len();
        let mut indices = material.textures().indices();
        match indices.find(|index| *index as usize >= count) {
            Some(index) => Err(SceneError::UnknownTexture { index, count }),
            None => Ok(()),
        }
    }

    /// Whether an object has what its material's textures need.
    pub(super) fn check_textured(&self, object: &Object) -> Check {
        let material = &self.materials[&object.material];
        if material.textures().indices().next().is_none() {
            return Ok(());
        }
        match &object.shape {
            Shape::Mesh(mesh) if !mesh.uvs.is_empty() => Ok(()),
            _ => Err(SceneError::TexturedShape(object.material.clone())),
        }
    }
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

/// Without decoders a size is found once the scene is compiled, which then fails.
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
