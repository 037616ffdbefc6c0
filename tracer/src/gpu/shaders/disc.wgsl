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

fn nearest_disc(line: Line, skip: u32, hit: ptr<function, Hit>) {
    if (DISCS_COPLANAR) {
        let t = plane_t(line.ray, scene.discs[0].center, scene.discs[0].normal);
        if (!(t > 0.0 && t < (*hit).t)) {
            return;
        }
        let index = disc_around(fma(vec3f(t), line.ray.direction, line.ray.origin), skip);
        if (index < DISC_COUNT) {
            *hit = Hit(t, DISC_FIRST + index);
        }
        return;
    }
    for (var i = 0u; i < DISC_COUNT; i++) {
        let t = disc_t(line.ray, i);
        if (t < (*hit).t && DISC_FIRST + i != skip) {
            *hit = Hit(t, DISC_FIRST + i);
        }
    }
}

fn disc_occludes(line: Line, skip: u32, t_max: f32) -> bool {
    if (DISCS_COPLANAR) {
        let t = plane_t(line.ray, scene.discs[0].center, scene.discs[0].normal);
        if (!(t > 0.0 && t < t_max)) {
            return false;
        }
        let index = disc_around(fma(vec3f(t), line.ray.direction, line.ray.origin), skip);
        return index < DISC_COUNT;
    }
    for (var i = 0u; i < DISC_COUNT; i++) {
        if (disc_t(line.ray, i) < t_max && DISC_FIRST + i != skip) {
            return true;
        }
    }
    return false;
}

// The first disc around a point of their common plane, `DISC_COUNT` if there is none.
fn disc_around(point: vec3f, skip: u32) -> u32 {
    for (var i = 0u; i < DISC_COUNT; i++) {
        let q = point - scene.discs[i].center;
        let radius = scene.discs[i].radius;
        if (dot(q, q) <= radius * radius && DISC_FIRST + i != skip) {
            return i;
        }
    }
    return DISC_COUNT;
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
