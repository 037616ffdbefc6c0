// Factors of a material's parameters from image textures.

struct TextureFactors {
    base_color: vec3f,
    roughness: f32,
    emission: vec3f,
    metallic: f32,
    clearcoat: f32,
    clearcoat_roughness: f32,
}

const NO_TEXTURES: TextureFactors = TextureFactors(vec3f(1.0), 1.0, vec3f(1.0), 1.0, 1.0, 1.0);
