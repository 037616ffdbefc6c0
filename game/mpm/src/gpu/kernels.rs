//! Kernels: compiled pipelines and the resources that each binds.

use crate::error::Result;
use crate::gpu::device::Gpu;
use crate::gpu::shader::{Features, Resource};

/// A pipeline and what it binds.
pub(super) struct Kernel {
    pub(super) pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    resources: Vec<Resource>,
}

/// All kernels of a simulation.
pub(super) struct Kernels {
    pub(super) clear_table: Kernel,
    pub(super) count_particles: Kernel,
    pub(super) allocate_chunks: Kernel,
    pub(super) finish_ordering: Kernel,
    pub(super) move_particles: Kernel,
    pub(super) transfer: Kernel,
    pub(super) update_grid: Kernel,
    pub(super) couple: Kernel,
}

impl Kernels {
    pub(super) fn compile(gpu: &Gpu, features: &Features) -> Result<Self> {
        use Resource::{
            Balls, Chunks, Control, Counters, DispatchSizes, FrictionSums, Frictions, Keys,
            Materials, NextChunks, NextParticles, Nodes, Obstacles, Params, Particles, Sums, Table,
            Velocities,
        };
        let order = features.order();
        let transfer = features.transfer();
        let grid = features.grid();
        let coupling = features.coupling();
        let with_friction = |resources: &[Resource], more: &[Resource]| match features.friction {
            Some(_) => resources.to_vec(),
            None => [resources, more].concat(),
        };
        Ok(Self {
            clear_table: kernel(gpu, &order, "clear_table", vec![Params, Counters, Table])?,
            count_particles: kernel(
                gpu,
                &order,
                "count_particles",
                vec![Params, Counters, Chunks, Particles, Table, Keys],
            )?,
            allocate_chunks: kernel(
                gpu,
                &order,
                "allocate_chunks",
                vec![Params, Counters, Table, Nodes, NextChunks],
            )?,
            finish_ordering: kernel(
                gpu,
                &order,
                "finish_ordering",
                vec![
                    Params,
                    Control,
                    Counters,
                    Balls,
                    Nodes,
                    NextChunks,
                    DispatchSizes,
                ],
            )?,
            move_particles: kernel(
                gpu,
                &order,
                "move_particles",
                vec![Params, Chunks, Particles, Table, Keys, NextParticles],
            )?,
            transfer: kernel(
                gpu,
                &transfer,
                "transfer",
                with_friction(
                    &[
                        Params, Control, Counters, Chunks, Particles, Sums, Velocities, Materials,
                    ],
                    &[FrictionSums],
                ),
            )?,
            update_grid: kernel(
                gpu,
                &grid,
                "update_grid",
                with_friction(
                    &[
                        Params, Control, Counters, Sums, Velocities, Balls, Obstacles, Nodes,
                    ],
                    &[FrictionSums, Frictions],
                ),
            )?,
            couple: kernel(
                gpu,
                &coupling,
                "couple",
                with_friction(
                    &[Params, Control, Counters, Velocities, Balls, Obstacles],
                    &[Frictions],
                ),
            )?,
        })
    }
}

fn kernel(
    gpu: &Gpu,
    text: &str,
    entry_point: &'static str,
    resources: Vec<Resource>,
) -> Result<Kernel> {
    let pipeline = gpu.pipeline(entry_point, text)?;
    Ok(Kernel {
        layout: pipeline.get_bind_group_layout(0),
        pipeline,
        resources,
    })
}

impl Kernel {
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
