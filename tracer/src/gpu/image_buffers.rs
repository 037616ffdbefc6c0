//! The image textures and environment maps of scenes on the device: uploaded once, not with each picture.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use bytemuck::cast_slice;

use crate::compiled::{
    CompiledEnvironment, CompiledTextures, LayerTextureData, MaterialTextureData, SRGB_LINEAR,
    TextureData,
};
use crate::gpu::device::Device;
use crate::{CompiledScene, Error};

/// Buffers of the scenes that were traced last.
#[derive(Default)]
pub(crate) struct ImageBuffers {
    textures: BufferCache<u32>,
    environment_maps: BufferCache<f32>,
}

impl ImageBuffers {
    /// The textures of a scene; none without any.
    ///
    /// # Errors
    /// [`Error::Device`] if they do not fit.
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
        self.textures
            .get_or_create(&textures.texels, created)
            .map(Some)
    }

    /// The environment map of a scene; none without.
    ///
    /// # Errors
    /// [`Error::Device`] if it does not fit.
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
        (self.environment_maps.get_or_create(&map.numbers, created)).map(Some)
    }
}

/// Buffers by what they were made of.
struct BufferCache<T> {
    kept: Mutex<Vec<CachedBuffer<T>>>,
}

struct CachedBuffer<T> {
    /// Nobody changes it while this points at it.
    source: Weak<Vec<T>>,
    buffer: Arc<wgpu::Buffer>,
}

impl<T> Default for BufferCache<T> {
    fn default() -> Self {
        let kept = Mutex::default();
        Self { kept }
    }
}

impl<T> BufferCache<T> {
    /// Buffers kept: a node keeps as many scenes.
    const KEPT_MAX: usize = 4;

    fn get_or_create(
        &self,
        source: &Arc<Vec<T>>,
        create: impl FnOnce() -> Result<wgpu::Buffer, Error>,
    ) -> Result<Arc<wgpu::Buffer>, Error> {
        let source = Arc::downgrade(source);
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let found = (kept().iter().find(|kept| kept.source.ptr_eq(&source)))
            .map(|kept| Arc::clone(&kept.buffer));
        if let Some(found) = found {
            return Ok(found);
        }
        let buffer = Arc::new(create()?);
        let mut kept = kept();
        kept.retain(|kept| kept.source.strong_count() > 0);
        if kept.len() >= Self::KEPT_MAX {
            kept.remove(0);
        }
        kept.push(CachedBuffer {
            source,
            buffer: Arc::clone(&buffer),
        });
        Ok(buffer)
    }
}

/// The kernel's `TextureMemory`.
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

/// The kernel's `EnvironmentMemory`.
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

/// A buffer of parts, one behind another.
fn create(device: &Device, what: &str, parts: &[&[u8]]) -> Result<wgpu::Buffer, Error> {
    let limits = device.device.limits();
    let bytes_max = (limits.max_storage_buffer_binding_size).min(limits.max_buffer_size);
    let bytes: u64 = parts.iter().map(|part| part.len() as u64).sum();
    if bytes > bytes_max {
        return Err(device.error(format!(
            "{what} {bytes} bytes, but a buffer holds {bytes_max}: trace the scene on the CPU"
        )));
    }
    device.guarded(|wgpu| {
        let buffer = wgpu.create_buffer(&wgpu::BufferDescriptor {
            label: Some("images"),
            size: bytes,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut place = 0;
        for part in parts {
            device.queue.write_buffer(&buffer, place, part);
            place += part.len() as u64;
        }
        buffer
    })
}
