// Spheres.

// The chord of a line through a sphere: distance of its midpoint along the ray, square of its half
// length, and vector from the midpoint to the centre. The hit is decided by that vector (Haines et
// al., "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems, 2019), which is
// projected twice so that the rounding error of the distance vanishes.
struct Chord {
    middle_t: f32,
    half_squared: f32,
    to_center: vec3f,
}

fn sphere_chord(ray: Ray, center: vec3f, radius: f32) -> Chord {
    let f = center - ray.origin;
    let b = dot(f, ray.direction);
    var l: vec3f;
    if (COMPENSATED) {
        // The rounding error of the difference (Knuth's TwoSum), which is visible where coordinates
        // are thousands of times the radius.
        let difference = rounded(f);
        let back = rounded(center - difference);
        let lost = (center - rounded(difference + back)) + rounded(back - ray.origin);
        l = minus_product(difference, b, ray.direction) + lost;
    } else {
        l = fma(vec3f(-b), ray.direction, f);
    }
    let b2 = dot(l, ray.direction);
    l = fma(vec3f(-b2), ray.direction, l);
    return Chord(b + b2, fma(radius, radius, -dot(l, l)), l);
}

// f − b·d, accurate to 36 bits of f, where the two nearly cancel: products of 12-bit halves are
// exact. `fma` would do on most devices, but Vulkan does not require it to round only once.
fn minus_product(f: vec3f, b: f32, d: vec3f) -> vec3f {
    // Dekker's splitting by masks: the upper parts keep 12 bits, so their products have 24.
    let b_high = bitcast<f32>(bitcast<u32>(b) & 0xfffff000u);
    let d_high = bitcast<vec3f>(bitcast<vec3u>(d) & vec3u(0xfffff000u));
    let b_low = b - b_high;
    let d_low = d - d_high;
    return (((f - b_high * d_high) - b_high * d_low) - b_low * d_high) - b_low * d_low;
}

// Distance to the sphere; `T_MISS` if the ray does not hit it, or if the radius is 0.
fn ball_t(ray: Ray, center: vec3f, radius: f32) -> f32 {
    let chord = sphere_chord(ray, center, radius);
    if (chord.half_squared <= 0.0) {
        return T_MISS;
    }
    let half = sqrt(chord.half_squared);
    // From inside, the near intersection is behind the origin and the far one counts.
    let t = select(chord.middle_t + half, chord.middle_t - half, chord.middle_t > half);
    return select(T_MISS, t, t > 0.0);
}

fn sphere_t(prepared: PreparedRay, index: u32) -> f32 {
    return ball_t(prepared.ray, scene_storage.spheres[index].center, scene_storage.spheres[index].radius);
}

// Distance to the far side from inside; 0 if rounding has put the origin outside.
fn sphere_leave_t(ray: Ray, center: vec3f, radius: f32) -> f32 {
    let chord = sphere_chord(ray, center, radius);
    return max(0.0, chord.middle_t + sqrt(max(0.0, chord.half_squared)));
}

// The primitive that the ray starts on, whose near side it cannot hit. If the ray is inside a
// dielectric ball, the far side of that ball is recorded as the first hit.
fn own_sphere(prepared: PreparedRay, start: u32, hit: ptr<function, Hit>) -> u32 {
    if (!HAS_DIELECTRIC) {
        return start;
    }
    let own = start & ~INSIDE;
    let inside = own - SPHERE_FIRST;
    if ((start & INSIDE) != 0u && inside < SPHERE_COUNT) {
        let sphere = scene_storage.spheres[inside];
        *hit = Hit(sphere_leave_t(prepared.ray, sphere.center, sphere.radius), own);
    }
    return own;
}

// The normal is computed from the chord's midpoint; `origin + t d - center` would lose precision.
fn sphere_surface(ray: Ray, t: f32, index: u32, is_within: bool) -> Surface {
    let sphere = scene_storage.spheres[index];
    let chord = sphere_chord(ray, sphere.center, sphere.radius);
    let half = sqrt(max(0.0, chord.half_squared));
    let is_outside = chord.middle_t > half && !is_within;
    let along = select(half, -half, is_outside);
    let outward = fma(vec3f(along), ray.direction, -chord.to_center) / sphere.radius;
    var albedo = scene_storage.materials[sphere.material].albedo;
    if (HAS_STRIPE) {
        let sine = abs(dot(outward, sphere.stripe_axis));
        let is_stripe = sine < scene_storage.materials[sphere.material].stripe_half_width;
        albedo = select(albedo, scene_storage.materials[sphere.material].stripe_albedo, is_stripe);
    }
    if (HAS_NUMBER && scene_storage.materials[sphere.material].pattern == PATTERN_NUMBER) {
        let number = scene_storage.materials[sphere.material].number;
        albedo = numbered(number, outward, sphere.number_axis, sphere.stripe_axis, albedo);
    }
    var material = sphere.material;
    let kind = scene_storage.materials[material].kind;
    if (HAS_NUMBER_DISC && is_outside && (kind == KIND_CONDUCTOR || kind == KIND_DIELECTRIC)) {
        let disc = scene_storage.materials[material].number;
        if (disc > 0u && is_in_circle(outward, sphere.number_axis, sphere.stripe_axis)) {
            material = disc;
            let number = scene_storage.materials[disc].number;
            albedo = numbered(number, outward, sphere.number_axis, sphere.stripe_axis, albedo);
        }
    }
    return Surface(
        fma(vec3f(sphere.radius), outward, sphere.center),
        select(-outward, outward, is_outside),
        albedo,
        material,
        !is_outside,
    );
}
