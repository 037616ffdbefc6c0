// Emission textures, at their finest mip level.

fn emission_texture(index: u32, weights: vec3f) -> vec3f {
    let image = textures.materials[mesh.triangles[index].material].emission;
    let uvs = mesh.triangles[index].uvs;
    if (image == NO_TEXTURE || uvs == FLAT) {
        return vec3f(1.0);
    }
    let corners = mesh.uvs[uvs];
    return texture_at(image, weights.x * corners.a + weights.y * corners.b + weights.z * corners.c, 0.0);
}
