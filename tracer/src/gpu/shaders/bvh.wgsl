// Definitions shared by the BVHs of all shapes.

// Layout as in Rust: both children of a node, each the index of a node, or of a leaf if `BVH_LEAF`
// is set.
struct BvhNodeData {
    left_center: vec3f,
    left: u32,
    left_half: vec3f,
    right: u32,
    right_center: vec3f,
    right_half: vec3f,
}

// The amount by which a ray enlarges boxes to account for the rounding of its origin.
fn origin_slack(ray: Ray) -> f32 {
    return BVH_SLACK * largest(abs(ray.origin));
}

// Distance at which a ray enters a child's box; `T_MISS` if it does not before `t_max`.
fn part_entry(prepared: PreparedRay, center: vec3f, half_extent: vec3f, slack: f32, t_max: f32) -> f32 {
    let half = half_extent + slack;
    let middle = fma(center, prepared.inverse, -prepared.origin_inverse);
    let enter = max(largest(fma(-half, prepared.inverse_abs, middle)), 0.0);
    let leave = smallest(fma(half, prepared.inverse_abs, middle));
    return select(T_MISS, enter, enter <= min(leave, t_max));
}
