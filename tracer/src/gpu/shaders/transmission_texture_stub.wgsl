// Stub for thin walls without transmission textures.

fn transmission_texture() -> f32 {
    return 1.0;
}
