// Many of a shape, whose name stands for `SHAPE`: each ray goes down their BVH, the nearer half of each
// part first. Pictures are those of each by itself: of primitives at one distance the first counts, in
// whatever order they are met.

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
                    // At most one half is left behind on each level, so that the stack never holds more
                    // than BVH_DEPTH_MAX.
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
        // The body that a ray is inside of was met first, without a search; no primitive at its far
        // side's distance takes its place by a smaller number.
        let is_tie = t == (*hit).t && id < (*hit).primitive && (*hit).primitive != own;
        if ((t < (*hit).t || is_tie) && t < T_MISS && id != own) {
            *hit = Hit(t, id);
        }
    }
}
