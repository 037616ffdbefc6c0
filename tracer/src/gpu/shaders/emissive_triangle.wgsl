// Triangles that emit.

// The last that does not begin above `u`. As many steps as halve the most that there may be.
fn emissive_triangle(u: f32) -> EmissiveSurfaceData {
    var first = 0u;
    var last = EMISSIVE_TRIANGLE_COUNT;
    for (var step = 0u; step < 21u && last - first > 1u; step++) {
        let middle = (first + last) / 2u;
        if (mesh.lights[middle].before <= u) {
            first = middle;
        } else {
            last = middle;
        }
    }
    return mesh.lights[first];
}

fn triangle_point(index: u32, origin: vec3f, u: vec2f) -> EmissivePoint {
    let root = sqrt(u.x);
    let weights = vec3f(1.0 - root, root * (1.0 - u.y), root * u.y);
    let a = mesh.triangles[index].a;
    let b = mesh.triangles[index].b;
    let c = mesh.triangles[index].c;
    let material = mesh.triangles[index].material;
    let emission = scene_storage.materials[material].k * emission_texture(index, weights) * share_there(index, weights);
    let to_light = weights.x * a + weights.y * b + weights.z * c - origin;
    return flat_point(to_light, b - a, c - a, 0.5, material, emission);
}
