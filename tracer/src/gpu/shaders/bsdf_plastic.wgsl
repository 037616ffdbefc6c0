// Lambert, bare or under a smooth dielectric coat (see `Material::SmoothPlastic`). A bare surface
// has an index of refraction of 0 and reflects nothing like a mirror.

struct Bsdf {
    // albedo · diffuse_scale · (1 − F(cos θo))
    base: vec3f,
    ior: f32,
    // F(cos θo)
    mirror: f32,
    // Probability with which the mirror is sampled.
    mirror_share: f32,
}

// Unpolarised Fresnel reflectance from outside; 0 for an index of 0.
fn fresnel_dielectric(cos_theta: f32, eta: f32) -> f32 {
    let cos_i = clamp(cos_theta, 0.0, 1.0);
    // η²cos²θt = (η²−1) + cos²θi, so that an index of 1 reflects exactly nothing.
    let cos_t = sqrt(max(0.0, (eta - 1.0) * (eta + 1.0) + cos_i * cos_i)) / eta;
    // No coat, or an index of 1 at grazing incidence: there is no surface.
    if (eta == 0.0 || (cos_i == 0.0 && cos_t == 0.0)) {
        return 0.0;
    }
    let parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    let perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    return 0.5 * (parallel * parallel + perpendicular * perpendicular);
}

fn bsdf_at(surface: Surface, wo: vec3f) -> Bsdf {
    let ior = scene.materials[surface.material].ior;
    let mirror = fresnel_dielectric(dot(surface.normal, wo), ior);
    let mean_albedo = (surface.albedo.x + surface.albedo.y + surface.albedo.z) * (1.0 / 3.0);
    let base = (1.0 - mirror) * mean_albedo;
    let share = select(0.0, mirror / (mirror + base), mirror > 0.0);
    let scale = scene.materials[surface.material].diffuse_scale * (1.0 - mirror);
    return Bsdf(surface.albedo * scale, ior, mirror, share);
}

// The diffuse lobe's f.
fn bsdf_diffuse(bsdf: Bsdf, cos_i: f32) -> vec3f {
    return bsdf.base * ((1.0 - fresnel_dielectric(cos_i, bsdf.ior)) * (1.0 / PI));
}

fn bsdf_pdf(bsdf: Bsdf, cos_i: f32) -> f32 {
    return (1.0 - bsdf.mirror_share) * cos_i * (1.0 / PI);
}

fn bsdf_sample(bsdf: Bsdf, n: vec3f, wo: vec3f, u: vec3f) -> BsdfSample {
    if (u.x < bsdf.mirror_share) {
        let wi = 2.0 * dot(n, wo) * n - wo;
        return BsdfSample(wi, vec3f(bsdf.mirror / bsdf.mirror_share), SPECULAR);
    }
    let wi = cosine_hemisphere(n, u.y, u.z);
    let cos_i = sqrt(max(0.0, 1.0 - u.y));
    let transmitted = 1.0 - fresnel_dielectric(cos_i, bsdf.ior);
    let weight = bsdf.base * (transmitted / (1.0 - bsdf.mirror_share));
    return BsdfSample(wi, weight, bsdf_pdf(bsdf, cos_i));
}
