// Stubs for scenes without dielectrics.

struct FreeFlight {
    distance: f32,
    is_scattered: bool,
    weight: vec3f,
}

fn sample_distance(material: u32, boundary: f32, u: f32) -> FreeFlight {
    return FreeFlight(boundary, false, vec3f(1.0));
}

fn uniform_direction(u1: f32, u2: f32) -> vec3f {
    return vec3f(0.0);
}
