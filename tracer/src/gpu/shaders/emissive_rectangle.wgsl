// Sampling of emissive rectangles.

fn rectangle_point(index: u32, origin: vec3f, u: vec2f) -> EmissivePoint {
    let b = 2.0 * scene_storage.rectangles[index].half_u;
    let c = 2.0 * scene_storage.rectangles[index].half_v;
    let material = scene_storage.rectangles[index].material;
    let to_light = scene_storage.rectangles[index].center + (u.x - 0.5) * b + (u.y - 0.5) * c - origin;
    return flat_point(to_light, b, c, RECTANGLE_AREA_FACTOR, material, scene_storage.materials[material].k);
}
