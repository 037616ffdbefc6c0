// Stubs for scenes without dielectric balls that scatter light inside.

fn sample_light_through_boundary(body: u32, from_point: vec3f, u: vec2f, rays: ptr<function, u32>) -> vec3f {
    return vec3f(0.0);
}

fn exits_by_nee_hemisphere(body: u32, length: f32, cos_i: f32) -> bool {
    return false;
}
