//! The image textures and environment maps of scenes on the device, uploaded once rather than with
//! each frame.

use std::sync::Arc;

use bytemuck::cast_slice;

use crate::compiled::{
    CompiledEnvironment, CompiledTextures, LayerTextureData, MaterialTextureData, TextureData,
};
use crate::gpu::buffer_cache::{BufferCache, buffer_bytes_max, upload};
use crate::gpu::device::Device;
use crate::tonemap::SRGB_LINEAR;
use crate::{CompiledScene, Error};

/// Cached image buffers of the most recently traced scenes.
#[derive(Default)]
pub(crate) struct ImageBuffers {
    textures: BufferCache<u32>,
    environment_maps: BufferCache<f32>,
}

impl ImageBuffers {
    /// The texture buffer of a scene; `None` without textures.
    ///
    /// # Errors
    /// [`Error::Device`] if they do not fit into a buffer.
    pub(crate) fn textures(
        &self,
        device: &Device,
        scene: &CompiledScene,
    ) -> Result<Option<Arc<wgpu::Buffer>>, Error> {
        let textures = &scene.textures;
        if textures.is_empty() {
            return Ok(None);
        }
        let created = || create_textures(device, textures);
        let buffer = (self.textures).get_or_create(&textures.texels, false, created);
        buffer.map(Some)
    }

    /// The environment-map buffer of a scene; `None` without one.
    ///
    /// # Errors
    /// [`Error::Device`] if it does not fit into a buffer.
    pub(crate) fn environment_map(
        &self,
        device: &Device,
        scene: &CompiledScene,
    ) -> Result<Option<Arc<wgpu::Buffer>>, Error> {
        let map = &scene.environment_map;
        if map.is_empty() {
            return Ok(None);
        }
        let created = || create_environment_map(device, map);
        let buffer = (self.environment_maps).get_or_create(&map.numbers, false, created);
        buffer.map(Some)
    }
}

/// A buffer with the contents of the kernel's `TextureMemory`.
fn create_textures(device: &Device, textures: &CompiledTextures) -> Result<wgpu::Buffer, Error> {
    let count = textures.images.len();
    let what = format!("{count} textures take");
    create(
        device,
        &what,
        &[
            cast_slice::<TextureData, u8>(&textures.images),
            cast_slice::<MaterialTextureData, u8>(&textures.materials),
            cast_slice::<LayerTextureData, u8>(&textures.layers),
            cast_slice::<u32, u8>(&textures.transmission),
            cast_slice::<f32, u8>(&SRGB_LINEAR[..]),
            cast_slice::<u32, u8>(&textures.texels),
        ],
    )
}

/// A buffer with the contents of the kernel's `EnvironmentMemory`.
fn create_environment_map(
    device: &Device,
    map: &CompiledEnvironment,
) -> Result<wgpu::Buffer, Error> {
    let what = format!("an environment map of {}x{} takes", map.width, map.height);
    let header = [map.turn, map.probability];
    create(
        device,
        &what,
        &[cast_slice(&header), cast_slice(&map.numbers)],
    )
}

fn create(device: &Device, what: &str, parts: &[&[u8]]) -> Result<wgpu::Buffer, Error> {
    let bytes: u64 = parts.iter().map(|part| part.len() as u64).sum();
    let bytes_max = buffer_bytes_max(device);
    if bytes > bytes_max {
        return Err(device.error(format!(
            "{what} {bytes} bytes, but a buffer holds {bytes_max}: trace the scene on the CPU"
        )));
    }
    upload(device, "images", parts)
}
