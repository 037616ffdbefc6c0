//! Kernels: compiled pipelines and the resources that each binds.

use crate::error::Result;
use crate::gpu::device::Gpu;
use crate::gpu::shader::Features;
use crate::gpu::shader::Resource::{
    self, Balls, Chunks, Control, Counters, DispatchSizes, FrictionSums, Frictions, Keys,
    Materials, NextChunks, NextParticles, Nodes, Obstacles, Params, Particles, Sums, Table,
    Touches, Velocities,
};

/// A pipeline and what it binds.
pub(super) struct ComputeKernel {
    pub(super) pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    resources: &'static [Resource],
}

/// All kernels of a simulation.
pub(super) struct Kernels {
    pub(super) clear_table: ComputeKernel,
    pub(super) count_particles: ComputeKernel,
    pub(super) allocate_chunks: ComputeKernel,
    pub(super) finish_ordering: ComputeKernel,
    pub(super) move_particles: ComputeKernel,
    pub(super) transfer: ComputeKernel,
    pub(super) update_grid: ComputeKernel,
    pub(super) couple: ComputeKernel,
}

impl Kernels {
    pub(super) fn compile(gpu: &Gpu, features: &Features) -> Result<Self> {
        let order = features.order();
        // The resources of means of friction follow the others.
        let with_friction = |resources: &'static [Resource], more: usize| match features.friction {
            Some(_) => &resources[..resources.len() - more],
            None => resources,
        };
        let transfer = with_friction(TRANSFER, 1);
        let update_grid = with_friction(UPDATE_GRID, 2);
        let couple = with_friction(COUPLE, 1);
        Ok(Self {
            clear_table: kernel(gpu, &order, "clear_table", CLEAR_TABLE)?,
            count_particles: kernel(gpu, &order, "count_particles", COUNT_PARTICLES)?,
            allocate_chunks: kernel(gpu, &order, "allocate_chunks", ALLOCATE_CHUNKS)?,
            finish_ordering: kernel(gpu, &order, "finish_ordering", FINISH_ORDERING)?,
            move_particles: kernel(gpu, &order, "move_particles", MOVE_PARTICLES)?,
            transfer: kernel(gpu, &features.transfer(), "transfer", transfer)?,
            update_grid: kernel(gpu, &features.grid(), "update_grid", update_grid)?,
            couple: kernel(gpu, &features.coupling(), "couple", couple)?,
        })
    }
}

const CLEAR_TABLE: &[Resource] = &[Params, Counters, Table];
const COUNT_PARTICLES: &[Resource] = &[Params, Counters, Chunks, Particles, Table, Keys];
const ALLOCATE_CHUNKS: &[Resource] = &[Params, Counters, Table, Nodes, NextChunks];
const FINISH_ORDERING: &[Resource] = &[
    Params,
    Control,
    Counters,
    Balls,
    Nodes,
    NextChunks,
    DispatchSizes,
];
const MOVE_PARTICLES: &[Resource] = &[Params, Chunks, Particles, Table, Keys, NextParticles];
const TRANSFER: &[Resource] = &[
    Params,
    Control,
    Counters,
    Chunks,
    Particles,
    Sums,
    Velocities,
    Materials,
    Balls,
    Touches,
    FrictionSums,
];
const UPDATE_GRID: &[Resource] = &[
    Params,
    Control,
    Counters,
    Sums,
    Velocities,
    Obstacles,
    Nodes,
    FrictionSums,
    Frictions,
];
const COUPLE: &[Resource] = &[
    Params, Control, Counters, Velocities, Balls, Obstacles, Touches, Frictions,
];

fn kernel(
    gpu: &Gpu,
    text: &str,
    entry_point: &'static str,
    resources: &'static [Resource],
) -> Result<ComputeKernel> {
    let pipeline = gpu.pipeline(entry_point, text)?;
    Ok(ComputeKernel {
        layout: pipeline.get_bind_group_layout(0),
        pipeline,
        resources,
    })
}

impl ComputeKernel {
    pub(super) fn bind<'a>(
        &self,
        device: &wgpu::Device,
        buffer: impl Fn(Resource) -> &'a wgpu::Buffer,
    ) -> wgpu::BindGroup {
        let entries: Vec<_> = self
            .resources
            .iter()
            .map(|resource| wgpu::BindGroupEntry {
                binding: *resource as u32,
                resource: buffer(*resource).as_entire_binding(),
            })
            .collect();
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.layout,
            entries: &entries,
        })
    }
}
