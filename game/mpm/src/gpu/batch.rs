//! Batches: command buffers of many substeps.

use crate::gpu::buffers::{Buffers, Grid};
use crate::gpu::kernels::{Kernels, Stage};
use crate::gpu::shader::GROUPS_X_MAX;

/// Plan of a batch: groups of substeps, each of which begins with a sorting.
#[derive(Clone, Copy, Debug)]
pub(super) struct Batch {
    /// Number of substeps of a group.
    pub(super) group: u32,
    pub(super) groups: u32,
    /// Number of blocks of the region.
    pub(super) blocks: u32,
}

/// Byte offsets of the indirect dispatch sizes over particles and over blocks of nodes.
const PARTICLE_SIZES: u64 = 0;
const NODE_SIZES: u64 = 12;

impl Batch {
    /// Encodes the batch for particles in the buffer of a turn, and returns the turn after it.
    pub(super) fn encode(
        self,
        pass: &mut wgpu::ComputePass,
        kernels: &Kernels,
        buffers: &Buffers,
        grid: &Grid,
        turn: usize,
    ) -> usize {
        let mut encoder = Encoder {
            pass,
            kernels,
            buffers,
            grid,
            turn,
        };
        for _ in 0..self.groups {
            encoder.dispatch(Stage::ClearTable, self.blocks.div_ceil(256));
            encoder.dispatch_over(Stage::CountParticles, PARTICLE_SIZES);
            encoder.dispatch(Stage::AllocateChunks, self.blocks.div_ceil(64));
            encoder.dispatch(Stage::FinishOrdering, 1);
            encoder.dispatch_over(Stage::MoveParticles, PARTICLE_SIZES);
            encoder.turn = 1 - encoder.turn;
            for _ in 0..self.group {
                // One kernel gathers the velocities of the substep before and scatters the next.
                encoder.dispatch_over(Stage::Transfer, PARTICLE_SIZES);
                encoder.dispatch_over(Stage::UpdateGrid, NODE_SIZES);
                encoder.dispatch(Stage::Couple, 1);
            }
            encoder.dispatch_over(Stage::Transfer, PARTICLE_SIZES);
        }
        encoder.turn
    }
}

struct Encoder<'a, 'p> {
    pass: &'a mut wgpu::ComputePass<'p>,
    kernels: &'a Kernels,
    buffers: &'a Buffers,
    grid: &'a Grid,
    turn: usize,
}

impl Encoder<'_, '_> {
    fn begin(&mut self, stage: Stage) {
        self.pass.set_pipeline(self.kernels.pipeline(stage));
        let bindings = self.grid.bindings(stage, self.turn);
        self.pass.set_bind_group(0, bindings, &[]);
    }

    /// Dispatches at least `groups` workgroups in equal rows of at most [`GROUPS_X_MAX`]; kernels return
    /// early in those past the last.
    fn dispatch(&mut self, stage: Stage, groups: u32) {
        self.begin(stage);
        let rows = groups.div_ceil(GROUPS_X_MAX).max(1);
        self.pass
            .dispatch_workgroups(groups.div_ceil(rows), rows, 1);
    }

    /// Dispatches as many workgroups as the last sorting has counted.
    fn dispatch_over(&mut self, stage: Stage, sizes: u64) {
        self.begin(stage);
        let found = &self.buffers.dispatch_sizes[self.turn];
        self.pass.dispatch_workgroups_indirect(found, sizes);
    }
}
