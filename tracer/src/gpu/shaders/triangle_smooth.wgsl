// Meshes with vertex normals.

// Data that Rust writes.
struct TriangleNormals {
    a: vec3f,
    b: vec3f,
    c: vec3f,
}

// Of any length; 0 of a facet.
fn interpolated_normal(index: u32, weights: vec3f) -> vec3f {
    let normals = mesh.triangles[index].normals;
    if (normals == FLAT) {
        return vec3f(0.0);
    }
    return weights.x * mesh.normals[normals].a
        + weights.y * mesh.normals[normals].b
        + weights.z * mesh.normals[normals].c;
}
