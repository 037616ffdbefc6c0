// Area lights: rectangles that terminate every ray and emit on one side.

fn area_light_t(ray: Ray, index: u32) -> f32 {
    let to_center = scene.area_lights[index].center - ray.origin;
    let normal = scene.area_lights[index].normal;
    let slope = dot(ray.direction, normal);
    if (slope == 0.0) {
        return T_MISS;
    }
    let t = dot(to_center, normal) / slope;
    // Hit point relative to the centre.
    let q = fma(vec3f(t), ray.direction, -to_center);
    let u = abs(dot(q, scene.area_lights[index].axis_u));
    let v = abs(dot(q, scene.area_lights[index].axis_v));
    return select(T_MISS, t, t > 0.0 && u <= scene.area_lights[index].length_u && v <= scene.area_lights[index].length_v);
}

// No ray starts on an area light. `target_light` is the light that a shadow ray is aimed at, which
// does not occlude it.
fn nearest_area_light(prepared: PreparedRay, target_light: u32, hit: ptr<function, Hit>) {
    if (AREA_LIGHTS_COPLANAR) {
        nearest_coplanar_area_light(prepared.ray, target_light, hit);
        return;
    }
    for (var i = 0u; i < AREA_LIGHT_COUNT; i++) {
        let t = area_light_t(prepared.ray, i);
        if (t < (*hit).t && i != target_light) {
            *hit = Hit(t, AREA_LIGHT_FIRST + i);
        }
    }
}

fn nearest_coplanar_area_light(ray: Ray, target_light: u32, hit: ptr<function, Hit>) {
    let t = plane_t(ray, scene.area_lights[0].center, scene.area_lights[0].normal);
    if (!(t > 0.0 && t < (*hit).t)) {
        return;
    }
    let point = fma(vec3f(t), ray.direction, ray.origin);
    for (var i = 0u; i < AREA_LIGHT_COUNT; i++) {
        let q = point - scene.area_lights[i].center;
        let u = abs(dot(q, scene.area_lights[i].axis_u));
        let v = abs(dot(q, scene.area_lights[i].axis_v));
        if (i != target_light && u <= scene.area_lights[i].length_u && v <= scene.area_lights[i].length_v) {
            *hit = Hit(t, AREA_LIGHT_FIRST + i);
            return;
        }
    }
}

// Whether a ray's line hits an area light, ignoring occlusion.
fn meets_area_light(ray: Ray) -> bool {
    var hit = Hit(T_MISS, NO_PRIMITIVE);
    nearest_area_light(prepare_ray(ray), NO_PRIMITIVE, &hit);
    return hit.primitive != NO_PRIMITIVE;
}

// Radiance at a point on an area light.
fn area_light_radiance(index: u32, point: vec3f) -> vec3f {
    let radiance = scene.area_lights[index].radiance;
    if (!AREA_LIGHTS_GRADED) {
        return radiance;
    }
    let u = dot(point - scene.area_lights[index].center, scene.area_lights[index].slope);
    return radiance + clamp(u, -1.0, 1.0) * scene.area_lights[index].gradient;
}

// MIS-weighted emission for a ray that hits an area light; `pdf` is that of `Path`.
fn emission_with_mis(ray: Ray, hit: Hit, pdf: f32) -> vec3f {
    let index = hit.primitive - AREA_LIGHT_FIRST;
    let brightness = scene.area_lights[index].brightness;
    if (dot(ray.direction, scene.area_lights[index].normal) >= 0.0 || brightness == 0.0 || pdf == 0.0) {
        return vec3f(0.0);
    }
    let radiance = area_light_radiance(index, fma(vec3f(hit.t), ray.direction, ray.origin));
    if (pdf < 0.0) {
        return radiance;
    }
    return radiance * power_heuristic(brightness / pdf);
}

// The shadow ray to the area light that a smooth coat mirrors.
fn coat_reflected_light(surface: Surface, bsdf: Bsdf, wo: vec3f) -> ShadowRay {
    let reflectance = bsdf_coat(bsdf);
    if (reflectance == 0.0) {
        return NO_SHADOW_RAY;
    }
    let wi = mirrored(surface.normal, wo);
    let ray = Ray(surface.position, wi);
    var hit = Hit(T_MISS, NO_PRIMITIVE);
    nearest_area_light(prepare_ray(ray), NO_PRIMITIVE, &hit);
    if (hit.primitive == NO_PRIMITIVE) {
        return NO_SHADOW_RAY;
    }
    let index = hit.primitive - AREA_LIGHT_FIRST;
    if (dot(wi, scene.area_lights[index].normal) >= 0.0) {
        return NO_SHADOW_RAY;
    }
    let radiance = area_light_radiance(index, fma(vec3f(hit.t), wi, surface.position));
    return ShadowRay(wi, hit.t, reflectance * radiance, index);
}

// Next-event estimation from `surface`: BSDF times cosine, MIS-weighted. If `cone_density` is not
// 0, it includes what a regularised coat reflects from a cone of directions with that density.
fn direct_light(
    surface: Surface,
    bsdf: Bsdf,
    wo: vec3f,
    u: vec2f,
    cone_density: f32,
    light_weight_sum: ptr<function, f32>,
) -> ShadowRay {
    var chosen = sample_light(surface.position, u);
    if (SHARES_LIGHT_SAMPLING) {
        chosen.light_weight_sum *= area_light_factor();
    }
    *light_weight_sum = chosen.light_weight_sum;
    if (chosen.weight == 0.0) {
        return NO_SHADOW_RAY;
    }
    let direction = sample_direction(spherical_rectangle(chosen.index, surface.position), chosen);
    let cos_i = dot(surface.normal, direction.wi);
    let scattered = bsdf_eval(bsdf, surface.normal, wo, direction.wi);
    let f = scattered.f;
    var coat = bsdf_coat(bsdf) * cone_density;
    if (dot(direction.wi, mirrored(surface.normal, wo)) <= CONE_COSINE) {
        coat = 0.0;
    }
    // Inside a dielectric, light is transmitted from the other side of the boundary; no area light
    // is inside.
    let is_lit = (cos_i > 0.0) != (bsdf_is_transmissive(bsdf) && surface.is_inside);
    if (!is_lit || (coat == 0.0 && all(f == vec3f(0.0)))) {
        return NO_SHADOW_RAY;
    }
    let inverse_probability = chosen.light_weight_sum / chosen.weight;
    let weight = power_heuristic(scattered.pdf * chosen.omega * inverse_probability);
    let inverse_pdf = direction.inverse_pdf * inverse_probability;
    let reflected = f * (abs(cos_i) * weight) + coat;
    let point = fma(vec3f(direction.distance), direction.wi, surface.position);
    let light = reflected * area_light_radiance(chosen.index, point) * inverse_pdf;
    return ShadowRay(direction.wi, direction.distance, light, chosen.index);
}
