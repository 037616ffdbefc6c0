// Transmission of light through thin walls of glTF's material: see
// `scalar::metallic_roughness::thin_wall`. Functions of other parts that are wrapped here are
// renamed to `opaque_…`.

struct ThinWall {
    color: vec3f,
    // Reflectance of non-metals at grazing angles.
    f90: f32,
    is_smooth: bool,
}

// Parameters at the surface of the last call of `metallic_roughness_at`.
var<private> thin_wall: ThinWall;

fn metallic_roughness_at(surface: Surface) -> MetallicRoughness {
    var it = opaque_metallic_roughness_at(surface);
    let material = surface.material;
    let transmission = scene_storage.materials[material].stripe_albedo.z * transmission_texture();
    let specular = scene_storage.materials[material].diffuse_scale;
    thin_wall = ThinWall(it.diffuse * transmission, specular, it.alpha <= ALPHA_LEAST);
    it.diffuse *= 1.0 - transmission;
    return it;
}

fn lets_light_pass() -> bool {
    return metallic_roughness.is_met && any(thin_wall.color != vec3f(0.0));
}

// The cosine of incident light, from either side of a wall.
fn lit_cosine(n: vec3f, wi: vec3f) -> f32 {
    let cos_i = dot(n, wi);
    if (cos_i < 0.0 && lets_light_pass()) {
        return -cos_i;
    }
    return opaque_lit_cosine(n, wi);
}

fn bsdf_albedo(bsdf: Bsdf, surface: Surface) -> vec3f {
    let albedo = opaque_bsdf_albedo(bsdf, surface);
    if (lets_light_pass()) {
        return min(albedo + thin_wall.color, vec3f(1.0));
    }
    return albedo;
}

// The "mirror" of a smooth wall shows what lies straight behind it.
fn bsdf_mirror(bsdf: Bsdf, n: vec3f, wo: vec3f) -> vec3f {
    if (lets_light_pass() && thin_wall.is_smooth) {
        return wall_passed(n, wo, through(n, -wo), n);
    }
    return opaque_bsdf_mirror(bsdf, dot(n, wo));
}

fn mirror_direction(n: vec3f, wo: vec3f) -> vec3f {
    return select(2.0 * dot(n, wo) * n - wo, -wo, lets_light_pass());
}

// Reflects a direction in the plane of the wall.
fn through(n: vec3f, w: vec3f) -> vec3f {
    return w - 2.0 * dot(n, w) * n;
}

// Fraction of light that a facet does not reflect at an angle.
fn facet_passed(cos_theta: f32) -> f32 {
    let rise = thin_wall.f90 - metallic_roughness.dielectric_f0;
    return 1.0 - metallic_roughness.dielectric_f0 - rise * grazing(cos_theta);
}

// Transmittance of a facet with normal `h` and of the layers on both sides; `wi` is reflected to
// the side of `wo`.
fn wall_passed(n: vec3f, wo: vec3f, wi: vec3f, h: vec3f) -> vec3f {
    return thin_wall.color * (layers_passed(n, wo, wi) * facet_passed(dot(wo, h)));
}

fn passed_share(n: vec3f, wo: vec3f) -> f32 {
    let coat = coat_share_reflected(n, wo);
    let sent = dot(thin_wall.color, vec3f(1.0)) * facet_passed(dot(n, wo));
    let passed = (1.0 - coat) * sent;
    // Weights are sums over three channels, of which the coat reflects the same.
    let others = (1.0 - coat) * weight_above(dot(n, wo)) + 3.0 * coat;
    return passed / max(passed + others, 1e-30);
}

fn bsdf_eval(bsdf: Bsdf, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    if (!lets_light_pass()) {
        return opaque_bsdf_eval(bsdf, n, wo, wi);
    }
    let share = passed_share(n, wo);
    let cos_o = dot(n, wo);
    if (dot(n, wi) >= 0.0) {
        let above = opaque_bsdf_eval(bsdf, n, wo, wi);
        return Evaluated(above.f, (1.0 - share) * above.pdf);
    }
    if (thin_wall.is_smooth || cos_o <= 0.0) {
        return Evaluated(vec3f(0.0), 0.0);
    }
    let alpha = metallic_roughness.alpha;
    let mirror_image = through(n, wi);
    let h = normalize(wo + mirror_image);
    let seen = 0.25 * ggx(alpha, n, h) * visibility(alpha, cos_o);
    let f = wall_passed(n, wo, mirror_image, h) * (seen * visibility(alpha, dot(n, mirror_image)));
    return Evaluated(f, share * seen);
}

fn bsdf_sample(bsdf: Bsdf, n: vec3f, wo: vec3f, u: vec3f) -> BsdfSample {
    if (!lets_light_pass()) {
        return opaque_bsdf_sample(bsdf, n, wo, u);
    }
    let share = passed_share(n, wo);
    if (u.x >= share) {
        var above = opaque_bsdf_sample(bsdf, n, wo, vec3f((u.x - share) / (1.0 - share), u.yz));
        if (dot(n, above.wi) <= 0.0) {
            above.weight = vec3f(0.0);
        }
        return above;
    }
    if (thin_wall.is_smooth) {
        return BsdfSample(-wo, wall_passed(n, wo, through(n, -wo), n) / share, SPECULAR);
    }
    let h = sample_visible(metallic_roughness.alpha, wo, n, u.y, u.z);
    let wi = through(n, reflected_by(h, wo));
    let evaluated = bsdf_eval(bsdf, n, wo, wi);
    let cos_i = -dot(n, wi);
    if (!(evaluated.pdf > 0.0 && cos_i > 0.0)) {
        return BsdfSample(wi, vec3f(0.0), 0.0);
    }
    return BsdfSample(wi, evaluated.f * (cos_i / evaluated.pdf), evaluated.pdf);
}
