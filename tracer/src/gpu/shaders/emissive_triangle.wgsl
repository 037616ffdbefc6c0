// Sampling of emissive triangles, uniformly by area.

fn triangle_point(index: u32, origin: vec3f, u: vec2f) -> EmissivePoint {
    let root = sqrt(u.x);
    let weights = vec3f(1.0 - root, root * (1.0 - u.y), root * u.y);
    let a = mesh.triangles[index].a;
    let b = mesh.triangles[index].b;
    let c = mesh.triangles[index].c;
    let material = mesh.triangles[index].material;
    let emission = scene_storage.materials[material].k * emission_texture(index, weights) * share_there(index, weights);
    let to_light = weights.x * a + weights.y * b + weights.z * c - origin;
    return flat_point(to_light, b - a, c - a, TRIANGLE_AREA_FACTOR, material, emission);
}
