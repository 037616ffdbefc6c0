// Lambertian reflection, plain or under a dielectric coat (see `Material::SmoothPlastic`). A plain
// surface has an index of refraction of 0 and no mirror reflection.

struct Layered {
    // albedo · diffuse_scale · (1 − F(cos θo))
    base: vec3f,
    ior: f32,
    // F(cos θo)
    mirror: f32,
    // Probability with which the mirror is sampled.
    mirror_share: f32,
}

fn layered_at(surface: Surface, wo: vec3f) -> Layered {
    let ior = scene_storage.materials[surface.material].ior;
    let mirror = coat_reflectance(surface.material, surface.normal, wo, ior);
    let mean_albedo = (surface.albedo.x + surface.albedo.y + surface.albedo.z) * (1.0 / 3.0);
    let base = (1.0 - mirror) * mean_albedo;
    let share = select(0.0, mirror / (mirror + base), mirror > 0.0);
    let scale = scene_storage.materials[surface.material].diffuse_scale * (1.0 - mirror);
    return Layered(surface.albedo * scale, ior, mirror, share);
}

fn layered_mirror(layered: Layered) -> f32 {
    return layered.mirror;
}

fn layered_eval(layered: Layered, cos_i: f32) -> Evaluated {
    if (cos_i <= 0.0) {
        return Evaluated(vec3f(0.0), 0.0);
    }
    let passed = (1.0 - fresnel_dielectric(cos_i, layered.ior)) * (1.0 / PI);
    return Evaluated(layered.base * passed, layered_pdf(layered, cos_i));
}

fn layered_pdf(layered: Layered, cos_i: f32) -> f32 {
    return (1.0 - layered.mirror_share) * cos_i * (1.0 / PI);
}

// `u.y` selects the lobe and is then rescaled to [0, 1).
fn layered_sample(layered: Layered, n: vec3f, wo: vec3f, u: vec3f) -> BsdfSample {
    if (u.y < layered.mirror_share) {
        return BsdfSample(mirrored(n, wo), vec3f(layered.mirror / layered.mirror_share), 0.0);
    }
    let stretched = max(0.0, (u.y - layered.mirror_share) / (1.0 - layered.mirror_share));
    let wi = cosine_hemisphere(n, stretched, u.z);
    let cos_i = sqrt(max(0.0, 1.0 - stretched));
    let transmitted = 1.0 - fresnel_dielectric(cos_i, layered.ior);
    let weight = layered.base * (transmitted / (1.0 - layered.mirror_share));
    return BsdfSample(wi, weight, layered_pdf(layered, cos_i));
}
