// GGX microfacet distribution: see `scalar::microfacet`.

// From the sine, since 1 − cos² has no digits left near the normal.
fn ggx(alpha: f32, n: vec3f, h: vec3f) -> f32 {
    let cos_h = dot(n, h);
    let sine = h - cos_h * n;
    let alpha2 = alpha * alpha;
    let root = alpha2 * cos_h * cos_h + dot(sine, sine);
    return alpha2 / (PI * root * root);
}

// G1(θ) / cos θ, with Smith's masking function G1 of GGX: no division by a cosine that may be near
// 0.
fn visibility(alpha: f32, cos_theta: f32) -> f32 {
    let alpha2 = alpha * alpha;
    return 2.0 / (cos_theta + sqrt(alpha2 + (1.0 - alpha2) * cos_theta * cos_theta));
}

// Sampling of visible normals by a spherical cap in the stretched configuration (Dupuy and Benyoub
// 2023).
fn sample_visible(alpha: f32, wo: vec3f, n: vec3f, u1: f32, u2: f32) -> vec3f {
    let frame = basis(n);
    let local = vec3f(dot(wo, frame.t), dot(wo, frame.b), dot(wo, n));
    let stretched = normalize(vec3f(alpha * local.xy, local.z));
    let z = (1.0 - u1) * (1.0 + stretched.z) - stretched.z;
    let cap = vec3f(sqrt(max(0.0, 1.0 - z * z)) * circle(u2), z) + stretched;
    let h = normalize(vec3f(alpha * cap.xy, max(cap.z, 0.0)));
    return h.x * frame.t + h.y * frame.b + h.z * n;
}
