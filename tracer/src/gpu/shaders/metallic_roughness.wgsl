// glTF 2.0's metallic-roughness material, besides others: see `scalar::metallic_roughness`.
// Functions of other parts that are wrapped here are renamed to `plain_…`.

struct MetallicRoughness {
    is_met: bool,
    diffuse: vec3f,
    f0: vec3f,
    f90: f32,
    dielectric_f0: f32,
    base_f90: f32,
    alpha: f32,
}

// Parameters at the surface of the last call of `bsdf_at`.
var<private> metallic_roughness: MetallicRoughness;

fn metallic_roughness_at(surface: Surface) -> MetallicRoughness {
    let material = surface.material;
    let textures = textures_met();
    let base = surface.albedo * textures.base_color;
    let metallic = scene_storage.materials[material].metallic * textures.metallic;
    let f0 = scene_storage.materials[material].eta;
    let dielectric_f0 = largest(f0);
    // Reflectance of non-metals at grazing angles.
    let specular = scene_storage.materials[material].diffuse_scale;
    let alpha = scene_storage.materials[material].alpha * textures.roughness * textures.roughness;
    return MetallicRoughness(
        true,
        base * (1.0 - metallic),
        fma(base - f0, vec3f(metallic), f0),
        fma(1.0 - specular, metallic, specular),
        dielectric_f0,
        max((1.0 - alpha) * (1.0 - alpha) * specular, dielectric_f0),
        max(alpha, ALPHA_LEAST),
    );
}

fn bsdf_at(surface: Surface, wo: vec3f) -> Bsdf {
    metallic_roughness.is_met = scene_storage.materials[surface.material].kind == KIND_METALLIC_ROUGHNESS;
    if (metallic_roughness.is_met) {
        metallic_roughness = metallic_roughness_at(surface);
    }
    return plain_bsdf_at(surface, wo);
}

fn bsdf_regularised(bsdf: Bsdf) -> Bsdf {
    metallic_roughness.alpha = max(metallic_roughness.alpha, ALPHA_MIN);
    regularise_layers();
    return plain_bsdf_regularised(bsdf);
}

fn bsdf_is_layered(bsdf: Bsdf) -> bool {
    return !metallic_roughness.is_met && plain_bsdf_is_layered(bsdf);
}

fn bsdf_albedo(bsdf: Bsdf, surface: Surface) -> vec3f {
    if (metallic_roughness.is_met) {
        return min(metallic_roughness.diffuse + metallic_roughness.f0, vec3f(1.0));
    }
    return plain_bsdf_albedo(bsdf, surface);
}

fn bsdf_mirror(bsdf: Bsdf, cos_o: f32) -> vec3f {
    if (metallic_roughness.is_met) {
        return vec3f(0.0);
    }
    return plain_bsdf_mirror(bsdf, cos_o);
}

fn bsdf_eval(bsdf: Bsdf, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    if (!metallic_roughness.is_met) {
        return plain_bsdf_eval(bsdf, n, wo, wi);
    }
    let cos_o = dot(n, wo);
    let cos_i = dot(n, wi);
    if (cos_o <= 0.0 || cos_i <= 0.0) {
        return Evaluated(vec3f(0.0), 0.0);
    }
    let it = metallic_roughness;
    let h = normalize(wo + wi);
    // D G1(o) / (4 cos θo), the density of reflection by visible normals. The BRDF is F G1(i) / cos
    // θi times it.
    let seen = 0.25 * ggx(it.alpha, n, h) * visibility(it.alpha, cos_o);
    let reflected = schlick(it.f0, it.f90, dot(wo, h)) * (seen * visibility(it.alpha, cos_i));
    // Normalised such that a white base reflects all light that the reflection lets pass.
    let scale = 1.0 / mean_passed();
    let scattered = it.diffuse * (base_passed(cos_o) * base_passed(cos_i) * scale * (1.0 / PI));
    let share = reflected_share(cos_o);
    let base = Evaluated(reflected + scattered, fma(share, seen, (1.0 - share) * cos_i * (1.0 / PI)));
    return with_layers(base, n, wo, wi);
}

fn bsdf_sample(bsdf: Bsdf, n: vec3f, wo: vec3f, u: vec3f) -> BsdfSample {
    if (!metallic_roughness.is_met) {
        return plain_bsdf_sample(bsdf, n, wo, u);
    }
    var numbers = u;
    var wi = sample_coat(n, wo, &numbers);
    if (all(wi == vec3f(0.0))) {
        wi = cosine_hemisphere(n, u.y, u.z);
        if (numbers.x < reflected_share(dot(n, wo))) {
            wi = reflected_by(sample_visible(metallic_roughness.alpha, wo, n, u.y, u.z), wo);
        }
    }
    let evaluated = bsdf_eval(bsdf, n, wo, wi);
    if (!(evaluated.pdf > 0.0)) {
        return BsdfSample(wi, vec3f(0.0), 0.0);
    }
    return BsdfSample(wi, evaluated.f * (dot(n, wi) / evaluated.pdf), evaluated.pdf);
}

// Emission is added once for each surface that a path hits.
fn shade(path: ptr<function, Path>, hit: Hit) -> u32 {
    set_pixel_width((*path).depth);
    // Before the density of the path's next direction is noted.
    (*path).radiance += emission_of_hit(*path, hit);
    return plain_shade(path, hit);
}

// Adds the emission of a path's last surface, which is not shaded.
fn extend(path: ptr<function, Path>, met: Hit, rays: ptr<function, u32>) -> u32 {
    let state = plain_extend(path, met, rays);
    // A path that was scattered inside a body has not reached the surface.
    let is_last = state == DONE && (*path).depth == job.max_depth && met.primitive < AREA_LIGHT_FIRST;
    if (HAS_EMISSION && is_last) {
        set_pixel_width(job.max_depth);
        (*path).radiance += emission_of_hit(*path, met);
    }
    return state;
}

// Emission of the surface that a path hits, times throughput and MIS weight.
fn emission_of_hit(path: Path, met: Hit) -> vec3f {
    if (!HAS_EMISSION) {
        return vec3f(0.0);
    }
    let is_within = HAS_DIELECTRIC && path.start == (met.primitive | INSIDE);
    let surface = surface_at(path.ray, met, is_within);
    let material = surface.material;
    if (scene_storage.materials[material].kind != KIND_METALLIC_ROUGHNESS) {
        return vec3f(0.0);
    }
    let emission = scene_storage.materials[material].k * textures_met().emission;
    let cosine = abs(dot(path.ray.direction, own_normal(surface)));
    return path.beta * emission * emission_weight(met.primitive, material, path.ray.origin, met.t, cosine);
}

fn reflected_by(h: vec3f, wo: vec3f) -> vec3f {
    return 2.0 * dot(wo, h) * h - wo;
}

fn schlick(f0: vec3f, f90: f32, cos_theta: f32) -> vec3f {
    return fma(f90 - f0, vec3f(grazing(cos_theta)), f0);
}

fn grazing(cos_theta: f32) -> f32 {
    let off = clamp(1.0 - cos_theta, 0.0, 1.0);
    let square = off * off;
    return square * square * off;
}

// Fraction of light that passes into the base, or out of it, at an angle.
fn base_passed(cos_theta: f32) -> f32 {
    let rise = metallic_roughness.base_f90 - metallic_roughness.dielectric_f0;
    return 1.0 - metallic_roughness.dielectric_f0 - rise * grazing(cos_theta);
}

// The cosine-weighted mean: that of Schlick's (1 − c)⁵ is 1/21.
fn mean_passed() -> f32 {
    let rise = metallic_roughness.base_f90 - metallic_roughness.dielectric_f0;
    return 1.0 - metallic_roughness.dielectric_f0 - rise * (1.0 / 21.0);
}

fn reflected_share(cos_o: f32) -> f32 {
    let reflected = dot(schlick(metallic_roughness.f0, metallic_roughness.f90, cos_o), vec3f(1.0));
    let all = reflected + base_passed(cos_o) * dot(metallic_roughness.diffuse, vec3f(1.0));
    // A black material of index 1 neither reflects nor transmits at normal incidence.
    return reflected / max(all, 1e-30);
}
