// Clear coats with normals of their own. What it has a namesake of is renamed in `metallic_roughness.wgsl` to `base_`, in
// `layers.wgsl` to `coaxial_`.

fn coat_normal_beside(n: vec3f) -> vec3f {
    return select(n, coat_normal, any(coat_normal != vec3f(0.0)));
}

// The cosine at which light falls in: to the base's normal or, where it is larger, to the coat's own.
fn lit_cosine(n: vec3f, wi: vec3f) -> f32 {
    return max(dot(n, wi), dot(coat_normal_beside(n), wi));
}

// What light brings at another cosine of light that falls in, over what it would at that one.
fn lit_share(cos_i: f32, n: vec3f, wi: vec3f) -> f32 {
    return max(cos_i, 0.0) / max(lit_cosine(n, wi), 1e-30);
}

// The mirror image of `wo`; below the reflection's own normal `n` another direction, of which nothing comes.
fn reflected_above(n: vec3f, h: vec3f, wo: vec3f) -> vec3f {
    let wi = reflected_by(h, wo);
    return select(-wo, wi, dot(n, wi) > 0.0);
}

fn with_layers(base: Evaluated, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    return with_sheen(base, n, wo, wi);
}

// The coat may face directions that what is below does not.
fn bsdf_eval(bsdf: Bsdf, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    let below = base_bsdf_eval(bsdf, n, wo, wi);
    if (!metallic_roughness.is_met) {
        return below;
    }
    return with_clearcoat(below, n, wo, wi);
}
