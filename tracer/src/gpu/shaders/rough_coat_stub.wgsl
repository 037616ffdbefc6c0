// Stubs for scenes whose coats are smooth.

fn draw_coat_facet(surface: Surface, wo: vec3f, pixel: u32, sample: u32, depth: u32) {}

fn has_rough_coat(material: u32) -> bool {
    return false;
}

fn mirrored(n: vec3f, wo: vec3f) -> vec3f {
    return 2.0 * dot(n, wo) * n - wo;
}

fn coat_reflectance(material: u32, n: vec3f, wo: vec3f, ior: f32) -> f32 {
    return fresnel_dielectric(dot(n, wo), ior);
}
