// Many balls: each ray goes down the tree, the nearer half of each part first. Pictures are those of
// `sphere_each.wgsl`: of balls at one distance the first counts, in whatever order they are met.

// Data that Rust writes. Both halves of a part of the tree: a node, or with `TREE_LEAF` a leaf.
struct TreeNode {
    left_center: vec3f,
    left: u32,
    left_half: vec3f,
    right: u32,
    right_center: vec3f,
    right_half: vec3f,
}

struct TreeLeaf {
    // Centre and radius.
    balls: array<vec4f, LEAF_BALLS>,
    ids: vec4u,
}

// Where a ray enters a part's box, `T_MISS` if it does not before `t_max`.
fn part_entry(line: Line, center: vec3f, half: vec3f, t_max: f32) -> f32 {
    let middle = fma(center, line.inverse, -line.origin_inverse);
    let enter = max(largest(fma(-half, line.inverse_abs, middle)), 0.0);
    let leave = smallest(fma(half, line.inverse_abs, middle));
    return select(T_MISS, enter, enter <= min(leave, t_max));
}

fn nearest_sphere(line: Line, skip: u32, hit: ptr<function, Hit>) {
    let own = own_sphere(line, skip, hit);
    var stack: array<u32, TREE_DEPTH_MAX>;
    var height = 0u;
    var part = 0u;
    loop {
        if ((part & TREE_LEAF) != 0u) {
            nearest_in_leaf(line, part & ~TREE_LEAF, own, hit);
        } else {
            let node = scene.tree_nodes[part];
            let left_t = part_entry(line, node.left_center, node.left_half, (*hit).t);
            let right_t = part_entry(line, node.right_center, node.right_half, (*hit).t);
            if (min(left_t, right_t) < T_MISS) {
                let is_left = left_t <= right_t;
                if (max(left_t, right_t) < T_MISS) {
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

fn nearest_in_leaf(line: Line, leaf: u32, own: u32, hit: ptr<function, Hit>) {
    for (var i = 0u; i < LEAF_BALLS; i++) {
        let ball = scene.tree_leaves[leaf].balls[i];
        let id = scene.tree_leaves[leaf].ids[i];
        let t = sphere_t(line.ray, ball.xyz, ball.w);
        let is_tie = t == (*hit).t && id < (*hit).primitive && (*hit).primitive != own;
        if ((t < (*hit).t || is_tie) && t < T_MISS && id != own) {
            *hit = Hit(t, id);
        }
    }
}

fn sphere_occludes(line: Line, skip: u32, t_max: f32) -> bool {
    var stack: array<u32, TREE_DEPTH_MAX>;
    var height = 0u;
    var part = 0u;
    loop {
        if ((part & TREE_LEAF) != 0u) {
            let leaf = part & ~TREE_LEAF;
            for (var i = 0u; i < LEAF_BALLS; i++) {
                let ball = scene.tree_leaves[leaf].balls[i];
                let t = sphere_t(line.ray, ball.xyz, ball.w);
                if (t < t_max && scene.tree_leaves[leaf].ids[i] != skip) {
                    return true;
                }
            }
        } else {
            let node = scene.tree_nodes[part];
            let is_left = part_entry(line, node.left_center, node.left_half, t_max) < T_MISS;
            let is_right = part_entry(line, node.right_center, node.right_half, t_max) < T_MISS;
            if (is_left || is_right) {
                if (is_left && is_right) {
                    stack[height] = node.right;
                    height += 1u;
                }
                part = select(node.right, node.left, is_left);
                continue;
            }
        }
        if (height == 0u) {
            return false;
        }
        height -= 1u;
        part = stack[height];
    }
    return false;
}
