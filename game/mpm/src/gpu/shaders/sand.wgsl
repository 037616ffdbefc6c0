// Drucker–Prager plasticity (Klár et al. 2016). The state is the logarithm of the volume gained in tension.
fn sand(material: Material, strain: Strain) -> Response {
    let parts = svd(trial(strain));
    let stretch = max(abs(parts.sigma), vec3(STRETCH_MIN));
    let logarithms = vec3(logarithm(stretch.x), logarithm(stretch.y), logarithm(stretch.z));
    let returned = return_map(material, logarithms, strain.state);
    let before = logarithms.x + logarithms.y + logarithms.z;
    let after = returned.x + returned.y + returned.z;
    let state = strain.state + before - after;
    let stretched = mat3x3(
        parts.u[0] * exponential(returned.x),
        parts.u[1] * exponential(returned.y),
        parts.u[2] * exponential(returned.z),
    );
    let deformation = stretched * transpose(parts.v);
    let stress = principal_stress(parts.u, returned * (2.0 * material.mu) + after * material.lambda);
    return Response(deformation, state, stress[0], stress[1], 1.0);
}

// Projects logarithmic strains, corrected by the volume gained, onto the yield surface (Klár et al. 2016,
// section 7.3).
fn return_map(material: Material, logarithms: vec3<f32>, gained: f32) -> vec3<f32> {
    let corrected = logarithms + gained / 3.0;
    let trace = corrected.x + corrected.y + corrected.z;
    let deviator = corrected - trace / 3.0;
    let length = sqrt(dot(deviator, deviator));
    let excess = fma(trace, material.bulk, length);
    if (trace >= 0.0) {
        return vec3(0.0);
    }
    if (excess <= 0.0) {
        return corrected;
    }
    return corrected - deviator * (excess / max(length, 1.17549435e-38));
}
