// Tait's equation of state without tension. The state is J, the volume over that at rest.
fn water(material: Material, strain: Strain) -> Response {
    let trace = strain.increment[0].x + strain.increment[1].y + strain.increment[2].z;
    let j = clamp(fma(strain.state, trace, strain.state), EXPANSION_MIN, EXPANSION_MAX);
    let inverse = 1.0 / j;
    let cube = inverse * inverse * inverse;
    let pressure = max(fma(cube * cube, inverse, -1.0) * material.stiffness, 0.0);
    let viscous = viscous_stress(strain.increment, material.viscosity / strain.dt);
    let diagonal = viscous[0] - pressure * j;
    return Response(strain.deformation, j, diagonal, viscous[1], max(cube, 1.0));
}
