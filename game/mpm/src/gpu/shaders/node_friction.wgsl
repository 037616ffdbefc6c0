@group(0) @binding(8) var<storage, read_write> friction_sums: array<i32>;
@group(0) @binding(9) var<storage, read_write> frictions: array<f32>;

// Mean coefficient of friction of a node with a mass in quanta; stores it and clears its sum. A quantum of
// friction is 16 of mass.
fn take_friction(node: u32, mass: i32) -> f32 {
    let friction = 16.0 * f32(friction_sums[node]) / f32(mass);
    friction_sums[node] = 0;
    frictions[node] = friction;
    return friction;
}

fn friction_of(node: u32) -> f32 {
    return frictions[node];
}
