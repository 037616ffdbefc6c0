// Meshes with vertex normals.

// Layout as in Rust.
struct TriangleNormals {
    a: vec3f,
    b: vec3f,
    c: vec3f,
}

// Interpolated normal of any length; 0 for a flat triangle.
fn interpolated_normal(index: u32, weights: vec3f) -> vec3f {
    let normals = mesh.triangles[index].normals;
    if (normals == FLAT) {
        return vec3f(0.0);
    }
    return weights.x * mesh.normals[normals].a
        + weights.y * mesh.normals[normals].b
        + weights.z * mesh.normals[normals].c;
}
