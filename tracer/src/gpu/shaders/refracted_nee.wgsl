// Next-event estimation from inside a dielectric ball, along paths refracted at its boundary: see
// `scalar/refracted_nee.rs`.

// A ray from the inner point, in the plane through the axis (x) and the outer point; lengths are in
// radii.
struct PlaneRay {
    place: vec2f,
    inner: vec2f,
    outer: vec2f,
    length: f32,
    cos_i: f32,
    cos_o: f32,
}

fn cosine_of(sine: f32) -> f32 {
    return sqrt(max(0.0, 1.0 - sine * sine));
}

fn plane_ray(r: f32, ior: f32, sine: f32) -> PlaneRay {
    let inner = vec2f(cosine_of(sine), sine);
    let cos_i = cosine_of(r * sine);
    let cos_o = cosine_of(ior * r * sine);
    // cos_i − r·inner.x, without its cancellation near the boundary.
    let length = max(0.0, 1.0 - r * r) / max(cos_i + r * inner.x, 1e-30);
    let place = vec2f(r + length * inner.x, length * sine);
    // Snell's law in vector form; the exit point on the unit circle is also its outward normal.
    return PlaneRay(place, inner, ior * inner + (cos_o - ior * cos_i) * place, length, cos_i, cos_o);
}

// Signed distance of a point from the refracted ray, positive towards larger angles.
fn beside(ray: PlaneRay, point: vec2f) -> f32 {
    let offset = point - ray.place;
    return ray.outer.x * offset.y - ray.outer.y * offset.x;
}

// Sine of the first ray whose exit point is visible from the outer point; 2 if that is in the other
// half.
fn lowest_sine(r: f32, point: vec2f) -> f32 {
    if (point.x >= 1.0) {
        return 0.0;
    }
    let cos = 1.0 / sqrt(dot(point, point));
    let sin = cosine_of(cos);
    let offset = cos * vec2f(cos * point.x + sin * point.y, cos * point.y - sin * point.x) - vec2f(r, 0.0);
    return select(2.0, offset.y / sqrt(dot(offset, offset)), offset.x > 0.0);
}

// Sine of the ray to the exit point nearest to the outer point; above 1 if that is in the other
// half.
fn highest_sine(r: f32, point: vec2f) -> f32 {
    let offset = point / sqrt(dot(point, point)) - vec2f(r, 0.0);
    return select(2.0, offset.y / sqrt(dot(offset, offset)), offset.x > 0.0);
}

// Sine at the inner point of the ray that reaches `point`; above 1 if there is none. Root search by
// regula falsi.
fn search(r: f32, ior: f32, point: vec2f) -> f32 {
    // Steeper rays are totally reflected, or leave through the other half.
    let sine_max = min(1.0, 1.0 / max(ior * r, 1e-30));
    let highest = highest_sine(r, point);
    var low = lowest_sine(r, point);
    var high = min(sine_max, highest);
    if (low >= high) {
        return 2.0;
    }
    var at_low = beside(plane_ray(r, ior, low), point);
    var at_high = beside(plane_ray(r, ior, high), point);
    if (at_low < 0.0 || (at_high > 0.0 && highest > sine_max)) {
        return 2.0;
    }
    at_high = min(at_high, 0.0);
    var sine = low;
    // The end that moved last: 1 the lower, −1 the upper.
    var moved = 0;
    for (var step = 0u; step < REFRACTED_NEE_STEPS; step++) {
        sine = low + at_low / max(at_low - at_high, 1e-30) * (high - low);
        let at = beside(plane_ray(r, ior, sine), point);
        if (at > 0.0) {
            low = sine;
            at_low = at;
            // The Illinois method: the value of an end that stays twice is halved; without this,
            // only the other end might ever move.
            at_high *= select(1.0, 0.5, moved == 1);
            moved = 1;
        } else {
            high = sine;
            at_high = at;
            at_low *= select(1.0, 0.5, moved == -1);
            moved = -1;
        }
    }
    return sine;
}

// Cross-sectional area of a ray's differential at its end per solid angle at the inner point, in
// squared radii.
fn refracted_spread(ray: PlaneRay, ior: f32, outside: f32) -> f32 {
    let moved = ray.length / max(ray.cos_i, 1e-30);
    let bent = ior * ray.cos_i / max(ray.cos_o, 1e-30);
    // Spread in the ray's plane and perpendicular to it, by Coddington's equations.
    let in_plane = moved * ray.cos_o + outside * (moved + bent * (1.0 - moved));
    let power = ior * ray.cos_i - ray.cos_o;
    return in_plane * (ray.length + outside * (ior - power * ray.length));
}

// Next-event estimation of light that is scattered isotropically at `from_point` inside a ball.
fn sample_light_through_boundary(body: u32, from_point: vec3f, u: vec2f, rays: ptr<function, u32>) -> vec3f {
    if (body >= SPHERE_COUNT || scene.spheres[min(body, SPHERE_COUNT - 1u)].allows_refracted_nee == 0u) {
        return vec3f(0.0);
    }
    let chosen = sample_light(from_point, u);
    if (chosen.weight == 0.0) {
        return vec3f(0.0);
    }
    let straight = sample_direction(spherical_rectangle(chosen.index, from_point), chosen);
    let center = scene.spheres[body].center;
    let radius = scene.spheres[body].radius;
    let material = scene.spheres[body].material;
    let ior = scene_storage.materials[material].ior;
    let x = (from_point - center) / radius;
    let y = x + straight.wi * (straight.distance / radius);
    let r = sqrt(dot(x, x));
    let axis = select(straight.wi, x / max(r, 1e-30), r > 0.0);
    let along = dot(y, axis);
    let across = y - along * axis;
    let height = sqrt(dot(across, across));
    let side = across / max(height, 1e-30);
    let point = vec2f(along, height);
    let sine = search(r, ior, point);
    if (sine > 1.0) {
        return vec3f(0.0);
    }
    let ray = plane_ray(r, ior, sine);
    let offset = point - ray.place;
    let outside = sqrt(dot(offset, offset));
    let inner = Ray(from_point, ray.inner.x * axis + ray.inner.y * side);
    let place = center + radius * (ray.place.x * axis + ray.place.y * side);
    let outer = Ray(place, ray.outer.x * axis + ray.outer.y * side);
    *rays += 2u;
    if (occluded(inner, body, NO_PRIMITIVE, radius * ray.length)
        || occluded(outer, body, chosen.index, radius * outside)) {
        return vec3f(0.0);
    }
    // Radiance is higher inside by the square of the index of refraction.
    let passed = (1.0 - fresnel_dielectric(ray.cos_i, 1.0 / ior)) * ior * ior;
    let left = exp(-scene_storage.materials[material].extinction * (radius * ray.length));
    let normal = scene.area_lights[chosen.index].normal;
    let cosines = dot(outer.direction, normal) / dot(straight.wi, normal);
    let length = straight.distance / radius;
    let inverse_pdf = straight.inverse_pdf * (chosen.light_weight_sum / chosen.weight)
        * length * length * cosines / refracted_spread(ray, ior, outside);
    let light = fma(vec3f(straight.distance), straight.wi, from_point);
    return area_light_radiance(chosen.index, light) * left * (passed * max(inverse_pdf, 0.0) / (4.0 * PI));
}

// Whether a ray scattered inside leaves the ball, after `length` and at `cos_i`, on a path for
// which light sampling has accounted: one that is not longer than half the chord, radius · cos_i.
fn exits_by_nee_hemisphere(body: u32, length: f32, cos_i: f32) -> bool {
    let sphere = min(body, SPHERE_COUNT - 1u);
    return body < SPHERE_COUNT && scene.spheres[sphere].allows_refracted_nee == 1u
        && length <= scene.spheres[sphere].radius * cos_i;
}
