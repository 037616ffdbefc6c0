fn take_friction(node: u32, mass: i32) -> f32 {
    return FRICTION;
}

fn friction_of(node: u32) -> f32 {
    return FRICTION;
}
