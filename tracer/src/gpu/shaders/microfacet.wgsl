// Metals and dielectrics, smooth and rough, besides the layered materials: see `scalar::microfacet`
// for sources. Media inside dielectrics are in medium.wgsl.

struct Bsdf {
    layered: Layered,
    kind: u32,
    alpha: f32,
    // Relative index of refraction of a dielectric.
    eta: f32,
    material: u32,
}

fn bsdf_at(surface: Surface, wo: vec3f) -> Bsdf {
    let material = surface.material;
    let kind = scene_storage.materials[material].kind;
    let ior = scene_storage.materials[material].ior;
    var layered: Layered;
    if (kind == KIND_LAYERED) {
        layered = layered_at(surface, wo);
    }
    let eta = select(ior, 1.0 / ior, surface.is_inside);
    return Bsdf(layered, kind, scene_storage.materials[material].alpha, eta, material);
}

fn bsdf_regularised(bsdf: Bsdf) -> Bsdf {
    var rougher = bsdf;
    if (bsdf.kind == KIND_CONDUCTOR) {
        rougher.alpha = max(bsdf.alpha, ALPHA_MIN);
    }
    return rougher;
}

fn bsdf_is_layered(bsdf: Bsdf) -> bool {
    return bsdf.kind == KIND_LAYERED;
}

// BSDF without delta components, for radiance.
fn bsdf_eval(bsdf: Bsdf, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    if (bsdf.kind == KIND_LAYERED) {
        return napped_eval(bsdf.layered, bsdf.material, n, wo, wi);
    }
    let nothing = Evaluated(vec3f(0.0), 0.0);
    let cos_o = dot(n, wo);
    let cos_i = dot(n, wi);
    if (bsdf.alpha == 0.0 || cos_o <= 0.0) {
        return nothing;
    }
    if (cos_i > 0.0) {
        let h = normalize(wo + wi);
        // D G1(o) / (4 cos θo), the density of reflection by visible normals.
        let seen = 0.25 * ggx(bsdf.alpha, n, h) * visibility(bsdf.alpha, cos_o);
        let shadowing = visibility(bsdf.alpha, cos_i);
        let o = dot(wo, h);
        if (bsdf.kind == KIND_CONDUCTOR) {
            return Evaluated(conductor_reflectance(bsdf.material, o) * (seen * shadowing), seen);
        }
        let pdf = fresnel_dielectric(o, bsdf.eta) * seen;
        return Evaluated(vec3f(pdf * shadowing), pdf);
    }
    if (bsdf.kind == KIND_CONDUCTOR || cos_i == 0.0) {
        return nothing;
    }
    // The half vector of refraction on the side of n (Walter et al., "Microfacet Models for
    // Refraction through Rough Surfaces", EGSR 2007, equation 16).
    let across = normalize(wo + bsdf.eta * wi);
    let h = select(across, -across, dot(across, n) < 0.0);
    let o = dot(wo, h);
    let i = -dot(wi, h);
    if (o <= 0.0 || i <= 0.0) {
        return nothing;
    }
    let seen = ggx(bsdf.alpha, n, h) * visibility(bsdf.alpha, cos_o);
    // The Jacobian of refraction (Walter et al., equation 17), with wi·h = −i.
    let eta2 = bsdf.eta * bsdf.eta;
    let sum = o - bsdf.eta * i;
    let pdf = (1.0 - fresnel_dielectric(o, bsdf.eta)) * seen * o * i * eta2 / (sum * sum);
    // The BSDF for radiance is divided by η².
    return Evaluated(vec3f(pdf * visibility(bsdf.alpha, -cos_i) / eta2), pdf);
}

// Albedo of a diffuse base; 1 for metals and dielectrics, which show their surroundings.
fn bsdf_albedo(bsdf: Bsdf, surface: Surface) -> vec3f {
    return select(vec3f(1.0), surface.albedo, bsdf.kind == KIND_LAYERED);
}

// Reflectance of the surface's mirror component.
fn bsdf_mirror(bsdf: Bsdf, cos_o: f32) -> vec3f {
    if (bsdf.kind == KIND_LAYERED) {
        return vec3f(layered_mirror(bsdf.layered));
    }
    if (bsdf.alpha > 0.0) {
        return vec3f(0.0);
    }
    if (bsdf.kind == KIND_CONDUCTOR) {
        return conductor_reflectance(bsdf.material, cos_o);
    }
    return vec3f(fresnel_dielectric(cos_o, bsdf.eta));
}

// Reflectance of the coat.
fn bsdf_coat(bsdf: Bsdf) -> f32 {
    if (bsdf.kind == KIND_LAYERED) {
        return layered_mirror(bsdf.layered);
    }
    return 0.0;
}

fn bsdf_is_transmissive(bsdf: Bsdf) -> bool {
    return bsdf.kind == KIND_DIELECTRIC;
}

fn bsdf_sample(bsdf: Bsdf, n: vec3f, wo: vec3f, u: vec3f) -> BsdfSample {
    if (bsdf.kind == KIND_LAYERED) {
        return napped_sample(bsdf.layered, bsdf.material, n, wo, u);
    }
    let is_rough = bsdf.alpha > 0.0;
    var h = n;
    if (is_rough) {
        h = sample_visible(bsdf.alpha, wo, n, u.y, u.z);
    }
    let cos_h = dot(wo, h);
    let is_metal = bsdf.kind == KIND_CONDUCTOR;
    let is_reflected = is_metal || u.x < fresnel_dielectric(cos_h, bsdf.eta);
    var wi = 2.0 * cos_h * h - wo;
    var weight = vec3f(1.0);
    if (is_metal) {
        weight = conductor_reflectance(bsdf.material, cos_h);
    } else if (!is_reflected) {
        let eta = bsdf.eta;
        let cos_t = sqrt(max(0.0, (eta - 1.0) * (eta + 1.0) + cos_h * cos_h)) / eta;
        wi = normalize((cos_h / eta - cos_t) * h - wo / eta);
        // Refraction scales radiance by 1/η².
        weight = vec3f(1.0 / (eta * eta));
    }
    if (!is_rough) {
        return BsdfSample(wi, weight, SPECULAR);
    }
    // A microfacet may send light to the wrong side of the macroscopic surface.
    let facing = max(0.0, select(-dot(n, wi), dot(n, wi), is_reflected));
    // In f·cos over the density, the distribution, the Fresnel term and the masking of `wo` cancel,
    // which leaves the shadowing of `wi`.
    weight *= visibility(bsdf.alpha, facing) * facing;
    return BsdfSample(wi, weight, bsdf_eval(bsdf, n, wo, wi).pdf);
}

// Unpolarised reflectance of a metal (Born and Wolf, "Principles of Optics", section 14.2).
fn conductor_reflectance(material: u32, cos_theta: f32) -> vec3f {
    let eta = scene_storage.materials[material].eta;
    let k = scene_storage.materials[material].k;
    let cos_i = clamp(cos_theta, 0.0, 1.0);
    let cos2 = cos_i * cos_i;
    let sin2 = 1.0 - cos2;
    let difference = eta * eta - k * k - sin2;
    let sum = sqrt(difference * difference + 4.0 * eta * eta * k * k);
    let a = sqrt(max(vec3f(0.0), 0.5 * (sum + difference)));
    let even = sum + cos2;
    let odd = 2.0 * cos_i * a;
    let perpendicular = (even - odd) / (even + odd);
    let even_p = cos2 * sum + sin2 * sin2;
    let odd_p = odd * sin2;
    return 0.5 * perpendicular * (1.0 + (even_p - odd_p) / (even_p + odd_p));
}
