// Stubs for glTF materials without clear coats and sheens.

fn regularise_layers() {}

fn with_layers(base: Evaluated, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    return base;
}

fn sample_coat(n: vec3f, wo: vec3f, u: ptr<function, vec3f>) -> vec3f {
    return vec3f(0.0);
}
