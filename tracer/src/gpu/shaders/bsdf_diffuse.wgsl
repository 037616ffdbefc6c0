// Lambert alone: for scenes whose materials have no coat.

struct Bsdf {
    albedo: vec3f,
}

fn bsdf_at(surface: Surface, wo: vec3f) -> Bsdf {
    return Bsdf(surface.albedo);
}

fn bsdf_diffuse(bsdf: Bsdf, cos_i: f32) -> vec3f {
    return bsdf.albedo * (1.0 / PI);
}

fn bsdf_pdf(bsdf: Bsdf, cos_i: f32) -> f32 {
    return cos_i * (1.0 / PI);
}

fn bsdf_sample(bsdf: Bsdf, n: vec3f, wo: vec3f, u: vec3f) -> BsdfSample {
    let wi = cosine_hemisphere(n, u.y, u.z);
    let cos_i = sqrt(max(0.0, 1.0 - u.y));
    return BsdfSample(wi, bsdf.albedo, bsdf_pdf(bsdf, cos_i));
}
