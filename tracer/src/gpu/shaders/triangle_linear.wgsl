// Linear search over few triangles.

fn nearest_triangle(prepared: PreparedRay, start: u32, hit: ptr<function, Hit>) {
    let own = own_triangle(prepared, start, hit);
    for (var i = 0u; i < TRIANGLE_COUNT; i++) {
        let t = triangle_t(prepared, i);
        if (t < (*hit).t && TRIANGLE_FIRST + i != own) {
            *hit = Hit(t, TRIANGLE_FIRST + i);
        }
    }
}
