// Stubs for scenes with a uniform environment.

fn environment_radiance(direction: vec3f) -> vec3f {
    return scene.header.environment;
}

fn environment_with_mis(direction: vec3f) -> vec3f {
    return scene.header.environment;
}

fn environment_is_lit() -> bool {
    return any(scene.header.environment != vec3f(0.0));
}

fn note_density(pdf: f32) {}

fn area_light_factor() -> f32 {
    return 1.0 / OTHERS_SHARE;
}
