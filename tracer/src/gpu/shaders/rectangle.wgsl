// Rectangles.

fn rectangle_t(ray: Ray, index: u32) -> f32 {
    let to_center = scene.rectangles[index].center - ray.origin;
    let normal = scene.rectangles[index].normal;
    let slope = dot(ray.direction, normal);
    if (slope == 0.0) {
        return T_MISS;
    }
    let t = dot(to_center, normal) / slope;
    let q = fma(vec3f(t), ray.direction, -to_center);
    let u = abs(dot(q, scene.rectangles[index].half_u)) * scene.rectangles[index].inv_u2;
    let v = abs(dot(q, scene.rectangles[index].half_v)) * scene.rectangles[index].inv_v2;
    return select(T_MISS, t, t > 0.0 && u <= 1.0 && v <= 1.0);
}

fn nearest_rectangle(line: Line, skip: u32, hit: ptr<function, Hit>) {
    for (var i = 0u; i < RECTANGLE_COUNT; i++) {
        let t = rectangle_t(line.ray, i);
        if (t < (*hit).t && RECTANGLE_FIRST + i != skip) {
            *hit = Hit(t, RECTANGLE_FIRST + i);
        }
    }
}

fn rectangle_occludes(line: Line, skip: u32, t_max: f32) -> bool {
    for (var i = 0u; i < RECTANGLE_COUNT; i++) {
        if (rectangle_t(line.ray, i) < t_max && RECTANGLE_FIRST + i != skip) {
            return true;
        }
    }
    return false;
}

fn rectangle_surface(ray: Ray, t: f32, index: u32, is_within: bool) -> Surface {
    let normal = scene.rectangles[index].normal;
    let material = scene.rectangles[index].material;
    return Surface(
        fma(vec3f(t), ray.direction, ray.origin),
        select(normal, -normal, dot(normal, ray.direction) > 0.0),
        scene.materials[material].albedo,
        material,
        false,
    );
}
