//! Batches: commands of many substeps, encoded at once.

use crate::gpu::buffers::{Buffers, Grid};
use crate::gpu::kernels::Kernels;
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

/// Where the sizes of dispatches over blocks of nodes begin, in bytes.
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
        let mut turn = turn;
        for _ in 0..self.groups {
            self.encode_ordering(pass, kernels, buffers, grid, turn);
            turn = 1 - turn;
            for _ in 0..self.group {
                encode_substep(pass, kernels, buffers, grid, turn);
            }
            encode_transfer(pass, kernels, buffers, grid, turn);
        }
        turn
    }

    fn encode_ordering(
        self,
        pass: &mut wgpu::ComputePass,
        kernels: &Kernels,
        buffers: &Buffers,
        grid: &Grid,
        turn: usize,
    ) {
        let bindings = &grid.bindings;
        let sizes = &buffers.dispatch_sizes[turn];
        pass.set_pipeline(&kernels.clear_table.pipeline);
        pass.set_bind_group(0, &bindings.clear_table[turn], &[]);
        dispatch(pass, self.blocks.div_ceil(256));
        pass.set_pipeline(&kernels.count_particles.pipeline);
        pass.set_bind_group(0, &bindings.count_particles[turn], &[]);
        pass.dispatch_workgroups_indirect(sizes, 0);
        pass.set_pipeline(&kernels.allocate_chunks.pipeline);
        pass.set_bind_group(0, &bindings.allocate_chunks[turn], &[]);
        dispatch(pass, self.blocks.div_ceil(64));
        pass.set_pipeline(&kernels.finish_ordering.pipeline);
        pass.set_bind_group(0, &bindings.finish_ordering[turn], &[]);
        dispatch(pass, 1);
        pass.set_pipeline(&kernels.move_particles.pipeline);
        pass.set_bind_group(0, &bindings.move_particles[turn], &[]);
        pass.dispatch_workgroups_indirect(sizes, 0);
    }
}

/// Velocities of the substep before, and the next one up to the grid and the balls.
fn encode_substep(
    pass: &mut wgpu::ComputePass,
    kernels: &Kernels,
    buffers: &Buffers,
    grid: &Grid,
    turn: usize,
) {
    encode_transfer(pass, kernels, buffers, grid, turn);
    pass.set_pipeline(&kernels.update_grid.pipeline);
    pass.set_bind_group(0, &grid.bindings.update_grid[turn], &[]);
    pass.dispatch_workgroups_indirect(&buffers.dispatch_sizes[turn], NODE_SIZES);
    pass.set_pipeline(&kernels.couple.pipeline);
    pass.set_bind_group(0, &grid.bindings.couple[turn], &[]);
    dispatch(pass, 1);
}

fn encode_transfer(
    pass: &mut wgpu::ComputePass,
    kernels: &Kernels,
    buffers: &Buffers,
    grid: &Grid,
    turn: usize,
) {
    pass.set_pipeline(&kernels.transfer.pipeline);
    pass.set_bind_group(0, &grid.bindings.transfer[turn], &[]);
    pass.dispatch_workgroups_indirect(&buffers.dispatch_sizes[turn], 0);
}

/// As kernels count them: rows of equal length.
fn dispatch(pass: &mut wgpu::ComputePass, groups: u32) {
    let rows = groups.div_ceil(GROUPS_X_MAX).max(1);
    pass.dispatch_workgroups(groups.div_ceil(rows), rows, 1);
}
