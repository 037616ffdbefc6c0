// The sheen of napped cloth (see `sheen.rs`); its strength includes the factor 1/(2π).

fn sheen(material: u32, n: vec3f, wo: vec3f, wi: vec3f) -> vec3f {
    let strength = scene_storage.materials[material].sheen;
    let cos_o = dot(n, wo);
    let cos_i = dot(n, wi);
    if (all(strength == vec3f(0.0)) || cos_o <= 0.0 || cos_i <= 0.0) {
        return vec3f(0.0);
    }
    let exponent = 1.0 / scene_storage.materials[material].sheen_roughness;
    let h = wo + wi;
    let along = dot(h, n);
    // sin² between half vector and normal, without normalising the half vector; the lower bound
    // keeps the logarithm finite.
    let sine2 = clamp(1.0 - along * along / dot(h, h), 1e-12, 1.0);
    let power = exp2(0.5 * exponent * log2(sine2));
    return strength * ((2.0 + exponent) * power / (4.0 * (cos_o + cos_i - cos_o * cos_i)));
}

fn napped_eval(layered: Layered, material: u32, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    let base = layered_eval(layered, dot(n, wi));
    return Evaluated(base.f + sheen(material, n, wo, wi), base.pdf);
}

fn napped_sample(layered: Layered, material: u32, n: vec3f, wo: vec3f, u: vec3f) -> BsdfSample {
    let base = layered_sample(layered, n, wo, u);
    // Cloth has no coat, so the density is that of cosine-weighted sampling.
    return BsdfSample(base.wi, base.weight + PI * sheen(material, n, wo, base.wi), base.pdf);
}
