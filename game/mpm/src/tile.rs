//! Overlap of a particle block's tile with the node blocks around it.

use crate::storage::{BLOCK_EDGE, TILE_EDGE};

/// Calls a function for each row along z of a node block that is covered by the tile of a neighbouring
/// particle block, with the index of the row's first node in the block, that in the tile, and the row's
/// length. `side` is the neighbour's index in the order of [`crate::storage::neighbours`].
#[inline(always)]
pub(crate) fn for_each_row(side: usize, mut call: impl FnMut(usize, usize, usize)) {
    let [x, y, z] = [side / 9, side / 3 % 3, side % 3].map(overlap);
    for i in x.first..x.end {
        for j in y.first..y.end {
            let row = (i * BLOCK_EDGE as usize + j) * BLOCK_EDGE as usize + z.first;
            let start = (x.in_tile(i) * TILE_EDGE + y.in_tile(j)) * TILE_EDGE + z.tile_first;
            call(row, start, z.end - z.first);
        }
    }
}

/// The nodes of a block along one axis that a tile covers: `first..end`.
struct Overlap {
    first: usize,
    end: usize,
    /// Index in the tile of the first one.
    tile_first: usize,
}

impl Overlap {
    #[inline(always)]
    fn in_tile(&self, node: usize) -> usize {
        node - self.first + self.tile_first
    }
}

/// Overlap with the tile of a particle block that is one block lower (0), at the same coordinate (1) or one
/// block higher (2) along an axis. A tile begins one node before its block and ends three nodes past its
/// last.
#[inline(always)]
fn overlap(side: usize) -> Overlap {
    let (first, end, tile_first) = match side {
        0 => (0, 3, 5),
        1 => (0, 4, 1),
        _ => (3, 4, 0),
    };
    Overlap {
        first,
        end,
        tile_first,
    }
}
