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
    let material = mesh.triangles[index].material;
    // Its alpha, the cutoff and the mode.
    let opacity = scene_storage.materials[material].sights;
    if (scene_storage.materials[material].kind != KIND_METALLIC_ROUGHNESS || opacity.z == OPACITY_OPAQUE) {
        return true;
    }
    let seen = see_triangle(ray, ray_axes, index);
    let weights = seen.weights / (seen.weights.x + seen.weights.y + seen.weights.z);
    let alpha = opacity.x * vertex_alpha(index, weights) * texture_alpha(index, weights);
    if (opacity.z == OPACITY_MASK) {
        return alpha >= opacity.y;
    }
    return ray_number(ray, index) < alpha;
}

fn ray_number(ray: Ray, index: u32) -> f32 {
    let first = pcg4d(vec4u(bitcast<vec3u>(ray.origin), index));
    let second = pcg4d(vec4u(first.xyz ^ bitcast<vec3u>(ray.direction), first.w));
    return f32(second.x >> 8u) * (1.0 / 16777216.0);
}
