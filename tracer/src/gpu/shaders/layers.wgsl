// Clear coats and sheens over glTF's material: see `scalar::metallic_roughness`. Functions of
// `metallic_roughness.wgsl` that are wrapped here are renamed to `base_…`.

struct SurfaceLayers {
    clearcoat: f32,
    clearcoat_alpha: f32,
    sheen_width: f32,
    // Directional reflectance of the sheen at cosines whose square roots are 0, 1/5 and 2/5, and at
    // those of 3/5, 4/5 and 1.
    sheen_reflected_low: vec3f,
    sheen_reflected_high: vec3f,
    sheen: vec3f,
}

// Layers of the surface of the last call of `metallic_roughness_at`.
var<private> layers: SurfaceLayers;

fn metallic_roughness_at(surface: Surface) -> MetallicRoughness {
    let material = surface.material;
    let textures = textures_met();
    let coat = scene_storage.materials[material].stripe_albedo.xy;
    let roughness = textures.clearcoat_roughness;
    layers = SurfaceLayers(
        coat.x * textures.clearcoat,
        max(coat.y * roughness * roughness, ALPHA_LEAST),
        scene_storage.materials[material].sheen_roughness,
        scene_storage.materials[material].extinction,
        scene_storage.materials[material].scattering,
        scene_storage.materials[material].sheen,
    );
    texture_sheen();
    return base_metallic_roughness_at(surface);
}

fn regularise_layers() {
    layers.clearcoat_alpha = max(layers.clearcoat_alpha, ALPHA_MIN);
}

// Mean transmittance of coat and reflection into the diffuse base, over cosine-weighted light.
fn mean_passed() -> f32 {
    // With Schlick's (1 − c)⁵, whose cosine-weighted mean is 1/21 and that of whose square is 1/66.
    let passed = 1.0 - metallic_roughness.dielectric_f0;
    let rise = metallic_roughness.base_f90 - metallic_roughness.dielectric_f0;
    let coat_rise = layers.clearcoat * (1.0 - CLEARCOAT_F0);
    let lost = passed * (1.0 / 21.0) - rise * (1.0 / 66.0);
    return base_mean_passed() * (1.0 - layers.clearcoat * CLEARCOAT_F0) - coat_rise * lost;
}

// Approximate directional reflectance of the sheen.
fn sheen_reflected(cos_theta: f32) -> f32 {
    let place = 5.0 * sqrt(clamp(cos_theta, 0.0, 1.0));
    let low = max(1.0 - abs(place - vec3f(0.0, 1.0, 2.0)), vec3f(0.0));
    let high = max(1.0 - abs(place - vec3f(3.0, 4.0, 5.0)), vec3f(0.0));
    return dot(low, layers.sheen_reflected_low) + dot(high, layers.sheen_reflected_high);
}

fn coat_reflected(cos_theta: f32) -> f32 {
    return layers.clearcoat * fma(grazing(cos_theta), 1.0 - CLEARCOAT_F0, CLEARCOAT_F0);
}

// Energy sent on by the reflection, and by base and sheen together, as sums over channels.
fn weights_below(cos_o: f32) -> vec2f {
    let reflected = dot(schlick(metallic_roughness.f0, metallic_roughness.f90, cos_o), vec3f(1.0));
    let diffuse = base_passed(cos_o) * dot(metallic_roughness.diffuse, vec3f(1.0));
    return vec2f(reflected, diffuse + 3.0 * min(sheen_reflected(cos_o), 1.0));
}

fn reflected_share(cos_o: f32) -> f32 {
    let weights = weights_below(cos_o);
    let sum = weights.x + weights.y;
    return select(0.0, weights.x / max(sum, 1e-30), sum > 0.0);
}

fn clearcoat_share(n: vec3f, wo: vec3f) -> f32 {
    // The weights below are sums over three channels, the coat's reflectance is a single value.
    let weights = weights_below(dot(n, wo));
    let coat = coat_reflected(dot(coat_normal_beside(n), wo));
    return coat / max(fma(1.0 - coat, (weights.x + weights.y) * (1.0 / 3.0), coat), 1e-30);
}

fn with_layers(base: Evaluated, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    return with_clearcoat(with_sheen(base, n, wo, wi), n, wo, wi);
}

fn with_sheen(base: Evaluated, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    if (all(layers.sheen == vec3f(0.0))) {
        return base;
    }
    let cos_o = dot(n, wo);
    let cos_i = dot(n, wi);
    let sum = wo + wi;
    let reflected = max(sheen_reflected(cos_o), sheen_reflected(cos_i));
    let exponent = 1.0 / layers.sheen_width;
    let along = dot(sum, n);
    let sine2 = clamp(1.0 - along * along / dot(sum, sum), 1e-12, 1.0);
    let power = exp2(0.5 * exponent * log2(sine2));
    let sheen = (2.0 + exponent) * power / (4.0 * (cos_o + cos_i - cos_o * cos_i));
    // Where the tabulated reflectance exceeds 1, the sheen is reduced by it to conserve energy.
    let f = base.f * max(1.0 - reflected, 0.0) + layers.sheen * (sheen / max(reflected, 1.0));
    return Evaluated(f, base.pdf);
}

fn with_clearcoat(below: Evaluated, n: vec3f, wo: vec3f, wi: vec3f) -> Evaluated {
    let coat_n = coat_normal_beside(n);
    let cos_o = dot(coat_n, wo);
    let cos_i = dot(coat_n, wi);
    let passed = (1.0 - coat_reflected(cos_o)) * (1.0 - coat_reflected(cos_i));
    let share = clearcoat_share(n, wo);
    let f = below.f * (passed * lit_share(dot(n, wi), n, wi));
    if (cos_o <= 0.0 || cos_i <= 0.0) {
        return Evaluated(f, (1.0 - share) * below.pdf);
    }
    let h = normalize(wo + wi);
    let seen = 0.25 * ggx(layers.clearcoat_alpha, coat_n, h) * visibility(layers.clearcoat_alpha, cos_o);
    let coat = coat_reflected(dot(wo, h)) * seen * visibility(layers.clearcoat_alpha, cos_i);
    return Evaluated(f + coat * lit_share(cos_i, n, wi), fma(share, seen, (1.0 - share) * below.pdf));
}

// Samples a direction of the coat's reflection if `u` selects it; otherwise returns 0 and rescales
// `u` to [0, 1).
fn sample_coat(n: vec3f, wo: vec3f, u: ptr<function, vec3f>) -> vec3f {
    let coat = clearcoat_share(n, wo);
    if ((*u).x < coat) {
        let coat_n = coat_normal_beside(n);
        return reflected_by(sample_visible(layers.clearcoat_alpha, wo, coat_n, (*u).y, (*u).z), wo);
    }
    (*u).x = ((*u).x - coat) / (1.0 - coat);
    return vec3f(0.0);
}
