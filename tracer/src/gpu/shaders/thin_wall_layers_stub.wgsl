// Stubs for thin walls without clear coats and sheens.

fn layers_passed(n: vec3f, wo: vec3f, wi: vec3f) -> f32 {
    return 1.0;
}

fn coat_share_reflected(n: vec3f, wo: vec3f) -> f32 {
    return 0.0;
}

// Energy sent on by the reflection and the base.
fn weight_above(cos_o: f32) -> f32 {
    let reflected = dot(schlick(metallic_roughness.f0, metallic_roughness.f90, cos_o), vec3f(1.0));
    return reflected + base_passed(cos_o) * dot(metallic_roughness.diffuse, vec3f(1.0));
}
