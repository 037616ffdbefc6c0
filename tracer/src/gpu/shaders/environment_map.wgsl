// Environment maps: see `compiled/environment.rs` for their layout and the sampling of directions,
// and `scalar/environment.rs` for densities.

// Density per solid angle of the path's last direction; not above 0 if light sampling could not
// have found it.
var<private> sampled_density: f32;

fn note_density(pdf: f32) {
    sampled_density = pdf;
}

// Inverse of the probability with which area lights are selected, where there are other lights too.
fn area_light_factor() -> f32 {
    return 1.0 / (OTHERS_SHARE - environment_map.probability);
}

fn environment_radiance(direction: vec3f) -> vec3f {
    return environment_at(environment_place(direction));
}

fn environment_is_lit() -> bool {
    return true;
}

fn environment_with_mis(direction: vec3f) -> vec3f {
    let place = environment_place(direction);
    let radiance = environment_at(place);
    if (sampled_density <= 0.0 || environment_map.probability == 0.0) {
        return radiance;
    }
    // The map's square has the solid angle element 2π² sin θ, by which the density is converted.
    let sine = length(direction.xy);
    let density = environment_map.probability * environment_density(place) / (SQUARE_TO_SPHERE * sine);
    return radiance * power_heuristic(density / sampled_density);
}

// Next-event estimation towards the environment or an area light.
fn direct_light(
    surface: Surface,
    bsdf: Bsdf,
    wo: vec3f,
    u: vec2f,
    cone_density: f32,
    light_weight_sum: ptr<function, f32>,
) -> ShadowRay {
    // Conditional probability, given that no light of the outer wrappers was selected.
    let probability = environment_map.probability / OTHERS_SHARE;
    var ray = NO_SHADOW_RAY;
    if (AREA_LIGHT_COUNT > 0u) {
        let rest = clamp((u.x - probability) / (1.0 - probability), 0.0, BELOW_1);
        ray = area_direct_light(surface, bsdf, wo, vec2f(rest, u.y), cone_density, light_weight_sum);
    }
    if (u.x < probability) {
        ray = direct_environment_light(surface, bsdf, wo, vec2f(min(u.x / probability, BELOW_1), u.y));
    }
    return ray;
}

fn direct_environment_light(surface: Surface, bsdf: Bsdf, wo: vec3f, u: vec2f) -> ShadowRay {
    let row = drawn_from(0u, ENVIRONMENT_HEIGHT, u.y);
    let column = drawn_from(conditional_first(row.index), ENVIRONMENT_WIDTH, u.x);
    let place = vec2f(
        (f32(column.index) + column.within) / f32(ENVIRONMENT_WIDTH),
        (f32(row.index) + row.within) / f32(ENVIRONMENT_HEIGHT),
    );
    let density = row.share * column.share * (f32(ENVIRONMENT_WIDTH) * f32(ENVIRONMENT_HEIGHT));
    let turns = place.x - environment_map.turn - 0.5;
    let azimuth = circle(turns - floor(turns));
    let colatitude = circle(0.5 * place.y);
    let sine = max(colatitude.y, 0.0);
    let wi = vec3f(sine * azimuth.y, sine * azimuth.x, colatitude.x);
    let inverse_pdf = SQUARE_TO_SPHERE * sine / (density * environment_map.probability);
    let cos_i = dot(surface.normal, wi);
    let scattered = bsdf_eval(bsdf, surface.normal, wo, wi);
    let is_lit = (cos_i > 0.0) != (bsdf_is_transmissive(bsdf) && surface.is_inside);
    if (!is_lit || all(scattered.f == vec3f(0.0))) {
        return NO_SHADOW_RAY;
    }
    let weight = power_heuristic(scattered.pdf * inverse_pdf) * inverse_pdf;
    let light = scattered.f * (abs(cos_i) * weight) * environment_at(place);
    return ShadowRay(wi, T_MISS, light, NO_PRIMITIVE);
}

// Position in the map, horizontally and vertically, in [0, 1].
fn environment_place(direction: vec3f) -> vec2f {
    let sine = length(direction.xy);
    let across = argument(vec2f(direction.y, direction.x)) * (0.5 / PI) + (0.5 + environment_map.turn);
    return vec2f(across - floor(across), argument(vec2f(direction.z, sine)) * (1.0 / PI));
}

fn environment_at(place: vec2f) -> vec3f {
    let x = place.x * f32(ENVIRONMENT_WIDTH) - 0.5;
    let y = clamp(place.y * f32(ENVIRONMENT_HEIGHT) - 0.5, 0.0, f32(ENVIRONMENT_HEIGHT - 1u));
    let before = vec2f(floor(x), floor(y));
    // Wraps around horizontally, clamps vertically.
    let share = vec2f(x, y) - before;
    let last = ENVIRONMENT_WIDTH - 1u;
    let left = select(min(u32(max(before.x, 0.0)), last), last, before.x < 0.0);
    let right = select(left + 1u, 0u, left == last);
    let top = u32(before.y);
    let bottom = min(top + 1u, ENVIRONMENT_HEIGHT - 1u);
    let above = mix_pixels(left, right, top, share.x);
    return fma(vec3f(share.y), mix_pixels(left, right, bottom, share.x) - above, above);
}

fn mix_pixels(left: u32, right: u32, y: u32, share: f32) -> vec3f {
    let a = environment_pixel(left, y);
    return fma(vec3f(share), environment_pixel(right, y) - a, a);
}

fn environment_pixel(x: u32, y: u32) -> vec3f {
    let first = conditional_first(ENVIRONMENT_HEIGHT) + 3u * (y * ENVIRONMENT_WIDTH + x);
    return vec3f(
        environment_map.numbers[first],
        environment_map.numbers[first + 1u],
        environment_map.numbers[first + 2u],
    );
}

fn environment_density(place: vec2f) -> f32 {
    let x = min(u32(place.x * f32(ENVIRONMENT_WIDTH)), ENVIRONMENT_WIDTH - 1u);
    let y = min(u32(place.y * f32(ENVIRONMENT_HEIGHT)), ENVIRONMENT_HEIGHT - 1u);
    let row = environment_map.numbers[y + 1u] - environment_map.numbers[y];
    let first = conditional_first(y) + x;
    let column = environment_map.numbers[first + 1u] - environment_map.numbers[first];
    return row * column * (f32(ENVIRONMENT_WIDTH) * f32(ENVIRONMENT_HEIGHT));
}

fn conditional_first(y: u32) -> u32 {
    return ENVIRONMENT_HEIGHT + 1u + y * (ENVIRONMENT_WIDTH + 1u);
}

// An interval of a cumulative distribution, its length, and the relative position in it.
struct Drawn {
    index: u32,
    share: f32,
    within: f32,
}

fn drawn_from(sums: u32, count: u32, u: f32) -> Drawn {
    var first = 0u;
    var last = count;
    // Binary search for the last interval that does not begin above `u`; 14 steps suffice for the
    // longest edge.
    for (var step = 0u; step < 14u && last - first > 1u; step++) {
        let middle = (first + last) / 2u;
        if (environment_map.numbers[sums + middle] <= u) {
            first = middle;
        } else {
            last = middle;
        }
    }
    let begin = environment_map.numbers[sums + first];
    let share = environment_map.numbers[sums + first + 1u] - begin;
    // An interval of length 0 is selected only by rounding.
    let within = select(0.5, (u - begin) / share, share > 0.0);
    return Drawn(first, share, min(within, BELOW_1));
}

const SQUARE_TO_SPHERE: f32 = 2.0 * PI * PI;
