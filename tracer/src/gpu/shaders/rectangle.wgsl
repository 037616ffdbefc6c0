// Rectangles.

fn rectangle_t(prepared: PreparedRay, index: u32) -> f32 {
    let ray = prepared.ray;
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

// A rectangle has no inside.
fn own_rectangle(prepared: PreparedRay, start: u32, hit: ptr<function, Hit>) -> u32 {
    return start;
}

fn rectangle_surface(ray: Ray, t: f32, index: u32, is_within: bool) -> Surface {
    let normal = scene.rectangles[index].normal;
    let material = scene.rectangles[index].material;
    return Surface(
        fma(vec3f(t), ray.direction, ray.origin),
        select(normal, -normal, dot(normal, ray.direction) > 0.0),
        scene_storage.materials[material].albedo,
        material,
        false,
    );
}
