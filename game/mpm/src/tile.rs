//! Overlap of a particle block's tile with the node blocks around it.

use crate::storage::{BLOCK_EDGE, TILE_EDGE};

/// Calls a function with each row along z of a node block that the tile of the particle block on a
/// side of it covers: the row's first node in the block and in the tile, and its length. Sides are counted as by [`crate::storage::neighbours`].
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

/// Nodes of a block along one axis that a tile covers.
struct Overlap {
    first: usize,
    end: usize,
    /// The first one's index in the tile.
    tile_first: usize,
}

impl Overlap {
    #[inline(always)]
    fn in_tile(&self, node: usize) -> usize {
        node - self.first + self.tile_first
    }
}

/// Of a particle block that is a block behind (0), at the same place (1) or a block ahead (2). Its
/// tile begins one node before it.
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
