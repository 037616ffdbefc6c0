// Stub for scenes in which light sampling does not include emissive surfaces.

fn emission_weight(primitive: u32, material: u32, origin: vec3f, t: f32, cosine: f32) -> f32 {
    return 1.0;
}
