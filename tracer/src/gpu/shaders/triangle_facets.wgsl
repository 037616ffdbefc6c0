// Stub for textured meshes without vertex normals.

fn interpolated_normal(index: u32, weights: vec3f) -> vec3f {
    return vec3f(0.0);
}
