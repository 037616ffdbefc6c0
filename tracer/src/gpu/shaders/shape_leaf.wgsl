// A leaf is the indices of its primitives, the last one's repeated.

fn SHAPE_of_leaf(leaf: u32, i: u32) -> u32 {
    return scene.SHAPE_leaves[leaf][i];
}

fn SHAPE_of_leaf_t(line: Line, leaf: u32, i: u32) -> f32 {
    return SHAPE_t(line, scene.SHAPE_leaves[leaf][i]);
}
