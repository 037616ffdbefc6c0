// Meshes through which rays pass where their opacity says: `compiled/opacity.rs`. What it has a namesake of is renamed to
// `solid_` there.

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

// With which probability a ray meets a triangle where the corners have these weights.
fn share_there(index: u32, weights: vec3f) -> f32 {
    let material = mesh.triangles[index].material;
    if (is_opaque(material)) {
        return 1.0;
    }
    // Its alpha, the cutoff and the mode.
    let opacity = scene_storage.materials[material].sights;
    let alpha = opacity.x * vertex_alpha(index, weights) * texture_alpha(index, weights);
    if (opacity.z == OPACITY_MASK) {
        return select(0.0, 1.0, alpha >= opacity.y);
    }
    return alpha;
}

fn ray_number(ray: Ray, index: u32) -> f32 {
    // By the bits of the ray itself: the path's numbers stay as they are, however many layers it passes,
    // and the same ray meets the same layers in whatever order they are tested.
    let first = pcg4d(vec4u(bitcast<vec3u>(ray.origin), index));
    let second = pcg4d(vec4u(first.xyz ^ bitcast<vec3u>(ray.direction), first.w));
    return f32(second.x >> 8u) * (1.0 / 16777216.0);
}
