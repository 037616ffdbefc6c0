// A scene where all is shaded with its own normal.

fn own_normal(surface: Surface) -> vec3f {
    return surface.normal;
}
