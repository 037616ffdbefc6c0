// Linear search over few rectangles.

fn nearest_rectangle(prepared: PreparedRay, start: u32, hit: ptr<function, Hit>) {
    for (var i = 0u; i < RECTANGLE_COUNT; i++) {
        let t = rectangle_t(prepared, i);
        if (t < (*hit).t && RECTANGLE_FIRST + i != start) {
            *hit = Hit(t, RECTANGLE_FIRST + i);
        }
    }
}
