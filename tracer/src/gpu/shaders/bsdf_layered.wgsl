// Scenes whose materials are all diffuse, bare, coated or napped.

struct Bsdf {
    layered: Layered,
    material: u32,
}

fn bsdf_at(surface: Surface, wo: vec3f) -> Bsdf {
    return Bsdf(layered_at(surface, wo), surface.material);
}

// Its mirror is a coat's.
fn bsdf_regularised(bsdf: Bsdf) -> Bsdf {
    return bsdf;
}

fn bsdf_is_layered(bsdf: Bsdf) -> bool {
    return true;
}

fn bsdf_eval(bsdf: Bsdf, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    return napped_eval(bsdf.layered, bsdf.material, n, wo, wi);
}

// Of a diffuse base.
fn bsdf_albedo(bsdf: Bsdf, surface: Surface) -> vec3f {
    return surface.albedo;
}

// Reflectance of the mirror that the surface is or has.
fn bsdf_mirror(bsdf: Bsdf, cos_o: f32) -> vec3f {
    return vec3f(layered_mirror(bsdf.layered));
}

// What a coat reflects.
fn bsdf_coat(bsdf: Bsdf) -> f32 {
    return layered_mirror(bsdf.layered);
}

fn bsdf_is_transmissive(bsdf: Bsdf) -> bool {
    return false;
}

fn bsdf_sample(bsdf: Bsdf, n: vec3f, wo: vec3f, u: vec3f) -> BsdfSample {
    return napped_sample(bsdf.layered, bsdf.material, n, wo, u);
}
