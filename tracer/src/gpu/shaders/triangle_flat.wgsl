// Stub for meshes with neither vertex normals nor textures.

fn triangle_shading_normal(index: u32, weights: vec3f, normal: vec3f, wo: vec3f, t: f32) -> vec3f {
    return normal;
}
