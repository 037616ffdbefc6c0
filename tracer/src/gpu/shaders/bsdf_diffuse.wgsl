// Lambertian reflection only, for scenes whose materials have no coat.

struct Layered {
    albedo: vec3f,
}

fn layered_at(surface: Surface, wo: vec3f) -> Layered {
    return Layered(surface.albedo);
}

fn layered_mirror(layered: Layered) -> f32 {
    return 0.0;
}

fn layered_eval(layered: Layered, cos_i: f32) -> Evaluated {
    let cos_up = max(cos_i, 0.0);
    return Evaluated(layered.albedo * select(0.0, 1.0 / PI, cos_i > 0.0), cos_up * (1.0 / PI));
}

fn layered_sample(layered: Layered, n: vec3f, wo: vec3f, u: vec3f) -> BsdfSample {
    let wi = cosine_hemisphere(n, u.y, u.z);
    let cos_i = sqrt(max(0.0, 1.0 - u.y));
    return BsdfSample(wi, layered.albedo, cos_i * (1.0 / PI));
}
