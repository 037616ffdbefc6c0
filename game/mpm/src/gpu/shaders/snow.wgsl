// Snow of Stomakhin et al. 2013. The state is Jp, the determinant of the plastic part of the deformation
// gradient.
fn snow(material: Material, strain: Strain) -> Response {
    let parts = svd(trial(strain));
    let sigma = clamp(parts.sigma, vec3(material.stretch_low), vec3(material.stretch_high));
    let before = parts.sigma.x * parts.sigma.y * parts.sigma.z;
    let plastic = strain.state * before / (sigma.x * sigma.y * sigma.z);
    let state = clamp(plastic, PLASTIC_VOLUME_MIN, PLASTIC_VOLUME_MAX);
    let stretched = mat3x3(parts.u[0] * sigma.x, parts.u[1] * sigma.y, parts.u[2] * sigma.z);
    let deformation = stretched * transpose(parts.v);
    let hardness = exponential((1.0 - state) * material.hardening);
    let stress = fixed_corotated(parts.u, sigma, hardness * material.lambda, hardness * material.mu);
    return Response(deformation, state, stress[0], stress[1], max(sqrt(hardness), 1.0));
}
