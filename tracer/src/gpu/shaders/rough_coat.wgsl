// Rough coats: each path sees the mirror of one sampled GGX microfacet (see
// `scalar::bsdf::Bsdf::with_facet`).

// Normal of the sampled facet at the surface being shaded; the shading normal if the coat is
// smooth.
var<private> coat_facet: vec3f;

fn draw_coat_facet(surface: Surface, wo: vec3f, pixel: u32, sample: u32, depth: u32) {
    coat_facet = surface.normal;
    if (has_rough_coat(surface.material)) {
        let u = pair(pixel, sample, COAT_BLOCKS + depth, job.seed);
        coat_facet = sample_visible(scene_storage.materials[surface.material].alpha, wo, surface.normal, u.x, u.y);
    }
}

fn has_rough_coat(material: u32) -> bool {
    return scene_storage.materials[material].kind == KIND_LAYERED && scene_storage.materials[material].alpha > 0.0;
}

// Mirror direction of the coat.
fn mirrored(n: vec3f, wo: vec3f) -> vec3f {
    return 2.0 * dot(coat_facet, wo) * coat_facet - wo;
}

fn coat_reflectance(material: u32, n: vec3f, wo: vec3f, ior: f32) -> f32 {
    let reflected = fresnel_dielectric(dot(coat_facet, wo), ior);
    if (!has_rough_coat(material)) {
        return reflected;
    }
    let cos_i = max(0.0, dot(n, mirrored(n, wo)));
    return reflected * visibility(scene_storage.materials[material].alpha, cos_i) * cos_i;
}
