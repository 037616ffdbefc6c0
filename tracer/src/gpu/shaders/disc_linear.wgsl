// Linear search over few discs; if they are coplanar, a single ray–plane intersection serves all of
// them.

fn nearest_disc(prepared: PreparedRay, start: u32, hit: ptr<function, Hit>) {
    if (DISCS_COPLANAR) {
        let t = plane_t(prepared.ray, scene.discs[0].center, scene.discs[0].normal);
        if (!(t > 0.0 && t < (*hit).t)) {
            return;
        }
        let index = disc_around(fma(vec3f(t), prepared.ray.direction, prepared.ray.origin), start);
        if (index < DISC_COUNT) {
            *hit = Hit(t, DISC_FIRST + index);
        }
        return;
    }
    for (var i = 0u; i < DISC_COUNT; i++) {
        let t = disc_t(prepared, i);
        if (t < (*hit).t && DISC_FIRST + i != start) {
            *hit = Hit(t, DISC_FIRST + i);
        }
    }
}

// The first disc that contains a point of their common plane; `DISC_COUNT` if there is none.
fn disc_around(point: vec3f, start: u32) -> u32 {
    for (var i = 0u; i < DISC_COUNT; i++) {
        let q = point - scene.discs[i].center;
        let radius = scene.discs[i].radius;
        if (dot(q, q) <= radius * radius && DISC_FIRST + i != start) {
            return i;
        }
    }
    return DISC_COUNT;
}
