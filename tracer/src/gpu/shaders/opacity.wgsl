// Partial coverage of meshes: see `compiled/opacity.rs`. Functions of other parts that are wrapped
// here are renamed to `solid_…`.

fn triangle_t(prepared: PreparedRay, index: u32) -> f32 {
    let t = solid_triangle_t(prepared, index);
    if (t < T_MISS && !is_met(prepared.ray, index)) {
        return T_MISS;
    }
    return t;
}

fn is_met(ray: Ray, index: u32) -> bool {
    if (is_opaque(mesh.triangles[index].material)) {
        return true;
    }
    let seen = see_triangle(ray, ray_axes, index);
    let share = share_there(index, seen.weights / (seen.weights.x + seen.weights.y + seen.weights.z));
    return share >= 1.0 || ray_number(ray, index) < share;
}

fn is_opaque(material: u32) -> bool {
    return scene_storage.materials[material].kind != KIND_METALLIC_ROUGHNESS
        || scene_storage.materials[material].sights.z == OPACITY_OPAQUE;
}

// The probability that a ray hits a triangle at a point with these barycentric weights.
fn share_there(index: u32, weights: vec3f) -> f32 {
    let material = mesh.triangles[index].material;
    if (is_opaque(material)) {
        return 1.0;
    }
    // Alpha, cutoff and mode.
    let opacity = scene_storage.materials[material].sights;
    let alpha = opacity.x * vertex_alpha(index, weights) * texture_alpha(index, weights);
    if (opacity.z == OPACITY_MASK) {
        return select(0.0, 1.0, alpha >= opacity.y);
    }
    return alpha;
}

fn ray_number(ray: Ray, index: u32) -> f32 {
    // Hashes the ray itself: the path's random numbers stay the same however many layers it passes,
    // and the same ray hits the same layers in whatever order they are tested.
    let first = pcg4d(vec4u(bitcast<vec3u>(ray.origin), index));
    let second = pcg4d(vec4u(first.xyz ^ bitcast<vec3u>(ray.direction), first.w));
    return f32(second.x >> 8u) * (1.0 / 16777216.0);
}
