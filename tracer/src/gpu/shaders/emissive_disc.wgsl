// Sampling of emissive discs.

fn disc_point(index: u32, origin: vec3f, u: vec2f) -> EmissivePoint {
    let radius = scene_storage.discs[index].radius;
    let material = scene_storage.discs[index].material;
    let frame = basis(scene_storage.discs[index].normal);
    let at = sqrt(u.x) * circle(u.y);
    let b = radius * frame.t;
    let c = radius * frame.b;
    let to_light = scene_storage.discs[index].center + at.x * b + at.y * c - origin;
    return flat_point(to_light, b, c, DISC_AREA_FACTOR, material, scene_storage.materials[material].k);
}
