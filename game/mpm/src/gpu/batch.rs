//! Batches: commands of many substeps, encoded at once.

use crate::gpu::buffers::{Buffers, Grid};
use crate::gpu::kernels::{Kernels, Stage};
use crate::gpu::shader::GROUPS_X_MAX;

/// Substeps of a batch, in groups that begin with an ordering.
#[derive(Clone, Copy, Debug)]
pub(super) struct Batch {
    /// Substeps of a group.
    pub(super) group: u32,
    pub(super) groups: u32,
    /// Blocks of the region.
    pub(super) blocks: u32,
}

/// Where the sizes of dispatches over particles, and of those over blocks of nodes, begin, in bytes.
const PARTICLE_SIZES: u64 = 0;
const NODE_SIZES: u64 = 12;

impl Batch {
    /// Encodes the batch for particles of a turn, and returns the turn after it.
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
                // Velocities of the substep before, and the next one up to the grid and the balls.
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

    /// Groups as kernels count them: rows of equal length.
    fn dispatch(&mut self, stage: Stage, groups: u32) {
        self.begin(stage);
        let rows = groups.div_ceil(GROUPS_X_MAX).max(1);
        self.pass
            .dispatch_workgroups(groups.div_ceil(rows), rows, 1);
    }

    /// As many groups as the ordering before has found.
    fn dispatch_over(&mut self, stage: Stage, sizes: u64) {
        self.begin(stage);
        let found = &self.buffers.dispatch_sizes[self.turn];
        self.pass.dispatch_workgroups_indirect(found, sizes);
    }
}
