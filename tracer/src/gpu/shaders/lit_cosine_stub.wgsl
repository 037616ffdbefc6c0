// Thin walls without clear coats that have normals of their own.

fn opaque_lit_cosine(n: vec3f, wi: vec3f) -> f32 {
    return dot(n, wi);
}
