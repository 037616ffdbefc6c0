// Triangles that emit: `compiled/mesh_light.rs` says how they are drawn. Functions of other parts that it has namesakes of are
// renamed to `lamp_` there.

// Data that Rust writes.
struct MeshLightData {
    triangle: u32,
    before: f32,
    probability: f32,
    padding: u32,
}

// Density of the path's last direction per solid angle; not above 0 if light sampling could not have found it.
var<private> density_of_path: f32;

fn note_density(pdf: f32) {
    density_of_path = pdf;
    lamp_note_density(pdf);
}

// What weighs the emission of a triangle that the path's ray meets at `t`, `cosine` to its own normal.
fn emission_weight(primitive: u32, material: u32, t: f32, cosine: f32) -> f32 {
    let per_area = scene_storage.materials[material].majorant * MESH_LIGHT_SHARE;
    if (primitive - TRIANGLE_FIRST >= TRIANGLE_COUNT || density_of_path <= 0.0 || per_area == 0.0) {
        return 1.0;
    }
    return power_heuristic(per_area * t * t / (cosine * density_of_path));
}

// Next-event estimation towards one of these or another light.
fn direct_light(
    surface: Surface,
    bsdf: Bsdf,
    wo: vec3f,
    u: vec2f,
    cone_density: f32,
    light_weight_sum: ptr<function, f32>,
) -> ShadowRay {
    var ray = NO_SHADOW_RAY;
    if (MESH_LIGHT_SHARE < 1.0) {
        let rest = clamp((u.x - MESH_LIGHT_SHARE) / (1.0 - MESH_LIGHT_SHARE), 0.0, BELOW_1);
        ray = lamp_direct_light(surface, bsdf, wo, vec2f(rest, u.y), cone_density, light_weight_sum);
    }
    if (u.x >= MESH_LIGHT_SHARE) {
        return ray;
    }
    return direct_mesh_light(surface, bsdf, wo, vec2f(min(u.x / MESH_LIGHT_SHARE, BELOW_1), u.y));
}

fn direct_mesh_light(surface: Surface, bsdf: Bsdf, wo: vec3f, u: vec2f) -> ShadowRay {
    // The last that does not begin above `u`. As many steps as halve the most that there may be.
    var first = 0u;
    var last = MESH_LIGHT_COUNT;
    for (var step = 0u; step < 21u && last - first > 1u; step++) {
        let middle = (first + last) / 2u;
        if (mesh.lights[middle].before <= u.x) {
            first = middle;
        } else {
            last = middle;
        }
    }
    let light = mesh.lights[first];
    let root = sqrt(clamp((u.x - light.before) / light.probability, 0.0, 1.0));
    let weights = vec3f(1.0 - root, root * (1.0 - u.y), root * u.y);
    let a = mesh.triangles[light.triangle].a;
    let b = mesh.triangles[light.triangle].b;
    let c = mesh.triangles[light.triangle].c;
    let across = cross(b - a, c - a);
    let twice_area = length(across);
    let to_light = weights.x * a + weights.y * b + weights.z * c - surface.position;
    let distance2 = dot(to_light, to_light);
    let distance = sqrt(distance2);
    // Triangles without area and points on their own plane bring nothing.
    if (!(twice_area > 0.0 && distance > 0.0)) {
        return NO_SHADOW_RAY;
    }
    let wi = to_light / distance;
    let cosine = abs(dot(wi, across)) / twice_area;
    let cos_i = dot(surface.normal, wi);
    let is_lit = (cos_i > 0.0) != (bsdf_is_transmissive(bsdf) && surface.is_inside);
    if (!is_lit || !(cosine > 0.0)) {
        return NO_SHADOW_RAY;
    }
    let scattered = bsdf_eval(bsdf, surface.normal, wo, wi);
    if (all(scattered.f == vec3f(0.0))) {
        return NO_SHADOW_RAY;
    }
    let material = mesh.triangles[light.triangle].material;
    let inverse_density = cosine / (scene_storage.materials[material].majorant * MESH_LIGHT_SHARE * distance2);
    let inverse_pdf = 0.5 * twice_area * cosine / (distance2 * (light.probability * MESH_LIGHT_SHARE));
    let weight = power_heuristic(scattered.pdf * inverse_density) * inverse_pdf;
    let emission = mesh_emission(light.triangle, material, weights);
    return ShadowRay(wi, distance * MESH_LIGHT_REACH, scattered.f * emission * (abs(cos_i) * weight), NO_PRIMITIVE);
}

fn mesh_emission(index: u32, material: u32, weights: vec3f) -> vec3f {
    return scene_storage.materials[material].k * emission_texture(index, weights) * share_there(index, weights);
}
