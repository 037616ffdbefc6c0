// Clear coats with the normals of what is below.

fn coat_normal_beside(n: vec3f) -> vec3f {
    return n;
}

fn lit_share(cos_i: f32, n: vec3f, wi: vec3f) -> f32 {
    return 1.0;
}
