// Stub for thin walls without coat normals.

fn opaque_lit_cosine(n: vec3f, wi: vec3f) -> f32 {
    return dot(n, wi);
}
