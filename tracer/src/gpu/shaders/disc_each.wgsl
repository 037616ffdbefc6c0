// Few discs: each ray meets each of them.

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
        let t = disc_t(line, i);
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
        if (disc_t(line, i) < t_max && DISC_FIRST + i != skip) {
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
