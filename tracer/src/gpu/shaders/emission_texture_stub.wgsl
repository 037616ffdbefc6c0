// Stub for scenes without image textures.

fn emission_texture(index: u32, weights: vec3f) -> vec3f {
    return vec3f(1.0);
}
