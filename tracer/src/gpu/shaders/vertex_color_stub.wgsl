// Stub for meshes without vertex colours.

fn vertex_alpha(index: u32, weights: vec3f) -> f32 {
    return 1.0;
}
