// Alpha of base colour textures, at their finest mip level.

fn texture_alpha(index: u32, weights: vec3f) -> f32 {
    let image = textures.materials[mesh.triangles[index].material].base_color;
    let uvs = mesh.triangles[index].uvs;
    if (image == NO_TEXTURE || uvs == FLAT) {
        return 1.0;
    }
    let corners = mesh.uvs[uvs];
    let uv = weights.x * corners.a + weights.y * corners.b + weights.z * corners.c;
    let data = textures.images[image];
    let x = taps(uv.x, data.width, data.wrap_u);
    let y = taps(uv.y, data.height, data.wrap_v);
    let top = mix_alphas(data.first + y.before * data.width, x);
    let bottom = mix_alphas(data.first + y.after * data.width, x);
    return (1.0 - y.share) * top + y.share * bottom;
}

fn mix_alphas(row: u32, x: Taps) -> f32 {
    let before = f32(textures.texels[row + x.before] >> 24u) * (1.0 / 255.0);
    let after = f32(textures.texels[row + x.after] >> 24u) * (1.0 / 255.0);
    return fma(x.share, after - before, before);
}
