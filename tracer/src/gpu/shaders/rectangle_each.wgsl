// Few rectangles: each ray meets each of them.

fn nearest_rectangle(line: Line, skip: u32, hit: ptr<function, Hit>) {
    for (var i = 0u; i < RECTANGLE_COUNT; i++) {
        let t = rectangle_t(line, i);
        if (t < (*hit).t && RECTANGLE_FIRST + i != skip) {
            *hit = Hit(t, RECTANGLE_FIRST + i);
        }
    }
}

fn rectangle_occludes(line: Line, skip: u32, t_max: f32) -> bool {
    for (var i = 0u; i < RECTANGLE_COUNT; i++) {
        if (rectangle_t(line, i) < t_max && RECTANGLE_FIRST + i != skip) {
            return true;
        }
    }
    return false;
}
