//! Compiled kernels, cached by the features they are specialised for.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use crate::Error;
use crate::compiled::ShapeKind;
use crate::gpu::device::Device;
use crate::gpu::features::{Features, SceneMemory};
use crate::gpu::layout::{ENVIRONMENT_BINDING, MESH_BINDING, TEXTURE_BINDING};
use crate::gpu::shader;

/// A compiled kernel and its bind-group layout.
pub(crate) struct Kernel {
    pub(crate) pipeline: wgpu::ComputePipeline,
    pub(crate) layout: wgpu::BindGroupLayout,
    /// Bindings of the optional buffers that it reads: triangles, image textures, environment map.
    pub(crate) optional_bindings: Vec<u32>,
    /// Blocks of pixels per workgroup.
    pub(crate) workgroup_blocks: u32,
}

/// Kernels by the features of their scenes.
#[derive(Default)]
pub(crate) struct KernelCache {
    kernels: Mutex<HashMap<Features, Arc<Kernel>>>,
}

impl KernelCache {
    /// Maximum number of kernels kept.
    const KERNELS_MAX: usize = 32;

    /// Whether the kernel for `features` has been compiled.
    pub(crate) fn has(&self, features: &Features) -> bool {
        let kernels = self.kernels.lock().unwrap_or_else(PoisonError::into_inner);
        kernels.contains_key(features)
    }

    /// The kernel for `features`, compiled if needed. The lock is not held meanwhile: two threads
    /// that need the same new kernel both compile it, but threads that need another one do not
    /// wait.
    ///
    /// # Errors
    /// [`Error::Device`] if the driver does not compile it.
    pub(crate) fn kernel(&self, device: &Device, features: Features) -> Result<Arc<Kernel>, Error> {
        let lock = || self.kernels.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kernel) = lock().get(&features) {
            return Ok(Arc::clone(kernel));
        }
        let kernel = Arc::new(compile(device, &features, shader::source(&features))?);
        let mut kernels = lock();
        if kernels.len() >= Self::KERNELS_MAX {
            kernels.clear();
        }
        kernels.insert(features, Arc::clone(&kernel));
        Ok(kernel)
    }
}

/// # Errors
/// [`Error::Device`] if the driver does not compile it.
pub(crate) fn compile(
    device: &Device,
    features: &Features,
    source: String,
) -> Result<Kernel, Error> {
    device.guarded(|device| {
        let module = shader_module(device, source);
        let mut entries = vec![
            entry(0, scene_binding(features.memory)),
            entry(1, wgpu::BufferBindingType::Uniform),
            entry(2, wgpu::BufferBindingType::Storage { read_only: true }),
            entry(3, wgpu::BufferBindingType::Storage { read_only: false }),
            entry(4, wgpu::BufferBindingType::Storage { read_only: false }),
            entry(5, wgpu::BufferBindingType::Storage { read_only: false }),
            entry(6, wgpu::BufferBindingType::Storage { read_only: true }),
        ];
        let has_mesh = features.count(ShapeKind::Triangle) > 0;
        let optional_bindings: Vec<u32> = [
            has_mesh.then_some(MESH_BINDING),
            (features.textures > 0).then_some(TEXTURE_BINDING),
            (features.has_environment_map()).then_some(ENVIRONMENT_BINDING),
        ]
        .into_iter()
        .flatten()
        .collect();
        let optional = optional_bindings.iter();
        let read = wgpu::BufferBindingType::Storage { read_only: true };
        entries.extend(optional.map(|&binding| entry(binding, read)));
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("trace"),
            entries: &entries,
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("trace"),
            bind_group_layouts: &[Some(&layout)],
            ..Default::default()
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("trace"),
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some("trace"),
            compilation_options: wgpu::PipelineCompilationOptions {
                // The workgroup's ray counter and the state shared by its threads must start at 0.
                zero_initialize_workgroup_memory: true,
                ..Default::default()
            },
            cache: None,
        });
        Kernel {
            pipeline,
            layout,
            optional_bindings,
            workgroup_blocks: features.workgroup_blocks,
        }
    })
}

/// A shader module without the bounds checks that wgpu adds: 26 instead of 21 Gray/s on an H200 for
/// 16 balls and 6 boxes.
#[expect(
    unsafe_code,
    reason = "every index is a loop's counter or a candidate's bit below an array's length, a \
              material's index that `layout::scene_bytes` checks, a texel that is clamped to its level of a texture, or a \
              pixel of an environment map that is clamped to it, a tile's pixel in buffers sized for the tiles; \
              every loop has a bound; nothing is divided by a variable that may be 0"
)]
fn shader_module(device: &wgpu::Device, source: String) -> wgpu::ShaderModule {
    let descriptor = wgpu::ShaderModuleDescriptor {
        label: Some("trace"),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    };
    // SAFETY: the kernel accesses memory within bounds and terminates, for the reasons given above.
    unsafe {
        device.create_shader_module_trusted(descriptor, wgpu::ShaderRuntimeChecks::unchecked())
    }
}

const fn scene_binding(memory: SceneMemory) -> wgpu::BufferBindingType {
    match memory {
        SceneMemory::Uniform => wgpu::BufferBindingType::Uniform,
        SceneMemory::Storage => wgpu::BufferBindingType::Storage { read_only: true },
    }
}

const fn entry(binding: u32, ty: wgpu::BufferBindingType) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    }
}
