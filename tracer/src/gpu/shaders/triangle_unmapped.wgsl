// Meshes with vertex normals and without textures.

fn triangle_shading_normal(index: u32, weights: vec3f, normal: vec3f, wo: vec3f, t: f32) -> vec3f {
    if (mesh.triangles[index].normals == FLAT) {
        return normal;
    }
    geometric_normal = normal;
    let interpolated = interpolated_normal(index, weights);
    if (!(dot(interpolated, interpolated) > 0.0)) {
        return normal;
    }
    let unit = normalize(interpolated);
    return visible_normal(select(unit, -unit, dot(unit, normal) < 0.0), normal, wo);
}
