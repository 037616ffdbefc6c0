// Scenes whose materials are all diffuse, plain, coated or napped.

struct Bsdf {
    layered: Layered,
    material: u32,
}

fn bsdf_at(surface: Surface, wo: vec3f) -> Bsdf {
    return Bsdf(layered_at(surface, wo), surface.material);
}

// Unchanged: its mirror is a coat's, which is regularised by light sampling.
fn bsdf_regularised(bsdf: Bsdf) -> Bsdf {
    return bsdf;
}

fn bsdf_is_layered(bsdf: Bsdf) -> bool {
    return true;
}

fn bsdf_eval(bsdf: Bsdf, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    return napped_eval(bsdf.layered, bsdf.material, n, wo, wi);
}

// Albedo of the diffuse base.
fn bsdf_albedo(bsdf: Bsdf, surface: Surface) -> vec3f {
    return surface.albedo;
}

// Reflectance of the surface's mirror component.
fn bsdf_mirror(bsdf: Bsdf, cos_o: f32) -> vec3f {
    return vec3f(layered_mirror(bsdf.layered));
}

// Reflectance of the coat.
fn bsdf_coat(bsdf: Bsdf) -> f32 {
    return layered_mirror(bsdf.layered);
}

fn bsdf_is_transmissive(bsdf: Bsdf) -> bool {
    return false;
}

fn bsdf_sample(bsdf: Bsdf, n: vec3f, wo: vec3f, u: vec3f) -> BsdfSample {
    return napped_sample(bsdf.layered, bsdf.material, n, wo, u);
}
