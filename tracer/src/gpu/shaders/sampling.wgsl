// Random numbers, and mappings from the unit square. The sequence is explained in `sampling.rs`.

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

// Two numbers in [0, 1) from a pixel's key, a sample's key, a block and a seed.
fn pair(pixel: u32, sample: u32, block: u32, seed: u32) -> vec2f {
    let seeds = pcg4d(vec4u(block, seed, 0x6d2b79f5u, 0x1b56c4e9u));
    let shuffled = reverseBits(scramble(sample, seeds.x));
    let x = shuffled ^ in_base_q(scramble(pixel, seeds.y));
    let y = second_dimension(x);
    let words = reverseBits(vec2u(scramble(x, seeds.z), scramble(y, seeds.w)));
    return vec2f(words >> vec2u(8u)) * (1.0 / 16777216.0);
}

// A hash-based nested uniform (Owen) scramble on reversed bits; see `sampling.rs`.
fn scramble(bits: u32, seed: u32) -> u32 {
    var word = bits;
    word ^= word * SCRAMBLE.x;
    word = (word + seed) * ((seed >> 16u) | 1u);
    word ^= word * SCRAMBLE.y;
    return word ^ (word * SCRAMBLE.z);
}

fn second_dimension(bits: u32) -> u32 {
    var x = bits;
    x ^= (x & 0xaaaaaaaau) >> 1u;
    x ^= (x & 0xccccccccu) >> 2u;
    x ^= (x & 0xf0f0f0f0u) >> 4u;
    x ^= (x & 0xff00ff00u) >> 8u;
    return x ^ (x >> 16u);
}

fn in_base_q(bits: u32) -> u32 {
    var digits = bits;
    var high = digits & 0xccccccccu;
    digits ^= (high >> 2u) ^ (high >> 1u);
    high = digits & 0xf0f0f0f0u;
    digits ^= (high >> 4u) ^ (high >> 2u);
    high = digits & 0xff00ff00u;
    digits ^= (high >> 8u) ^ (high >> 4u);
    high = digits & 0xffff0000u;
    return digits ^ (high >> 16u) ^ (high >> 8u);
}

fn pixel_key(x: u32, y: u32) -> u32 {
    return reverseBits(spread(x) | (spread(y) << 1u));
}

fn sample_key(sample: u32) -> u32 {
    return reverseBits(sample);
}

// Spreads the lower 16 bits to the even positions (for Morton codes).
fn spread(bits: u32) -> u32 {
    var v = bits & 0xffffu;
    v = (v | (v << 8u)) & 0x00ff00ffu;
    v = (v | (v << 4u)) & 0x0f0f0f0fu;
    v = (v | (v << 2u)) & 0x33333333u;
    return (v | (v << 1u)) & 0x55555555u;
}

fn block_scatter(depth: u32) -> u32 {
    return 1u + 3u * depth;
}

fn block_light(depth: u32) -> u32 {
    return 2u + 3u * depth;
}

fn block_choice(depth: u32) -> u32 {
    return 3u + 3u * depth;
}

// (cos, sin) of 2πu for u in [0, 1). The built-in functions may have an error of 2⁻¹¹ (Vulkan
// specification, "Precision of Individual Operations"); these series are accurate to 1e-7 on every
// device.
fn circle(u: f32) -> vec2f {
    let quarter = floor(4.0 * u + 0.5);
    // Exact except for the product: both terms are multiples of 2⁻²⁴ and differ by at most 1/8.
    let x = (u - 0.25 * quarter) * TWO_PI;
    let x2 = x * x;
    let s = x * (1.0 + x2 * (-1.0 / 6.0 + x2 * (1.0 / 120.0 + x2 * (-1.0 / 5040.0
        + x2 * (1.0 / 362880.0)))));
    let c = 1.0 + x2 * (-0.5 + x2 * (1.0 / 24.0 + x2 * (-1.0 / 720.0 + x2 * (1.0 / 40320.0))));
    // Quarters 1 and 3 swap the two; 1 and 2 negate the cosine, 2 and 3 the sine.
    let quarters = u32(quarter);
    let swapped = select(vec2f(c, s), vec2f(s, c), (quarters & 1u) == 1u);
    return select(swapped, -swapped, vec2<bool>(((quarters + 1u) & 2u) == 2u, (quarters & 2u) == 2u));
}

// A cosine-weighted direction around the unit normal `n`: pdf = cos θ / π.
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
    // Not `sign`, which is 0 at 0 and would give no basis for horizontal normals.
    let s = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (s + n.z);
    let b = n.x * n.y * a;
    let tangent = vec3f(1.0 + s * n.x * n.x * a, s * b, -s * n.x);
    return Basis(tangent, vec3f(b, s + n.y * n.y * a, -n.y));
}

// The power heuristic with β = 2 (Veach 1997, section 9.2.4) for a strategy, given the `ratio` of
// the other one's density to its own; bounded, so that the square is finite.
fn power_heuristic(ratio: f32) -> f32 {
    let bounded = min(ratio, 1e18);
    return 1.0 / (1.0 + bounded * bounded);
}

// By the exponent's bits, as WGSL lets compilers assume that no value is infinite or NaN.
fn is_finite(v: vec3f) -> bool {
    let exponent = bitcast<vec3u>(v) & vec3u(0x7f800000u);
    return all(exponent != vec3u(0x7f800000u));
}
