// A scene in which nothing is painted.

fn numbered(number: u32, n: vec3f, axis: vec3f, up: vec3f, base: vec3f) -> vec3f {
    return base;
}

fn painted(surface: Surface) -> vec3f {
    return surface.albedo;
}
