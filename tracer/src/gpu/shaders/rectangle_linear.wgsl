// Few rectangles: each ray meets each of them.

fn nearest_rectangle(prepared: PreparedRay, start: u32, hit: ptr<function, Hit>) {
    for (var i = 0u; i < RECTANGLE_COUNT; i++) {
        let t = rectangle_t(prepared, i);
        if (t < (*hit).t && RECTANGLE_FIRST + i != start) {
            *hit = Hit(t, RECTANGLE_FIRST + i);
        }
    }
}

fn rectangle_occludes(prepared: PreparedRay, start: u32, t_max: f32) -> bool {
    for (var i = 0u; i < RECTANGLE_COUNT; i++) {
        if (rectangle_t(prepared, i) < t_max && RECTANGLE_FIRST + i != start) {
            return true;
        }
    }
    return false;
}
