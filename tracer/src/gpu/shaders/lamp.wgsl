// Lamps: rectangles that end every ray and emit from one side.

fn lamp_t(ray: Ray, index: u32) -> f32 {
    let to_center = scene.lamps[index].center - ray.origin;
    let normal = scene.lamps[index].normal;
    let slope = dot(ray.direction, normal);
    if (slope == 0.0) {
        return T_MISS;
    }
    let t = dot(to_center, normal) / slope;
    let q = fma(vec3f(t), ray.direction, -to_center);
    let u = abs(dot(q, scene.lamps[index].axis_u));
    let v = abs(dot(q, scene.lamps[index].axis_v));
    return select(T_MISS, t, t > 0.0 && u <= scene.lamps[index].length_u && v <= scene.lamps[index].length_v);
}

// No ray starts on a lamp, so that there is none to skip.
fn nearest_lamp(line: Line, skip: u32, hit: ptr<function, Hit>) {
    if (LAMPS_COPLANAR) {
        nearest_lamp_of_plane(line.ray, hit);
        return;
    }
    for (var i = 0u; i < LAMP_COUNT; i++) {
        let t = lamp_t(line.ray, i);
        if (t < (*hit).t) {
            *hit = Hit(t, LAMP_FIRST + i);
        }
    }
}

fn nearest_lamp_of_plane(ray: Ray, hit: ptr<function, Hit>) {
    let t = plane_t(ray, scene.lamps[0].center, scene.lamps[0].normal);
    if (!(t > 0.0 && t < (*hit).t)) {
        return;
    }
    let point = fma(vec3f(t), ray.direction, ray.origin);
    for (var i = 0u; i < LAMP_COUNT; i++) {
        let q = point - scene.lamps[i].center;
        let u = abs(dot(q, scene.lamps[i].axis_u));
        let v = abs(dot(q, scene.lamps[i].axis_v));
        if (u <= scene.lamps[i].length_u && v <= scene.lamps[i].length_v) {
            *hit = Hit(t, LAMP_FIRST + i);
            return;
        }
    }
}

// Whether another lamp than the one that is asked for is in the way.
fn lamp_occludes(ray: Ray, target_lamp: u32, t_max: f32) -> bool {
    for (var i = 0u; i < LAMP_COUNT; i++) {
        if (i != target_lamp && lamp_t(ray, i) < t_max) {
            return true;
        }
    }
    return false;
}

// What a ray that meets a lamp brings back: `pdf` is that of `Path`.
fn lamp_found(ray: Ray, hit: Hit, pdf: f32) -> vec3f {
    let index = hit.primitive - LAMP_FIRST;
    let brightness = scene.lamps[index].brightness;
    if (dot(ray.direction, scene.lamps[index].normal) >= 0.0 || brightness == 0.0 || pdf == 0.0) {
        return vec3f(0.0);
    }
    if (pdf < 0.0) {
        return scene.lamps[index].radiance;
    }
    return scene.lamps[index].radiance * power_heuristic(brightness / pdf);
}

// Light of the lamp that a coat reflects.
fn mirrored_light(
    surface: Surface,
    bsdf: Bsdf,
    wo: vec3f,
    skip: u32,
    rays: ptr<function, u32>,
) -> vec3f {
    let reflectance = bsdf_coat(bsdf);
    if (reflectance == 0.0) {
        return vec3f(0.0);
    }
    let wi = 2.0 * dot(surface.normal, wo) * surface.normal - wo;
    let ray = Ray(surface.position, wi);
    var hit = Hit(T_MISS, NO_PRIMITIVE);
    nearest_lamp(line_of(ray), skip, &hit);
    if (hit.primitive == NO_PRIMITIVE) {
        return vec3f(0.0);
    }
    let index = hit.primitive - LAMP_FIRST;
    if (dot(wi, scene.lamps[index].normal) >= 0.0) {
        return vec3f(0.0);
    }
    *rays += 1u;
    if (occluded(ray, skip, index, hit.t)) {
        return vec3f(0.0);
    }
    return reflectance * scene.lamps[index].radiance;
}

// Next-event estimation from `surface`, times the BSDF and the cosine, MIS-weighted.
fn direct_light(
    surface: Surface,
    bsdf: Bsdf,
    wo: vec3f,
    skip: u32,
    u: vec2f,
    rays: ptr<function, u32>,
    light_sum: ptr<function, f32>,
) -> vec3f {
    let chosen = choose_lamp(surface.position, u);
    *light_sum = chosen.light_sum;
    if (chosen.weight == 0.0) {
        return vec3f(0.0);
    }
    let direction = sample_lamp(see_lamp(chosen.index, surface.position), chosen);
    let cos_i = dot(surface.normal, direction.wi);
    let scattered = bsdf_eval(bsdf, surface.normal, wo, direction.wi);
    let f = scattered.f;
    // Through a clear boundary lamps are seen from inside, and no lamp is inside.
    let is_lit = (cos_i > 0.0) != (bsdf_is_clear(bsdf) && surface.is_inside);
    if (!is_lit || all(f == vec3f(0.0))) {
        return vec3f(0.0);
    }
    *rays += 1u;
    if (occluded(Ray(surface.position, direction.wi), skip, chosen.index, direction.distance)) {
        return vec3f(0.0);
    }
    let inverse_probability = chosen.light_sum / chosen.weight;
    let weight = power_heuristic(scattered.pdf * chosen.omega * inverse_probability);
    let inverse_pdf = direction.inverse_pdf * inverse_probability;
    return f * scene.lamps[chosen.index].radiance * (abs(cos_i) * weight * inverse_pdf);
}
