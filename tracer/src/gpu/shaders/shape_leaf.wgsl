// A leaf contains the indices of its primitives; the last one is repeated.

fn SHAPE_of_leaf(leaf: u32, i: u32) -> u32 {
    return scene.SHAPE_leaves[leaf][i];
}

fn SHAPE_of_leaf_t(prepared: PreparedRay, leaf: u32, i: u32) -> f32 {
    return SHAPE_t(prepared, scene.SHAPE_leaves[leaf][i]);
}
