// Meshes with dielectric materials.

// Origin of a ray towards `wi`: on the other side of the triangle if the ray passes through it.
fn origin_towards(surface: Surface, primitive: u32, wi: vec3f) -> vec3f {
    let is_triangle = primitive - TRIANGLE_FIRST < TRIANGLE_COUNT;
    return select(surface.position, beyond, is_triangle && dot(wi, surface.normal) < 0.0);
}
