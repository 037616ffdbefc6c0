// Punctual lights: see `scalar/punctual_light.rs`.

// Layout as in Rust.
struct PunctualLightData {
    center: vec3f,
    is_distant: u32,
    direction: vec3f,
    cone_scale: f32,
    strength: vec3f,
    cone_offset: f32,
}

// Light that arrives at a point; `irradiance` is that of a surface facing the light.
struct PunctualIncidence {
    wi: vec3f,
    distance: f32,
    irradiance: vec3f,
}

fn punctual_incidence(index: u32, point: vec3f) -> PunctualIncidence {
    let light = scene.punctual_lights[index];
    if (light.is_distant == 1u) {
        return PunctualIncidence(-light.direction, T_MISS, light.strength);
    }
    let to_light = light.center - point;
    let distance = length(to_light);
    let wi = to_light / distance;
    let cone = clamp(-dot(wi, light.direction) * light.cone_scale + light.cone_offset, 0.0, 1.0);
    let share = cone / distance;
    return PunctualIncidence(wi, distance, light.strength * (share * share));
}

// A light sampled in proportion to its irradiance, which is returned divided by the probability.
fn sample_punctual_light(point: vec3f, random: f32) -> PunctualIncidence {
    var u = random;
    var sum = 0.0;
    var chosen_weight = 1.0;
    var chosen = PunctualIncidence(vec3f(0.0), 0.0, vec3f(0.0));
    for (var index = 0u; index < PUNCTUAL_LIGHT_COUNT; index++) {
        let next = punctual_incidence(index, point);
        let weight = dot(next.irradiance, vec3f(1.0));
        if (!(weight > 0.0)) {
            continue;
        }
        let before = sum;
        sum += weight;
        let at = u * sum;
        var part = vec2f(at, before);
        if (at >= before) {
            part = vec2f(at - before, weight);
            chosen = next;
            chosen_weight = weight;
        }
        u = min(part.x / part.y, BELOW_1);
    }
    chosen.irradiance *= sum / chosen_weight;
    return chosen;
}

// Next-event estimation towards a punctual light or another light.
fn direct_light(
    surface: Surface,
    bsdf: Bsdf,
    wo: vec3f,
    u: vec2f,
    cone_density: f32,
    light_weight_sum: ptr<function, f32>,
) -> ShadowRay {
    var ray = NO_SHADOW_RAY;
    if (PUNCTUAL_SHARE < 1.0) {
        // OTHERS_SHARE / LAMP_SHARE is 1 − PUNCTUAL_SHARE.
        let rest = clamp((u.x - PUNCTUAL_SHARE) / (OTHERS_SHARE / LAMP_SHARE), 0.0, BELOW_1);
        ray = other_direct_light(surface, bsdf, wo, vec2f(rest, u.y), cone_density, light_weight_sum);
    }
    if (u.x >= PUNCTUAL_SHARE) {
        return ray;
    }
    let light = sample_punctual_light(surface.position, min(u.x / PUNCTUAL_SHARE, BELOW_1));
    let cos_i = dot(surface.normal, light.wi);
    let f = bsdf_eval(bsdf, surface.normal, wo, light.wi).f;
    let is_lit = (cos_i > 0.0) != (bsdf_is_transmissive(bsdf) && surface.is_inside);
    if (!is_lit || light.distance == 0.0 || all(f == vec3f(0.0))) {
        return NO_SHADOW_RAY;
    }
    let reflected = f * light.irradiance * (abs(cos_i) / (PUNCTUAL_SHARE * LAMP_SHARE));
    return ShadowRay(light.wi, light.distance, reflected, NO_PRIMITIVE);
}
