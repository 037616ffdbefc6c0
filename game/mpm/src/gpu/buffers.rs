//! Buffers of a simulation on a GPU, and the bind groups of its kernels.

use crate::error::{Error, Result};
use crate::gpu::device::Gpu;
use crate::gpu::kernels::{ComputeKernel, Kernels, Stage};
use crate::gpu::layout::{BallRow, Chunk, Control, Counters, MaterialRow, ObstacleRow, Params};
use crate::gpu::particle_copy::{INDICES_MAX, PARTS, ParticleCopy};
use crate::gpu::shader::{Features, Resource};
use crate::storage::BLOCK_NODES;

/// Largest number of balls: one bit of a 32-bit word per ball says whether particles touch it.
pub const GPU_BALLS_MAX: usize = 32;

/// Largest number of obstacles.
pub const GPU_OBSTACLES_MAX: usize = 256;

/// Largest number of materials, which fit into a uniform buffer of WebGPU's guaranteed size.
pub const GPU_MATERIALS_MAX: usize = 256;

/// Largest number of blocks of 4x4x4 cells of the box around all particles, if the device's buffers hold as
/// many: 512 MiB for each buffer of nodes.
pub const GPU_BLOCKS_MAX: usize = 1 << 19;

/// Buffers of fixed size.
pub(super) struct Buffers {
    pub(super) params: wgpu::Buffer,
    pub(super) control: wgpu::Buffer,
    pub(super) counters: wgpu::Buffer,
    pub(super) balls: wgpu::Buffer,
    pub(super) obstacles: wgpu::Buffer,
    pub(super) readback: wgpu::Buffer,
    materials: wgpu::Buffer,
    keys: wgpu::Buffer,
    /// Double buffers, as are the two fields below: one holds the present state, sorting writes the other.
    pub(super) particles: [wgpu::Buffer; 2],
    pub(super) chunks: [wgpu::Buffer; 2],
    pub(super) dispatch_sizes: [wgpu::Buffer; 2],
}

/// Buffers of the grid, reallocated when it grows.
struct GridBuffers {
    blocks: usize,
    table: wgpu::Buffer,
    nodes: wgpu::Buffer,
    sums: wgpu::Buffer,
    velocities: wgpu::Buffer,
    friction_sums: wgpu::Buffer,
    frictions: wgpu::Buffer,
    touches: wgpu::Buffer,
}

/// The grid's buffers and all bind groups.
pub(super) struct Grid {
    buffers: GridBuffers,
    /// Bind groups of each [`Stage`] for both turns of the double buffers.
    bindings: Vec<[wgpu::BindGroup; 2]>,
}

const STORAGE: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE;
const COPIED: wgpu::BufferUsages = wgpu::BufferUsages::COPY_SRC.union(wgpu::BufferUsages::COPY_DST);

/// Largest number of blocks that a device's buffers hold.
pub(super) fn blocks_max(gpu: &Gpu) -> usize {
    let limits = gpu.device.limits();
    let bytes = limits
        .max_storage_buffer_binding_size
        .min(limits.max_buffer_size);
    (bytes as usize / (BLOCK_NODES * size_of::<[f32; 4]>())).min(GPU_BLOCKS_MAX)
}

/// Returns an error for more particles than a device's buffers and the index bits hold.
pub(super) fn check_particles(gpu: &Gpu, count: usize) -> Result<()> {
    let limits = gpu.device.limits();
    let bytes = limits
        .max_storage_buffer_binding_size
        .min(limits.max_buffer_size);
    let max = bytes as usize / (PARTS * size_of::<[u32; 4]>());
    check_limit(gpu, "particles", count, max.min(INDICES_MAX))
}

pub(super) fn check_limit(
    gpu: &Gpu,
    quantity: &'static str,
    value: usize,
    max: usize,
) -> Result<()> {
    if value <= max {
        return Ok(());
    }
    Err(Error::GpuLimit {
        quantity,
        value: value as u64,
        max: max as u64,
        device: gpu.name().to_owned(),
    })
}

impl Buffers {
    pub(super) fn new(
        gpu: &Gpu,
        copy: &ParticleCopy,
        materials: &[MaterialRow],
        features: &Features,
    ) -> Result<Self> {
        let count = copy.parts.len() / PARTS;
        let of = |len: usize, size: usize, usage| buffer(gpu, len * size, usage);
        // Each block with particles has at most one chunk more than its full ones. 64 pad the last dispatch
        // row.
        let chunks_max = count / features.chunk as usize + count.min(blocks_max(gpu)) + 64;
        let particles = || of(copy.parts.len(), size_of::<[f32; 4]>(), STORAGE | COPIED);
        let chunks = || of(chunks_max, size_of::<Chunk>(), STORAGE | COPIED);
        let sizes = || buffer(gpu, 24, STORAGE | COPIED | wgpu::BufferUsages::INDIRECT);
        let readback = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let uniform = wgpu::BufferUsages::UNIFORM | COPIED;
        let buffers = Self {
            params: of(1, size_of::<Params>(), uniform)?,
            control: of(1, size_of::<Control>(), STORAGE | COPIED)?,
            counters: of(1, size_of::<Counters>(), STORAGE | COPIED)?,
            balls: of(GPU_BALLS_MAX, size_of::<BallRow>(), STORAGE | COPIED)?,
            obstacles: of(
                GPU_OBSTACLES_MAX,
                size_of::<ObstacleRow>(),
                STORAGE | COPIED,
            )?,
            readback: buffer(gpu, READBACK_BYTES as usize, readback)?,
            materials: of(features.materials, size_of::<MaterialRow>(), uniform)?,
            keys: of(count, 8, STORAGE)?,
            particles: [particles()?, particles()?],
            chunks: [chunks()?, chunks()?],
            dispatch_sizes: [sizes()?, sizes()?],
        };
        let chunk_count = copy.chunks.len() as u32;
        let rows = chunk_count.div_ceil(super::shader::GROUPS_X_MAX).max(1);
        // Chunks past the last are empty, as buffers are initialised with zeros.
        let sizes = [chunk_count.div_ceil(rows), rows, 1, 0, 1, 1];
        gpu.guarded(|_| {
            let write = |buffer, bytes: &[u8]| gpu.queue.write_buffer(buffer, 0, bytes);
            write(&buffers.particles[0], bytemuck::cast_slice(&copy.parts));
            write(&buffers.chunks[0], bytemuck::cast_slice(&copy.chunks));
            write(&buffers.dispatch_sizes[0], bytemuck::cast_slice(&sizes));
            write(&buffers.materials, bytemuck::cast_slice(materials));
        })?;
        Ok(buffers)
    }
}

/// Size of the read-back buffer: [`Control`], [`Counters`] and the balls, in this order.
pub(super) const READBACK_BYTES: u64 =
    (size_of::<Control>() + size_of::<Counters>() + GPU_BALLS_MAX * size_of::<BallRow>()) as u64;

impl Grid {
    /// Allocates the buffers of a number of blocks and binds them.
    pub(super) fn new(
        gpu: &Gpu,
        blocks: usize,
        fixed: &Buffers,
        kernels: &Kernels,
        features: &Features,
    ) -> Result<Self> {
        let nodes = blocks * BLOCK_NODES;
        let frictions = if features.friction.is_some() {
            1
        } else {
            nodes
        };
        let buffers = GridBuffers {
            blocks,
            table: buffer(gpu, blocks * 16, STORAGE)?,
            nodes: buffer(gpu, (blocks + 64) * 4, STORAGE)?,
            sums: buffer(gpu, nodes * 16, STORAGE)?,
            velocities: buffer(gpu, nodes * 16, STORAGE)?,
            friction_sums: buffer(gpu, frictions * 4, STORAGE)?,
            frictions: buffer(gpu, frictions * 4, STORAGE)?,
            touches: buffer(gpu, nodes * 16, STORAGE)?,
        };
        let bindings = gpu.guarded(|device| {
            let bind = |kernel: &ComputeKernel| {
                [0, 1].map(|turn| kernel.bind(device, |r| find(r, turn, fixed, &buffers)))
            };
            kernels.0.iter().map(bind).collect()
        })?;
        Ok(Self { buffers, bindings })
    }

    pub(super) fn bindings(&self, stage: Stage, turn: usize) -> &wgpu::BindGroup {
        &self.bindings[stage as usize][turn]
    }

    pub(super) fn blocks(&self) -> usize {
        self.buffers.blocks
    }
}

/// The buffer of a resource at a turn of the double buffers.
fn find<'a>(
    resource: Resource,
    turn: usize,
    fixed: &'a Buffers,
    grid: &'a GridBuffers,
) -> &'a wgpu::Buffer {
    match resource {
        Resource::Params => &fixed.params,
        Resource::Control => &fixed.control,
        Resource::Counters => &fixed.counters,
        Resource::Chunks => &fixed.chunks[turn],
        Resource::Particles => &fixed.particles[turn],
        Resource::Sums => &grid.sums,
        Resource::Velocities => &grid.velocities,
        Resource::Materials => &fixed.materials,
        Resource::FrictionSums => &grid.friction_sums,
        Resource::Frictions => &grid.frictions,
        Resource::Touches => &grid.touches,
        Resource::Balls => &fixed.balls,
        Resource::Obstacles => &fixed.obstacles,
        Resource::Table => &grid.table,
        Resource::Keys => &fixed.keys,
        Resource::Nodes => &grid.nodes,
        Resource::NextChunks => &fixed.chunks[1 - turn],
        Resource::NextParticles => &fixed.particles[1 - turn],
        Resource::DispatchSizes => &fixed.dispatch_sizes[1 - turn],
    }
}

fn buffer(gpu: &Gpu, bytes: usize, usage: wgpu::BufferUsages) -> Result<wgpu::Buffer> {
    gpu.guarded(|device| {
        device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes.max(16) as u64,
            usage,
            mapped_at_creation: false,
        })
    })
}
