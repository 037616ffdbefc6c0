fn jelly(material: Material, strain: Strain) -> Response {
    let deformation = trial(strain);
    let parts = svd(deformation);
    let elastic = fixed_corotated(parts.u, parts.sigma, material.lambda, material.mu);
    let viscous = viscous_stress(strain.increment, material.viscosity / strain.dt);
    let j = parts.sigma.x * parts.sigma.y * parts.sigma.z;
    let stiffening = max(max(parts.sigma.x, abs(j)), 1.0);
    return Response(deformation, strain.state, elastic[0] + viscous[0], elastic[1] + viscous[1], stiffening);
}
