// Stubs for scenes without napped cloth.

fn napped_eval(layered: Layered, material: u32, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    return layered_eval(layered, dot(n, wi));
}

fn napped_sample(layered: Layered, material: u32, n: vec3f, wo: vec3f, u: vec3f) -> BsdfSample {
    return layered_sample(layered, n, wo, u);
}
