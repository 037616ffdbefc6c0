//! The triangles of scenes on the device, uploaded once rather than with each frame.

use std::sync::Arc;

use crate::compiled::{ShapeKind, TriangleData};
use crate::gpu::buffer_cache::{BufferCache, buffer_bytes_max, upload};
use crate::gpu::device::Device;
use crate::gpu::features::Features;
use crate::gpu::image_buffers::ImageBuffers;
use crate::gpu::layout::{
    ENVIRONMENT_BINDING, MESH_BINDING, TEXTURE_BINDING, mesh_bytes, mesh_bytes_len, scene_bytes,
};
use crate::{CompiledScene, Error, ImageSize};

/// The scene data that a frame's kernels read.
pub(crate) struct SceneUpload {
    /// See [`scene_bytes`].
    pub(crate) bytes: Vec<u8>,
    pub(crate) optional: OptionalBuffers,
}

/// Buffers that not every scene has, with their bindings: triangles (see [`mesh_bytes`]), image
/// textures and the environment map.
pub(crate) type OptionalBuffers = [(u32, Option<Arc<wgpu::Buffer>>); 3];

/// Cached buffers of the most recently traced scenes.
#[derive(Default)]
pub(crate) struct MeshBuffers {
    meshes: BufferCache<TriangleData>,
    images: ImageBuffers,
}

impl MeshBuffers {
    /// The data to upload or bind for a frame of `scene`.
    ///
    /// # Errors
    /// [`Error::InvalidScene`] as for [`scene_bytes`]; [`Error::Device`] if triangles or images do
    /// not fit into a buffer.
    pub(crate) fn upload(
        &self,
        device: &Device,
        scene: &CompiledScene,
        size: ImageSize,
    ) -> Result<SceneUpload, Error> {
        Ok(SceneUpload {
            bytes: scene_bytes(scene, size)?,
            optional: [
                (MESH_BINDING, self.of(device, scene)?),
                (TEXTURE_BINDING, self.images.textures(device, scene)?),
                (
                    ENVIRONMENT_BINDING,
                    self.images.environment_map(device, scene)?,
                ),
            ],
        })
    }

    fn of(
        &self,
        device: &Device,
        scene: &CompiledScene,
    ) -> Result<Option<Arc<wgpu::Buffer>>, Error> {
        if scene.meshes.triangles.is_empty() {
            return Ok(None);
        }
        let features = Features::new(scene);
        let has_bvh = features.has_bvh(ShapeKind::Triangle);
        let created = || create(device, scene, &features);
        let buffer = (self.meshes).get_or_create(&scene.meshes.triangles, has_bvh, created);
        buffer.map(Some)
    }
}

fn create(
    device: &Device,
    scene: &CompiledScene,
    features: &Features,
) -> Result<wgpu::Buffer, Error> {
    let bytes_max = buffer_bytes_max(device).min(TYPE_BYTES_MAX);
    let bytes = mesh_bytes_len(features);
    if bytes > bytes_max {
        return Err(device.error(format!(
            "{} triangles take {bytes} bytes, but a buffer holds {bytes_max}: trace them on the CPU",
            scene.meshes.triangles.len()
        )));
    }
    upload(device, "mesh", &[&mesh_bytes(scene)])
}

/// The largest size in bytes of a shader's type that naga accepts.
const TYPE_BYTES_MAX: u64 = 1 << 30;
