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
    let u = abs(dot(q, scene.lamps[index].half_u)) * scene.lamps[index].inv_u2;
    let v = abs(dot(q, scene.lamps[index].half_v)) * scene.lamps[index].inv_v2;
    return select(T_MISS, t, t > 0.0 && u <= 1.0 && v <= 1.0);
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
        let u = abs(dot(q, scene.lamps[i].half_u)) * scene.lamps[i].inv_u2;
        let v = abs(dot(q, scene.lamps[i].half_v)) * scene.lamps[i].inv_v2;
        if (u <= 1.0 && v <= 1.0) {
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

// The density, per solid angle, with which next-event estimation finds a point of a lamp.
fn lamp_pdf(index: u32, distance_squared: f32, cos_lamp: f32) -> f32 {
    return distance_squared / (cos_lamp * scene.lamps[index].area * f32(LAMP_COUNT));
}

// What a ray that meets a lamp brings back: `bsdf_pdf` is the density of its direction, or
// `SPECULAR` where next-event estimation could not have found the lamp.
fn lamp_found(ray: Ray, hit: Hit, bsdf_pdf: f32) -> vec3f {
    let index = hit.primitive - LAMP_FIRST;
    let cos_lamp = -dot(ray.direction, scene.lamps[index].normal);
    if (cos_lamp <= 0.0) {
        return vec3f(0.0);
    }
    if (bsdf_pdf == SPECULAR) {
        return scene.lamps[index].radiance;
    }
    let weight = power_heuristic(bsdf_pdf, lamp_pdf(index, hit.t * hit.t, cos_lamp));
    return scene.lamps[index].radiance * weight;
}

// Next-event estimation from `surface`, times the BSDF and the cosine, MIS-weighted.
fn direct_light(
    surface: Surface,
    bsdf: Bsdf,
    wo: vec3f,
    skip: u32,
    u: vec3f,
    rays: ptr<function, u32>,
) -> vec3f {
    let index = min(u32(u.x * f32(LAMP_COUNT)), LAMP_COUNT - 1u);
    let point = scene.lamps[index].center
        + (2.0 * u.y - 1.0) * scene.lamps[index].half_u
        + (2.0 * u.z - 1.0) * scene.lamps[index].half_v;
    let to_light = point - surface.position;
    let distance_squared = dot(to_light, to_light);
    let distance = sqrt(distance_squared);
    let wi = to_light / distance;
    let cos_i = dot(surface.normal, wi);
    let cos_lamp = -dot(wi, scene.lamps[index].normal);
    let scattered = bsdf_eval(bsdf, surface.normal, wo, wi);
    let f = scattered.f;
    // Through a clear boundary lamps are seen from inside, and no lamp is inside.
    let is_lit = (cos_i > 0.0) != (bsdf_is_clear(bsdf) && surface.is_inside);
    if (!(is_lit && cos_lamp > 0.0) || all(f == vec3f(0.0))) {
        return vec3f(0.0);
    }
    *rays += 1u;
    if (occluded(Ray(surface.position, wi), skip, index, distance)) {
        return vec3f(0.0);
    }
    let pdf = lamp_pdf(index, distance_squared, cos_lamp);
    let weight = power_heuristic(pdf, scattered.pdf);
    return f * scene.lamps[index].radiance * (abs(cos_i) * weight / pdf);
}
