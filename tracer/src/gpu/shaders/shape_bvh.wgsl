// BVH traversal for a shape, whose name replaces `SHAPE`: each ray visits the nearer child first.
// The result is that of a linear search: of primitives at equal distance the one with the lowest
// number counts, in whatever order they are tested.

fn nearest_SHAPE(prepared: PreparedRay, start: u32, hit: ptr<function, Hit>) {
    let own = own_SHAPE(prepared, start, hit);
    let slack = origin_slack(prepared.ray);
    var stack: array<u32, BVH_DEPTH_MAX>;
    var height = 0u;
    var part = 0u;
    loop {
        if ((part & BVH_LEAF) != 0u) {
            nearest_in_SHAPE_leaf(prepared, part & ~BVH_LEAF, own, hit);
        } else {
            let node = scene.SHAPE_nodes[part];
            let left_t = part_entry(prepared, node.left_center, node.left_half, slack, (*hit).t);
            let right_t = part_entry(prepared, node.right_center, node.right_half, slack, (*hit).t);
            if (min(left_t, right_t) < T_MISS) {
                let is_left = left_t <= right_t;
                if (max(left_t, right_t) < T_MISS) {
                    // At most one child is pushed per level, so the stack holds at most
                    // BVH_DEPTH_MAX entries.
                    stack[height] = select(node.left, node.right, is_left);
                    height += 1u;
                }
                part = select(node.right, node.left, is_left);
                continue;
            }
        }
        if (height == 0u) {
            return;
        }
        height -= 1u;
        part = stack[height];
    }
}

fn nearest_in_SHAPE_leaf(prepared: PreparedRay, leaf: u32, own: u32, hit: ptr<function, Hit>) {
    for (var i = 0u; i < LEAF; i++) {
        let id = SHAPE_FIRST + SHAPE_of_leaf(leaf, i);
        let t = SHAPE_of_leaf_t(prepared, leaf, i);
        // The body that a ray is inside of was recorded as a hit before the search; no primitive at
        // the same distance replaces it for its lower number.
        let is_tie = t == (*hit).t && id < (*hit).primitive && (*hit).primitive != own;
        if ((t < (*hit).t || is_tie) && t < T_MISS && id != own) {
            *hit = Hit(t, id);
        }
    }
}
