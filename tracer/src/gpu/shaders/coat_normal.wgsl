// Clear coats with normals of their own. Functions that are wrapped here are renamed to `base_…` in
// `metallic_roughness.wgsl` and to `coaxial_…` in `layers.wgsl`.

fn coat_normal_beside(n: vec3f) -> vec3f {
    return select(n, coat_normal, any(coat_normal != vec3f(0.0)));
}

// The cosine of incident light: to the base's normal or to the coat's, whichever is larger.
fn lit_cosine(n: vec3f, wi: vec3f) -> f32 {
    return max(dot(n, wi), dot(coat_normal_beside(n), wi));
}

// Converts a contribution to `lit_cosine`, by which callers multiply: the ratio of the cosine
// `cos_i` to it.
fn lit_share(cos_i: f32, n: vec3f, wi: vec3f) -> f32 {
    return max(cos_i, 0.0) / max(lit_cosine(n, wi), 1e-30);
}

// The mirror direction of `wo`; if it is below the normal `n`, a direction that contributes
// nothing.
fn reflected_above(n: vec3f, h: vec3f, wo: vec3f) -> vec3f {
    let wi = reflected_by(h, wo);
    return select(-wo, wi, dot(n, wi) > 0.0);
}

fn with_layers(base: Evaluated, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    return with_sheen(base, n, wo, wi);
}

// The coat may face directions that the base does not.
fn bsdf_eval(bsdf: Bsdf, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    let below = base_bsdf_eval(bsdf, n, wo, wi);
    if (!metallic_roughness.is_met) {
        return below;
    }
    return with_clearcoat(below, n, wo, wi);
}
