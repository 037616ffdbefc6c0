// Circular discs.

fn disc_t(prepared: PreparedRay, index: u32) -> f32 {
    let ray = prepared.ray;
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

// A disc has no inside.
fn own_disc(prepared: PreparedRay, start: u32, hit: ptr<function, Hit>) -> u32 {
    return start;
}

fn disc_surface(ray: Ray, t: f32, index: u32, is_within: bool) -> Surface {
    let disc = scene.discs[index];
    return Surface(
        fma(vec3f(t), ray.direction, ray.origin),
        select(disc.normal, -disc.normal, dot(disc.normal, ray.direction) > 0.0),
        scene_storage.materials[disc.material].albedo,
        disc.material,
        false,
    );
}
