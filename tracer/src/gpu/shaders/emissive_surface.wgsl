// Light sampling of emissive surfaces: see `scalar/emissive_surface.rs`. Functions of other parts
// that are wrapped here are renamed to `lamp_…`.

// Layout as in Rust.
struct EmissiveSurfaceData {
    index: u32,
    before: f32,
    probability: f32,
    shape: u32,
}

// A point on an emissive surface as a direction and distance; a distance of 0 if it contributes no
// light.
struct EmissivePoint {
    wi: vec3f,
    distance: f32,
    angle_per_area: f32,
    area: f32,
    material: u32,
    emission: vec3f,
}

const NO_EMISSIVE_POINT: EmissivePoint = EmissivePoint(vec3f(0.0), 0.0, 0.0, 0.0, 0u, vec3f(0.0));

// Density per solid angle of the path's last direction; not above 0 if light sampling could not
// have found it.
var<private> density_of_path: f32;

fn note_density(pdf: f32) {
    density_of_path = pdf;
    lamp_note_density(pdf);
}

// MIS weight of the emission of a surface that the path's ray hits at `t`, at `cosine` to the
// surface's normal.
fn emission_weight(primitive: u32, material: u32, origin: vec3f, t: f32, cosine: f32) -> f32 {
    let per_area = scene_storage.materials[material].sampling_density * EMISSIVE_SURFACE_SHARE;
    if (density_of_path <= 0.0 || per_area == 0.0) {
        return 1.0;
    }
    return power_heuristic(per_area * area_per_angle(primitive, origin, t, cosine) / density_of_path);
}

// Next-event estimation towards an emissive surface or another light.
fn direct_light(
    surface: Surface,
    bsdf: Bsdf,
    wo: vec3f,
    u: vec2f,
    cone_density: f32,
    light_weight_sum: ptr<function, f32>,
) -> ShadowRay {
    var ray = NO_SHADOW_RAY;
    if (EMISSIVE_SURFACE_SHARE < 1.0) {
        let rest = clamp((u.x - EMISSIVE_SURFACE_SHARE) / (1.0 - EMISSIVE_SURFACE_SHARE), 0.0, BELOW_1);
        ray = lamp_direct_light(surface, bsdf, wo, vec2f(rest, u.y), cone_density, light_weight_sum);
    }
    if (u.x >= EMISSIVE_SURFACE_SHARE) {
        return ray;
    }
    return direct_emissive_surface(surface, bsdf, wo, vec2f(min(u.x / EMISSIVE_SURFACE_SHARE, BELOW_1), u.y));
}

// Index of the emissive surface selected by `u` in [0, 1): the last one whose cumulative
// probability `before` does not exceed `u`. The number of steps suffices for a binary search over
// the table.
fn sample_index(u: f32) -> u32 {
    var first = 0u;
    var last = EMISSIVE_SURFACE_COUNT;
    for (var step = 0u; step < EMISSIVE_SURFACE_STEPS; step++) {
        let middle = (first + last) / 2u;
        if (emissive_surface(middle).before <= u) {
            first = middle;
        } else {
            last = middle;
        }
    }
    return first;
}

fn direct_emissive_surface(surface: Surface, bsdf: Bsdf, wo: vec3f, u: vec2f) -> ShadowRay {
    let light = emissive_surface(sample_index(u.x));
    let within = clamp((u.x - light.before) / light.probability, 0.0, 1.0);
    let drawn = emissive_point(light, surface.position, vec2f(within, u.y));
    if (!(drawn.distance > 0.0)) {
        return NO_SHADOW_RAY;
    }
    let cos_i = dot(surface.normal, drawn.wi);
    let is_lit = (cos_i > 0.0) != (bsdf_is_transmissive(bsdf) && surface.is_inside);
    if (!is_lit) {
        return NO_SHADOW_RAY;
    }
    let scattered = bsdf_eval(bsdf, surface.normal, wo, drawn.wi);
    if (all(scattered.f == vec3f(0.0))) {
        return NO_SHADOW_RAY;
    }
    let per_area = scene_storage.materials[drawn.material].sampling_density * EMISSIVE_SURFACE_SHARE;
    let inverse_density = drawn.angle_per_area / per_area;
    let inverse_pdf = drawn.area * drawn.angle_per_area / (light.probability * EMISSIVE_SURFACE_SHARE);
    let weight = power_heuristic(scattered.pdf * inverse_density) * inverse_pdf;
    return ShadowRay(
        drawn.wi,
        drawn.distance * EMISSIVE_SURFACE_REACH,
        scattered.f * drawn.emission * (abs(cos_i) * weight),
        NO_PRIMITIVE,
    );
}

// A point of a flat surface with edges `b` and `c`, whose area is `area_factor` times that of their
// parallelogram; none if the area is 0 or the surface is seen edge-on.
fn flat_point(
    to_light: vec3f,
    b: vec3f,
    c: vec3f,
    area_factor: f32,
    material: u32,
    emission: vec3f,
) -> EmissivePoint {
    let across = cross(b, c);
    let parallelogram = length(across);
    let distance2 = dot(to_light, to_light);
    let distance = sqrt(distance2);
    let wi = to_light / distance;
    let cosine = abs(dot(wi, across)) / parallelogram;
    if (!(parallelogram > 0.0 && distance > 0.0 && cosine > 0.0)) {
        return NO_EMISSIVE_POINT;
    }
    return EmissivePoint(wi, distance, cosine / distance2, area_factor * parallelogram, material, emission);
}
