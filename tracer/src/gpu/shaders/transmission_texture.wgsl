// Transmission textures of thin walls. Functions of other parts that are wrapped here are renamed
// to `opaque_…`.

// Factor at the most recent surface.
var<private> transmission_factor: f32;

fn transmission_texture() -> f32 {
    return transmission_factor;
}

fn triangle_shading_normal(index: u32, weights: vec3f, normal: vec3f, wo: vec3f, t: f32) -> vec3f {
    let uvs = mesh.triangles[index].uvs;
    if (uvs != FLAT) {
        let image = textures.transmission[mesh.triangles[index].material];
        let corners = mesh.uvs[uvs];
        let uv = weights.x * corners.a + weights.y * corners.b + weights.z * corners.c;
        if (image != NO_TEXTURE) {
            transmission_factor = texture_at(image, uv, texture_footprint(t) * corners.density).x;
        }
    }
    return opaque_triangle_shading_normal(index, weights, normal, wo, t);
}
