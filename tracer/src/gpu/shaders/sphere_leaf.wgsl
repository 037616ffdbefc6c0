// The spheres of a leaf are stored next to their indices, the last one repeated; this is a quarter
// faster than looking them up.

struct SphereLeaf {
    // Centre (xyz) and radius (w).
    balls: array<vec4f, LEAF>,
    indices: vec4u,
}

fn sphere_of_leaf(leaf: u32, i: u32) -> u32 {
    return scene.sphere_leaves[leaf].indices[i];
}

fn sphere_of_leaf_t(prepared: PreparedRay, leaf: u32, i: u32) -> f32 {
    let ball = scene.sphere_leaves[leaf].balls[i];
    return ball_t(prepared.ray, ball.xyz, ball.w);
}
