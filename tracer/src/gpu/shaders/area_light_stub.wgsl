// A scene without area lights.

fn emission_with_mis(ray: Ray, hit: Hit, pdf: f32) -> vec3f {
    return vec3f(0.0);
}

fn coat_reflected_light(
    surface: Surface,
    bsdf: Bsdf,
    wo: vec3f,
    start: u32,
    rays: ptr<function, u32>,
) -> vec3f {
    return vec3f(0.0);
}

fn direct_light(
    surface: Surface,
    bsdf: Bsdf,
    wo: vec3f,
    start: u32,
    u: vec2f,
    cone_density: f32,
    rays: ptr<function, u32>,
    light_weight_sum: ptr<function, f32>,
) -> vec3f {
    return vec3f(0.0);
}
