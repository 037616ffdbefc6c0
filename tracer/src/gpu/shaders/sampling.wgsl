// Random numbers as a hash of where they are used, and warps from the unit square.

// PCG4D: Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
fn pcg4d(key: vec4u) -> vec4u {
    var v = key * 1664525u + 1013904223u;
    v = pcg4d_mix(v);
    v ^= v >> vec4u(16u);
    return pcg4d_mix(v);
}

fn pcg4d_mix(words: vec4u) -> vec4u {
    var v = words;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    return v;
}

fn uniforms(pixel: u32, sample: u32, block: u32, seed: u32) -> vec4f {
    let words = pcg4d(vec4u(pixel, sample, block, seed));
    return vec4f(words >> vec4u(8u)) * (1.0 / 16777216.0);
}

fn pixel_key(x: u32, y: u32) -> u32 {
    return (y << 16u) | x;
}

fn block_scatter(bounce: u32) -> u32 {
    return 1u + 2u * bounce;
}

fn block_light(bounce: u32) -> u32 {
    return 2u + 2u * bounce;
}

// (cos, sin) of 2πu for u in [0, 1). The built-in functions may be wrong by 2⁻¹¹ (Vulkan
// specification, "Precision of Individual Operations"); these series are right to 1e-7 on every
// device.
fn circle(u: f32) -> vec2f {
    let quarter = floor(4.0 * u + 0.5);
    let x = (u - 0.25 * quarter) * TWO_PI;
    let x2 = x * x;
    let s = x * (1.0 + x2 * (-1.0 / 6.0 + x2 * (1.0 / 120.0 + x2 * (-1.0 / 5040.0
        + x2 * (1.0 / 362880.0)))));
    let c = 1.0 + x2 * (-0.5 + x2 * (1.0 / 24.0 + x2 * (-1.0 / 720.0 + x2 * (1.0 / 40320.0))));
    switch u32(quarter) & 3u {
        case 0u: { return vec2f(c, s); }
        case 1u: { return vec2f(-s, c); }
        case 2u: { return vec2f(-c, -s); }
        default: { return vec2f(s, -c); }
    }
}

// A direction about the unit normal `n`, cosine-weighted: pdf = cos θ / π.
fn cosine_hemisphere(n: vec3f, u1: f32, u2: f32) -> vec3f {
    let disc = sqrt(u1) * circle(u2);
    let cos_theta = sqrt(max(0.0, 1.0 - u1));
    let frame = basis(n);
    return disc.x * frame.t + disc.y * frame.b + cos_theta * n;
}

struct Basis {
    t: vec3f,
    b: vec3f,
}

// Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.
fn basis(n: vec3f) -> Basis {
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    let tangent = vec3f(1.0 + s * n.x * n.x * a, s * b, -s * n.x);
    return Basis(tangent, vec3f(b, s + n.y * n.y * a, -n.y));
}

// The power heuristic with β = 2 (Veach 1997, section 9.2.4), in a form that squares nothing large.
fn power_heuristic(pdf: f32, other_pdf: f32) -> f32 {
    let ratio = other_pdf / pdf;
    return 1.0 / (1.0 + ratio * ratio);
}

// By the exponent's bits: WGSL lets a compiler assume that no number is infinite or NaN.
fn is_finite(v: vec3f) -> bool {
    let exponent = bitcast<vec3u>(v) & vec3u(0x7f800000u);
    return all(exponent != vec3u(0x7f800000u));
}
