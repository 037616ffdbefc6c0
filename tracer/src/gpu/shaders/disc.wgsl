// Round plates.

fn disc_t(ray: Ray, index: u32) -> f32 {
    let to_center = scene.discs[index].center - ray.origin;
    let normal = scene.discs[index].normal;
    let slope = dot(ray.direction, normal);
    if (slope == 0.0) {
        return T_MISS;
    }
    let t = dot(to_center, normal) / slope;
    let q = fma(vec3f(t), ray.direction, -to_center);
    let radius = scene.discs[index].radius;
    return select(T_MISS, t, t > 0.0 && dot(q, q) <= radius * radius);
}

fn nearest_disc(ray: Ray, skip: u32, hit: ptr<function, Hit>) {
    for (var i = 0u; i < DISC_COUNT; i++) {
        let t = disc_t(ray, i);
        if (t < (*hit).t && DISC_FIRST + i != skip) {
            *hit = Hit(t, DISC_FIRST + i);
        }
    }
}

fn disc_occludes(ray: Ray, skip: u32, t_max: f32) -> bool {
    for (var i = 0u; i < DISC_COUNT; i++) {
        if (disc_t(ray, i) < t_max && DISC_FIRST + i != skip) {
            return true;
        }
    }
    return false;
}

fn disc_surface(ray: Ray, t: f32, index: u32, is_within: bool) -> Surface {
    let disc = scene.discs[index];
    return Surface(
        fma(vec3f(t), ray.direction, ray.origin),
        select(disc.normal, -disc.normal, dot(disc.normal, ray.direction) > 0.0),
        scene.materials[disc.material].albedo,
        disc.material,
        false,
    );
}
