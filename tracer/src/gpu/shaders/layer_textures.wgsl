// Textures of glTF's layers and specular reflection, and normals of clear coats: see
// `compiled/layer_texture.rs`. Functions of `image_texture.wgsl` that are wrapped here are renamed
// to `base_…` (`texel` to `color_texel`).

// Layout as in Rust.
struct LayerTextureData {
    sheen: u32,
    sheen_roughness: u32,
    specular: u32,
    specular_color: u32,
    clearcoat_normal: u32,
    clearcoat_normal_scale: f32,
    has_coat_normal: u32,
}

// Factors of a material's layer parameters.
struct LayerFactors {
    sheen: vec3f,
    sheen_roughness: f32,
    specular_color: vec3f,
    specular: f32,
}

const NO_LAYER_TEXTURES: LayerFactors = LayerFactors(vec3f(1.0), 1.0, vec3f(1.0), 1.0);

// Factors at the most recent surface.
var<private> layer_factors: LayerFactors;
// Normal of that surface's clear coat, on the viewer's side, if it differs from that of the base;
// otherwise 0.
var<private> coat_normal: vec3f;

fn triangle_shading_normal(index: u32, weights: vec3f, normal: vec3f, wo: vec3f, t: f32) -> vec3f {
    let shading = base_triangle_shading_normal(index, weights, normal, wo, t);
    let uvs = mesh.triangles[index].uvs;
    if (uvs == FLAT) {
        return shading;
    }
    let material = mesh.triangles[index].material;
    let maps = textures.layers[material];
    let corners = mesh.uvs[uvs];
    let uv = weights.x * corners.a + weights.y * corners.b + weights.z * corners.c;
    if (HAS_LAYER_FACTORS) {
        layer_factors = layer_factors_at(maps, uv, texture_footprint(t) * corners.density);
    }
    if (HAS_COAT_NORMALS && maps.has_coat_normal == 1u) {
        geometric_normal = normal;
        var coat = textures.materials[material];
        coat.normal = maps.clearcoat_normal;
        coat.normal_scale = maps.clearcoat_normal_scale;
        coat_normal = visible_normal(coat_normal_at(coat, index, weights, normal, uv, corners), normal, wo);
    }
    return shading;
}

fn layer_factors_at(maps: LayerTextureData, uv: vec2f, footprint: f32) -> LayerFactors {
    var factors = NO_LAYER_TEXTURES;
    if (maps.sheen != NO_TEXTURE) {
        factors.sheen = texture_at(maps.sheen, uv, footprint);
    }
    if (maps.sheen_roughness != NO_TEXTURE) {
        factors.sheen_roughness = texture_at(maps.sheen_roughness, uv, footprint).x;
    }
    if (maps.specular != NO_TEXTURE) {
        factors.specular = texture_at(maps.specular, uv, footprint).x;
    }
    if (maps.specular_color != NO_TEXTURE) {
        factors.specular_color = texture_at(maps.specular_color, uv, footprint);
    }
    return factors;
}

// The coat's normal, on the same side as the triangle's `normal`.
fn coat_normal_at(
    maps: MaterialTextureData,
    index: u32,
    weights: vec3f,
    normal: vec3f,
    uv: vec2f,
    corners: TriangleUvs,
) -> vec3f {
    let a = mesh.triangles[index].a;
    let edge_b = mesh.triangles[index].b - a;
    let edge_c = mesh.triangles[index].c - a;
    var n_out = normalize(cross(edge_b, edge_c));
    let interpolated = interpolated_normal(index, weights);
    if (dot(interpolated, interpolated) > 0.0) {
        n_out = normalize(interpolated);
    }
    let is_behind = dot(n_out, normal) < 0.0;
    if (maps.normal != NO_TEXTURE) {
        let mapped = mapped_normal(maps, uv, corners, edge_b, edge_c, n_out);
        if (any(mapped != vec3f(0.0))) {
            return lifted(select(mapped, -mapped, is_behind), normal);
        }
    }
    return select(n_out, -n_out, is_behind);
}

fn texel(data: TextureData, place: u32) -> vec3f {
    if (data.is_srgb == TEXTURE_ALPHA) {
        return vec3f(f32(textures.texels[place] >> 24u) * (1.0 / 255.0));
    }
    return color_texel(data, place);
}

// Reflectance of non-metals at grazing angles, and below, at normal incidence.
fn textured_specular(material: u32) -> f32 {
    return scene_storage.materials[material].diffuse_scale * layer_factors.specular;
}

fn textured_f0(material: u32) -> vec3f {
    let f0 = scene_storage.materials[material].eta * layer_factors.specular_color * layer_factors.specular;
    return min(f0, vec3f(textured_specular(material)));
}
