//! A cache of device buffers whose contents stay the same from frame to frame.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use crate::Error;
use crate::gpu::device::Device;

/// Device buffers, keyed by the identity of the vector that they were filled from.
pub(crate) struct BufferCache<T> {
    kept: Mutex<Vec<CachedBuffer<T>>>,
}

struct CachedBuffer<T> {
    /// The vector that the buffer was filled from; it cannot be changed in place while this weak
    /// pointer exists.
    source: Weak<Vec<T>>,
    has_bvh: bool,
    buffer: Arc<wgpu::Buffer>,
}

impl<T> Default for BufferCache<T> {
    fn default() -> Self {
        let kept = Mutex::default();
        Self { kept }
    }
}

impl<T> BufferCache<T> {
    /// Number of buffers kept: a node keeps as many scenes.
    const KEPT_MAX: usize = 4;

    /// The buffer of `source` with (`has_bvh`) or without a BVH, created with `create` unless it is
    /// cached.
    pub(crate) fn get_or_create(
        &self,
        source: &Arc<Vec<T>>,
        has_bvh: bool,
        create: impl FnOnce() -> Result<wgpu::Buffer, Error>,
    ) -> Result<Arc<wgpu::Buffer>, Error> {
        // Pointer equality implies equal contents: `Arc::make_mut` moves a vector that has weak
        // pointers to a new allocation before it is changed, and a weak pointer keeps the old
        // allocation from being reused.
        let source = Arc::downgrade(source);
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let is_same =
            |kept: &&CachedBuffer<T>| kept.source.ptr_eq(&source) && kept.has_bvh == has_bvh;
        let found = kept()
            .iter()
            .find(is_same)
            .map(|kept| Arc::clone(&kept.buffer));
        if let Some(found) = found {
            return Ok(found);
        }
        // Without holding the lock, as filling a buffer takes long: two threads may create the same
        // buffer, which costs only memory.
        let buffer = Arc::new(create()?);
        let mut kept = kept();
        kept.retain(|kept| kept.source.strong_count() > 0);
        if kept.len() >= Self::KEPT_MAX {
            kept.remove(0);
        }
        kept.push(CachedBuffer {
            source,
            has_bvh,
            buffer: Arc::clone(&buffer),
        });
        Ok(buffer)
    }
}

/// The largest size in bytes of a storage buffer that a kernel can bind.
pub(crate) fn buffer_bytes_max(device: &Device) -> u64 {
    let limits = device.device.limits();
    (limits.max_storage_buffer_binding_size).min(limits.max_buffer_size)
}

/// A storage buffer that holds `parts` one after another.
pub(crate) fn upload(device: &Device, label: &str, parts: &[&[u8]]) -> Result<wgpu::Buffer, Error> {
    device.guarded(|wgpu| {
        let buffer = wgpu.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: parts.iter().map(|part| part.len() as u64).sum(),
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
