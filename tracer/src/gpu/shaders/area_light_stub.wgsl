// Stubs for scenes without area lights.

fn emission_with_mis(ray: Ray, hit: Hit, pdf: f32) -> vec3f {
    return vec3f(0.0);
}

fn meets_area_light(ray: Ray) -> bool {
    return false;
}

fn coat_reflected_light(surface: Surface, bsdf: Bsdf, wo: vec3f) -> ShadowRay {
    return NO_SHADOW_RAY;
}

fn direct_light(
    surface: Surface,
    bsdf: Bsdf,
    wo: vec3f,
    u: vec2f,
    cone_density: f32,
    light_weight_sum: ptr<function, f32>,
) -> ShadowRay {
    return NO_SHADOW_RAY;
}
