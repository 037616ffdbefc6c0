//! Sparse grid of densities, allocated in blocks around particles.

use glam::{IVec3, Vec3};

use super::{BLOCKS_MAX, Drop, key, unkey};
use crate::SceneError;

/// Nodes along the edge of a block.
pub(super) const EDGE: i32 = 8;
/// Nodes per block.
pub(super) const NODES: usize = (EDGE * EDGE * EDGE) as usize;
/// Index of the lowest plane of nodes above the floor, which lies half a cell below it.
pub(super) const ABOVE_FLOOR: i32 = 2;

/// Grid of which only the blocks within reach of particles are stored, with a margin of one node.
pub(super) struct DensityGrid {
    pub(super) origin: Vec3,
    pub(super) cell_m: f32,
    /// Keys of the stored blocks, ascending.
    keys: Vec<u64>,
    /// Densities of each block's nodes, x fastest.
    values: Vec<f32>,
}

impl DensityGrid {
    /// Density of `drops`. The floor lies half a cell below plane [`ABOVE_FLOOR`] of nodes along z; density
    /// below it is 0, and drops near it are mirrored in it, so that the surface meets the floor at a right
    /// angle.
    pub(super) fn new(drops: &[Drop], origin: Vec3, cell_m: f32) -> Result<Self, SceneError> {
        let mut grid = Self {
            origin,
            cell_m,
            keys: Vec::new(),
            values: Vec::new(),
        };
        grid.reserve_blocks(drops)?;
        grid.values = vec![0.0; grid.keys.len() * NODES];
        let floor_z = origin.z + 1.5 * cell_m;
        for drop in drops {
            grid.splat(drop);
            if drop.center.z - floor_z < drop.radius_m {
                let mut mirrored = *drop;
                mirrored.center.z = 2.0 * floor_z - drop.center.z;
                grid.splat(&mirrored);
            }
        }
        Ok(grid)
    }

    fn reserve_blocks(&mut self, drops: &[Drop]) -> Result<(), SceneError> {
        let mut last = None;
        for drop in drops {
            let [low, high] = self.nodes(drop);
            // The surface net reads the next node along each axis and has vertices in the previous cell:
            // the blocks of both are needed.
            let blocks = [low - 1, high + 1].map(|node| node.max(IVec3::ZERO) / EDGE);
            // Drops are sorted by cell, so that successive ones often need the same blocks.
            if low.cmpgt(high).any() || last.replace(blocks) == Some(blocks) {
                continue;
            }
            let [low, high] = blocks;
            for z in low.z..=high.z {
                for y in low.y..=high.y {
                    self.keys
                        .extend((low.x..=high.x).map(|x| key(IVec3::new(x, y, z))));
                }
            }
            // Neighbouring drops add the same blocks; duplicates are removed from time to time to limit
            // memory.
            if self.keys.len() > 4 * BLOCKS_MAX {
                self.sort_keys()?;
            }
        }
        self.sort_keys()
    }

    fn sort_keys(&mut self) -> Result<(), SceneError> {
        self.keys.sort_unstable();
        self.keys.dedup();
        match self.keys.len() <= BLOCKS_MAX {
            true => Ok(()),
            false => Err(SceneError::rule(format!(
                "its particles are so far apart that their surface takes more than {BLOCKS_MAX} blocks of its grid, \
                 at most {BLOCKS_MAX} are allowed: draw them as balls, or raise the smoothing radius"
            ))),
        }
    }

    /// Lowest and highest node above the floor within reach of a drop.
    fn nodes(&self, drop: &Drop) -> [IVec3; 2] {
        let place = |at: Vec3| (at - self.origin) / self.cell_m;
        let low = place(drop.center - drop.radius_m).ceil().as_ivec3();
        let high = place(drop.center + drop.radius_m).floor().as_ivec3();
        let least = IVec3::new(0, 0, ABOVE_FLOOR);
        [low.max(least), high]
    }

    /// Adds the kernel of a drop to the densities.
    fn splat(&mut self, drop: &Drop) {
        let [low, high] = self.nodes(drop);
        if low.cmpgt(high).any() {
            return;
        }
        let inverse_square = 1.0 / (drop.radius_m * drop.radius_m);
        let (low_block, high_block) = (low / EDGE, high / EDGE);
        for bz in low_block.z..=high_block.z {
            for by in low_block.y..=high_block.y {
                for bx in low_block.x..=high_block.x {
                    let block = IVec3::new(bx, by, bz);
                    let Some(found) = self.find(block) else {
                        continue;
                    };
                    let first = (low - block * EDGE).max(IVec3::ZERO);
                    let last = (high - block * EDGE).min(IVec3::splat(EDGE - 1));
                    let values = &mut self.values[found * NODES..][..NODES];
                    let corner = self.origin + (block * EDGE).as_vec3() * self.cell_m - drop.center;
                    for z in first.z..=last.z {
                        let dz = corner.z + z as f32 * self.cell_m;
                        for y in first.y..=last.y {
                            let dy = corner.y + y as f32 * self.cell_m;
                            let beside = 1.0 - (dy * dy + dz * dz) * inverse_square;
                            if beside <= 0.0 {
                                continue;
                            }
                            let row =
                                &mut values[((z * EDGE + y) * EDGE) as usize..][..EDGE as usize];
                            for x in first.x..=last.x {
                                let dx = corner.x + x as f32 * self.cell_m;
                                // Kernel (1 − r²)³, as for the weights of neighbours: it needs no square
                                // root, and its derivative vanishes at the end.
                                let left = (beside - dx * dx * inverse_square).max(0.0);
                                row[x as usize] += drop.weight * (left * left * left);
                            }
                        }
                    }
                }
            }
        }
    }

    /// Index of a block among the stored ones.
    pub(super) fn find(&self, block: IVec3) -> Option<usize> {
        let is_in_range = block.cmpge(IVec3::ZERO).all();
        is_in_range.then(|| self.keys.binary_search(&key(block)).ok())?
    }

    /// Stored blocks with the densities of their nodes.
    pub(super) fn blocks(&self) -> impl Iterator<Item = (IVec3, &[f32])> {
        let blocks = self.keys.iter().map(|key| unkey(*key));
        blocks.zip(self.values.chunks_exact(NODES))
    }

    pub(super) fn values_of(&self, block: usize) -> &[f32] {
        &self.values[block * NODES..][..NODES]
    }

    /// Position of a node, metres; its coordinates may be fractional.
    pub(super) fn position(&self, node: Vec3) -> Vec3 {
        self.origin + node * self.cell_m
    }
}
