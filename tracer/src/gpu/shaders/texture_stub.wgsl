// Stubs for scenes without procedural textures.

fn numbered(number: u32, n: vec3f, axis: vec3f, up: vec3f, base: vec3f) -> vec3f {
    return base;
}

fn is_in_circle(n: vec3f, axis: vec3f, up: vec3f) -> bool {
    return false;
}

fn textured(surface: Surface, footprint_m: f32) -> vec3f {
    return surface.albedo;
}

fn cue(material: u32, from_tip_m: f32) -> vec3f {
    return vec3f(0.0);
}
