// Viscous stress `2 η D`; the velocity gradient is given times the substep, the viscosity over it.
fn viscous_stress(increment: mat3x3<f32>, viscosity_over_dt: f32) -> array<vec3<f32>, 2> {
    let diagonal = vec3(increment[0].x, increment[1].y, increment[2].z) * 2.0;
    let shear = vec3(
        increment[1].x + increment[0].y,
        increment[2].x + increment[0].z,
        increment[2].y + increment[1].z,
    );
    return array(diagonal * viscosity_over_dt, shear * viscosity_over_dt);
}
