// A scene without lamps.

fn lamp_found(ray: Ray, hit: Hit, bsdf_pdf: f32) -> vec3f {
    return vec3f(0.0);
}

fn direct_light(
    surface: Surface,
    bsdf: Bsdf,
    wo: vec3f,
    skip: u32,
    u: vec3f,
    rays: ptr<function, u32>,
) -> vec3f {
    return vec3f(0.0);
}
