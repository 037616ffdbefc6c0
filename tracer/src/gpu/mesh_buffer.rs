//! The triangles of scenes on the device: uploaded once, not with each picture.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use crate::compiled::TriangleData;
use crate::gpu::device::Device;
use crate::gpu::features::Features;
use crate::gpu::image_buffers::ImageBuffers;
use crate::gpu::layout::{mesh_bytes, mesh_bytes_len, scene_bytes};
use crate::{CompiledScene, Error, ImageSize};

/// What a picture's kernels read of its scene.
pub(crate) struct SceneUpload {
    /// See [`scene_bytes`].
    pub(crate) bytes: Vec<u8>,
    /// See [`mesh_bytes`]; none without triangles.
    pub(crate) mesh: Option<Arc<wgpu::Buffer>>,
    /// Image textures; none without any.
    pub(crate) textures: Option<Arc<wgpu::Buffer>>,
    /// The environment map, if there is one.
    pub(crate) environment_map: Option<Arc<wgpu::Buffer>>,
}

/// Buffers of the scenes that were traced last.
#[derive(Default)]
pub(crate) struct MeshBuffers {
    kept: Mutex<Vec<MeshBuffer>>,
    images: ImageBuffers,
}

struct MeshBuffer {
    /// Its triangles, which nobody changes in place while this points at them.
    triangles: Weak<Vec<TriangleData>>,
    has_bvh: bool,
    buffer: Arc<wgpu::Buffer>,
}

impl MeshBuffers {
    /// Buffers kept: a node keeps as many scenes.
    const KEPT_MAX: usize = 4;

    /// What is to be uploaded with a picture of `scene`.
    ///
    /// # Errors
    /// [`Error::InvalidScene`] as [`scene_bytes`] says; [`Error::Device`] if triangles or pictures do not fit.
    pub(crate) fn upload(
        &self,
        device: &Device,
        scene: &CompiledScene,
        size: ImageSize,
    ) -> Result<SceneUpload, Error> {
        Ok(SceneUpload {
            bytes: scene_bytes(scene, size)?,
            mesh: self.of(device, scene)?,
            textures: self.images.textures(device, scene)?,
            environment_map: self.images.environment_map(device, scene)?,
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
        let has_bvh = features.has_bvh(crate::compiled::ShapeKind::Triangle);
        let triangles = Arc::downgrade(&scene.meshes.triangles);
        let is_same =
            |kept: &MeshBuffer| kept.triangles.ptr_eq(&triangles) && kept.has_bvh == has_bvh;
        let found = self
            .lock()
            .iter()
            .find(|kept| is_same(kept))
            .map(|kept| kept.buffer.clone());
        if found.is_some() {
            return Ok(found);
        }
        let buffer = Arc::new(create(device, scene, &features)?);
        let mut kept = self.lock();
        kept.retain(|kept| kept.triangles.strong_count() > 0);
        if kept.len() >= Self::KEPT_MAX {
            kept.remove(0);
        }
        kept.push(MeshBuffer {
            triangles,
            has_bvh,
            buffer: Arc::clone(&buffer),
        });
        Ok(Some(buffer))
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<MeshBuffer>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn create(
    device: &Device,
    scene: &CompiledScene,
    features: &Features,
) -> Result<wgpu::Buffer, Error> {
    let limits = device.device.limits();
    let bytes_max = limits
        .max_storage_buffer_binding_size
        .min(limits.max_buffer_size)
        .min(TYPE_BYTES_MAX);
    let bytes = mesh_bytes_len(features);
    if bytes > bytes_max {
        return Err(device.error(format!(
            "{} triangles take {bytes} bytes, but a buffer holds {bytes_max}: trace them on the CPU",
            features.triangles
        )));
    }
    let data = mesh_bytes(scene);
    device.guarded(|wgpu| {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let mesh = wgpu.create_buffer(&wgpu::BufferDescriptor {
            label: Some("mesh"),
            size: bytes,
            usage,
            mapped_at_creation: false,
        });
        device.queue.write_buffer(&mesh, 0, &data);
        mesh
    })
}

/// The largest type of a shader, which naga bounds.
const TYPE_BYTES_MAX: u64 = 1 << 30;
