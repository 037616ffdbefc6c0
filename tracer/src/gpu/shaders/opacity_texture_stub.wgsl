// Stub for scenes without image textures.

fn texture_alpha(index: u32, weights: vec3f) -> f32 {
    return 1.0;
}
