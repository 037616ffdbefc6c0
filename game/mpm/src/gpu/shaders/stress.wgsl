// Common parts of the constitutive models, which are described in `material/`.

// Deformation of a particle over a substep, the input of a model.
struct Strain {
    // Elastic part of the deformation gradient before the substep.
    deformation: mat3x3<f32>,
    // State variable of the model.
    state: f32,
    // Velocity gradient times the substep.
    increment: mat3x3<f32>,
    // Duration of the substep, in s.
    dt: f32,
}

// Result of a model: deformation and state after the substep, and the stress.
struct Response {
    deformation: mat3x3<f32>,
    state: f32,
    // Kirchhoff stress in Pa: xx, yy, zz, then xy, xz, yz.
    diagonal: vec3<f32>,
    shear: vec3<f32>,
    // Speed of sound over that at rest, 1 or more.
    stiffening: f32,
}

// Trial deformation `(I + dt ∇v) F`.
fn trial(strain: Strain) -> mat3x3<f32> {
    return strain.deformation + strain.increment * strain.deformation;
}

// Diagonal and off-diagonal entries of `U diag(values) Uᵀ`.
fn principal_stress(u: mat3x3<f32>, values: vec3<f32>) -> array<vec3<f32>, 2> {
    let a = u[0] * values.x;
    let b = u[1] * values.y;
    let c = u[2] * values.z;
    let diagonal = a * u[0] + b * u[1] + c * u[2];
    let shear = a.xxy * u[0].yzz + b.xxy * u[1].yzz + c.xxy * u[2].yzz;
    return array(diagonal, shear);
}

// Kirchhoff stress of fixed corotated elasticity (Stomakhin et al. 2012).
fn fixed_corotated(u: mat3x3<f32>, sigma: vec3<f32>, lambda: f32, mu: f32) -> array<vec3<f32>, 2> {
    let j = sigma.x * sigma.y * sigma.z;
    let pressure = lambda * (j - 1.0) * j;
    return principal_stress(u, 2.0 * mu * sigma * (sigma - 1.0) + pressure);
}
