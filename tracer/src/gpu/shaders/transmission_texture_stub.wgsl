// Thin walls without textures of their transmission.

fn transmission_texture() -> f32 {
    return 1.0;
}
