//! Kernels: compute pipelines and the resources that each binds.

use crate::error::Result;
use crate::gpu::device::Gpu;
use crate::gpu::shader::Features;
use crate::gpu::shader::Resource::{
    self, Balls, Chunks, Control, Counters, DispatchSizes, FrictionSums, Frictions, Keys,
    Materials, NextChunks, NextParticles, Nodes, Obstacles, Params, Particles, Sums, Table,
    Touches, Velocities,
};

/// A compute pipeline and the resources that it binds.
pub(super) struct ComputeKernel {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    resources: &'static [Resource],
}

/// The kernels: five of a sorting, then three of a substep.
#[derive(Clone, Copy)]
pub(super) enum Stage {
    ClearTable,
    CountParticles,
    AllocateChunks,
    FinishOrdering,
    MoveParticles,
    Transfer,
    UpdateGrid,
    Couple,
}

/// All kernels of a simulation, in the order of [`Stage`].
pub(super) struct Kernels(pub(super) Vec<ComputeKernel>);

impl Kernels {
    pub(super) fn compile(gpu: &Gpu, features: &Features) -> Result<Self> {
        let order = features.order();
        // Resources for coefficients of friction per node are last in each list, and left out if all
        // materials have the same coefficient.
        let with_friction = |resources: &'static [Resource], more: usize| match features.friction {
            Some(_) => &resources[..resources.len() - more],
            None => resources,
        };
        let stages = [
            (&order, "clear_table", CLEAR_TABLE),
            (&order, "count_particles", COUNT_PARTICLES),
            (&order, "allocate_chunks", ALLOCATE_CHUNKS),
            (&order, "finish_ordering", FINISH_ORDERING),
            (&order, "move_particles", MOVE_PARTICLES),
            (&features.transfer(), "transfer", with_friction(TRANSFER, 1)),
            (
                &features.grid(),
                "update_grid",
                with_friction(UPDATE_GRID, 2),
            ),
            (&features.coupling(), "couple", with_friction(COUPLE, 1)),
        ];
        let kernels = stages.map(|(text, entry_point, resources)| {
            let pipeline = gpu.pipeline(entry_point, text)?;
            Ok(ComputeKernel {
                layout: pipeline.get_bind_group_layout(0),
                pipeline,
                resources,
            })
        });
        Ok(Self(kernels.into_iter().collect::<Result<_>>()?))
    }

    pub(super) fn pipeline(&self, stage: Stage) -> &wgpu::ComputePipeline {
        &self.0[stage as usize].pipeline
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
