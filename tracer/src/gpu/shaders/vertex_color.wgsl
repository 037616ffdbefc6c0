// Meshes with vertex colours. Functions of other parts that are wrapped here are renamed to
// `plain_…`.

// Layout as in Rust.
struct TriangleColors {
    a: vec2u,
    b: vec2u,
    c: vec2u,
    padding: vec2u,
}

// Linear colour with alpha; white for triangles without colours.
fn vertex_color(index: u32, weights: vec3f) -> vec4f {
    if (index >= COLORED_TRIANGLE_COUNT) {
        return vec4f(1.0);
    }
    let colors = mesh.colors[index];
    return weights.x * color_of(colors.a) + weights.y * color_of(colors.b) + weights.z * color_of(colors.c);
}

fn color_of(words: vec2u) -> vec4f {
    return vec4f(unpack2x16unorm(words.x), unpack2x16unorm(words.y));
}

fn vertex_alpha(index: u32, weights: vec3f) -> f32 {
    return vertex_color(index, weights).w;
}

fn triangle_surface(ray: Ray, t: f32, index: u32, is_within: bool) -> Surface {
    var surface = plain_triangle_surface(ray, t, index, is_within);
    let seen = see_triangle(ray, basis(ray.direction), index);
    let weights = seen.weights / (seen.weights.x + seen.weights.y + seen.weights.z);
    surface.albedo *= vertex_color(index, weights).rgb;
    return surface;
}
