// What the BVHs of all shapes share.

// Data that Rust writes: both halves of a part of a BVH, each a node, or with `BVH_LEAF` a leaf.
struct BvhNodeData {
    left_center: vec3f,
    left: u32,
    left_half: vec3f,
    right: u32,
    right_center: vec3f,
    right_half: vec3f,
}

// By how much a ray widens boxes for the rounding of its origin.
fn origin_slack(ray: Ray) -> f32 {
    return BVH_SLACK * largest(abs(ray.origin));
}

// Where a ray enters a part's box, `T_MISS` if it does not before `t_max`.
fn part_entry(prepared: PreparedRay, center: vec3f, half_extent: vec3f, slack: f32, t_max: f32) -> f32 {
    let half = half_extent + slack;
    let middle = fma(center, prepared.inverse, -prepared.origin_inverse);
    let enter = max(largest(fma(-half, prepared.inverse_abs, middle)), 0.0);
    let leave = smallest(fma(half, prepared.inverse_abs, middle));
    return select(T_MISS, enter, enter <= min(leave, t_max));
}
