// Sampling of an area light and a direction to it: see `scalar/area_light.rs`.

// An area light in the frame of the point that it is seen from. With `AREA_LIGHTS_SCALED` the unit
// of length is about its distance or size, otherwise a metre.
struct SphericalRectangle {
    axis_u: vec3f,
    axis_v: vec3f,
    normal: vec3f,
    // Lower and upper end along each axis.
    x: vec2f,
    y: vec2f,
    height: f32,
    // In square units.
    area: f32,
    // Length of the unit in metres.
    unit: f32,
    // Distance of the centre in units.
    distance: f32,
}

// An area light, sampled with probability proportional to its `weight` (brightness times solid
// angle) among all lights, whose weights add up to `light_weight_sum`.
struct SampledLight {
    index: u32,
    omega: f32,
    by_area: bool,
    weight: f32,
    light_weight_sum: f32,
    // The random numbers, rescaled for reuse.
    u: vec2f,
}

struct LightDirection {
    wi: vec3f,
    distance: f32,
    inverse_pdf: f32,
}

// Lower bound on arguments of square roots and divisors, against 0 / 0 on the rectangle's edges.
const ROOT_MIN: f32 = 1e-30;

fn spherical_rectangle(index: u32, point: vec3f) -> SphericalRectangle {
    let axis_u = scene.area_lights[index].axis_u;
    let axis_v = scene.area_lights[index].axis_v;
    let length_u = scene.area_lights[index].length_u;
    let length_v = scene.area_lights[index].length_v;
    let normal = scene.area_lights[index].normal;
    let to_center = scene.area_lights[index].center - point;
    let distance = sqrt(dot(to_center, to_center));
    let unit = select(1.0, distance + length_u + length_v, AREA_LIGHTS_SCALED);
    let per_unit = 1.0 / unit;
    let along_u = dot(to_center, axis_u);
    let along_v = dot(to_center, axis_v);
    return SphericalRectangle(
        axis_u,
        axis_v,
        normal,
        vec2f(along_u - length_u, along_u + length_u) * per_unit,
        vec2f(along_v - length_v, along_v + length_v) * per_unit,
        -dot(to_center, normal) * per_unit,
        4.0 * (length_u * per_unit) * (length_v * per_unit),
        unit,
        distance * per_unit,
    );
}

fn sample_light(point: vec3f, random: vec2f) -> SampledLight {
    var chosen = SampledLight(0u, 0.0, false, 0.0, 0.0, random);
    for (var index = 0u; index < AREA_LIGHT_COUNT; index++) {
        let seen = spherical_rectangle(index, point);
        var omega = solid_angle(seen);
        let by_area = omega < SOLID_ANGLE_MIN;
        if (by_area) {
            omega = seen.area * seen.height / (seen.distance * seen.distance * seen.distance);
        }
        let weight = scene.area_lights[index].brightness * omega;
        if (!(seen.height > 0.0 && weight > 0.0)) {
            continue;
        }
        // Streaming weighted selection: the newest light replaces the chosen one with probability
        // weight / sum, and the random number is rescaled to the interval that decided.
        let sum_before = chosen.light_weight_sum;
        chosen.light_weight_sum += weight;
        let at = chosen.u.x * chosen.light_weight_sum;
        var part = vec2f(at, sum_before);
        if (at >= sum_before) {
            part = vec2f(at - sum_before, weight);
            chosen.index = index;
            chosen.omega = omega;
            chosen.by_area = by_area;
            chosen.weight = weight;
        }
        chosen.u.x = min(part.x / part.y, BELOW_1);
    }
    return chosen;
}

// A complex number whose argument is the solid angle of the rectangle from (0, 0) to (x, y).
fn corner(seen: SphericalRectangle, x: f32, y: f32) -> vec2f {
    return vec2f(seen.height * sqrt(x * x + y * y + seen.height * seen.height), x * y);
}

// a · b* of two complex numbers.
fn times_conjugate(a: vec2f, b: vec2f) -> vec2f {
    return vec2f(a.x * b.x + a.y * b.y, a.y * b.x - a.x * b.y);
}

fn solid_angle(seen: SphericalRectangle) -> f32 {
    // The arguments of four corners are combined by multiplying complex numbers, so a single
    // arctangent suffices.
    let x = seen.x;
    let y = seen.y;
    let x2 = x * x + seen.height * seen.height;
    let re = seen.height * sqrt(x2.xxyy + (y * y).yxyx);
    let im = x.xxyy * y.yxyx;
    let left = times_conjugate(vec2f(re.x, im.x), vec2f(re.y, im.y));
    let right = times_conjugate(vec2f(re.z, im.z), vec2f(re.w, im.w));
    let product = times_conjugate(right, left);
    let angle = argument(product);
    // The product's argument is known modulo 2π only: large solid angles wrap to negative values,
    // which rounding can also produce near 0.
    let is_before = x.x < 0.0 && x.y > 0.0 && y.x < 0.0 && y.y > 0.0;
    if (angle < 0.0 && (is_before || product.x < 0.0)) {
        return angle + TWO_PI;
    }
    return max(angle, 0.0);
}

fn sample_direction(seen: SphericalRectangle, chosen: SampledLight) -> LightDirection {
    var at = vec2f(mix(seen.x.x, seen.x.y, chosen.u.x), mix(seen.y.x, seen.y.y, chosen.u.y));
    if (!chosen.by_area) {
        at = sample_solid_angle(seen, chosen.omega, chosen.u);
    }
    let distance = sqrt(dot(at, at) + seen.height * seen.height);
    let to_point = at.x * seen.axis_u + at.y * seen.axis_v - seen.height * seen.normal;
    let inverse_pdf = select(
        chosen.omega,
        seen.area * seen.height / (distance * distance * distance),
        chosen.by_area,
    );
    return LightDirection(to_point / distance, distance * seen.unit, inverse_pdf);
}

// Ureña, Fajardo and King, "An Area-Preserving Parametrization for Spherical Rectangles", EGSR 2013,
// without inverse trigonometric functions: a complex number is rotated in place of their angle.
fn sample_solid_angle(seen: SphericalRectangle, omega: f32, u: vec2f) -> vec2f {
    let h2 = seen.height * seen.height;
    let low = seen.y.x;
    let high = seen.y.y;
    let start = times_conjugate(corner(seen, seen.x.x, high), corner(seen, seen.x.x, low));
    let turn = circle(u.x * omega / TWO_PI);
    let turned = vec2f(
        start.x * turn.x - start.y * turn.y,
        start.x * turn.y + start.y * turn.x,
    ) / sqrt(dot(start, start));
    let slant2 = h2 + low * low;
    let b0 = -low / sqrt(slant2);
    let b1 = high / sqrt(h2 + high * high);
    let n = turned.x * b0 + b1;
    let root = sqrt(max(n * n - turned.y * turned.y * (h2 / slant2), ROOT_MIN));
    let distance = seen.height * abs(turned.y) / root;
    let x = clamp(select(distance, -distance, turned.y * n < 0.0), seen.x.x, seen.x.y);

    let d2 = x * x + h2;
    let h0 = low / sqrt(d2 + low * low);
    let h1 = high / sqrt(d2 + high * high);
    let h = h0 + u.y * (h1 - h0);
    let y = h * sqrt(d2 / max(1.0 - h * h, ROOT_MIN));
    return vec2f(x, clamp(y, low, high));
}
