// Image textures on meshes: see `compiled/texture.rs` for the choice of texels and
// `scalar/normal_map.rs` for normal maps.

// Layout as in Rust.
struct TriangleUvs {
    a: vec2f,
    b: vec2f,
    c: vec2f,
    density: f32,
}

struct TextureData {
    first: u32,
    width: u32,
    height: u32,
    levels: u32,
    is_srgb: u32,
    wrap_u: u32,
    wrap_v: u32,
}

struct MaterialTextureData {
    base_color: u32,
    metallic_roughness: u32,
    normal: u32,
    emission: u32,
    clearcoat: u32,
    clearcoat_roughness: u32,
    normal_scale: f32,
}

// Factors at the most recent surface.
var<private> texture_factors: TextureFactors;

fn textures_met() -> TextureFactors {
    return texture_factors;
}

fn triangle_shading_normal(index: u32, weights: vec3f, normal: vec3f, wo: vec3f, t: f32) -> vec3f {
    let a = mesh.triangles[index].a;
    let edge_b = mesh.triangles[index].b - a;
    let edge_c = mesh.triangles[index].c - a;
    var n_out = normalize(cross(edge_b, edge_c));
    var shading = normal;
    let has_normals = mesh.triangles[index].normals != FLAT;
    if (has_normals) {
        geometric_normal = normal;
        let interpolated = interpolated_normal(index, weights);
        if (dot(interpolated, interpolated) > 0.0) {
            n_out = normalize(interpolated);
            shading = select(n_out, -n_out, dot(n_out, normal) < 0.0);
        }
    }
    let maps = textures.materials[mesh.triangles[index].material];
    let uvs = mesh.triangles[index].uvs;
    var mapped = vec3f(0.0);
    if (uvs != FLAT) {
        let corners = mesh.uvs[uvs];
        let uv = weights.x * corners.a + weights.y * corners.b + weights.z * corners.c;
        texture_factors = textures_at(maps, uv, texture_footprint(t) * corners.density);
        if (maps.normal != NO_TEXTURE) {
            mapped = mapped_normal(maps, uv, corners, edge_b, edge_c, n_out);
        }
    }
    if (any(mapped != vec3f(0.0))) {
        geometric_normal = normal;
        shading = lifted(select(mapped, -mapped, dot(n_out, normal) < 0.0), normal);
    } else if (!has_normals) {
        return normal;
    }
    return visible_normal(shading, normal, wo);
}

fn textures_at(maps: MaterialTextureData, uv: vec2f, footprint: f32) -> TextureFactors {
    var factors = NO_TEXTURES;
    if (maps.base_color != NO_TEXTURE) {
        factors.base_color = texture_at(maps.base_color, uv, footprint);
    }
    if (maps.metallic_roughness != NO_TEXTURE) {
        let sampled = texture_at(maps.metallic_roughness, uv, footprint);
        factors.roughness = sampled.y;
        factors.metallic = sampled.z;
    }
    if (maps.emission != NO_TEXTURE) {
        factors.emission = texture_at(maps.emission, uv, footprint);
    }
    if (HAS_LAYERS && maps.clearcoat != NO_TEXTURE) {
        factors.clearcoat = texture_at(maps.clearcoat, uv, footprint).x;
    }
    if (HAS_LAYERS && maps.clearcoat_roughness != NO_TEXTURE) {
        factors.clearcoat_roughness = texture_at(maps.clearcoat_roughness, uv, footprint).y;
    }
    return factors;
}

// Unit normal on the outer side; 0 if there is none.
fn mapped_normal(
    maps: MaterialTextureData,
    uv: vec2f,
    corners: TriangleUvs,
    edge_b: vec3f,
    edge_c: vec3f,
    n: vec3f,
) -> vec3f {
    // Tangent and bitangent are the gradients of position with respect to u and v, up to a positive
    // factor: the sign of the UV determinant replaces a division by it.
    let uv_b = corners.b - corners.a;
    let uv_c = corners.c - corners.a;
    let turn = select(1.0, -1.0, uv_b.x * uv_c.y - uv_b.y * uv_c.x < 0.0);
    let along_u = turn * (uv_c.y * edge_b - uv_b.y * edge_c);
    let along_v = turn * (uv_b.x * edge_c - uv_c.x * edge_b);
    let across_n = along_u - n * dot(n, along_u);
    if (!(dot(across_n, across_n) > 0.0)) {
        return vec3f(0.0);
    }
    let tangent = normalize(across_n);
    let across = cross(n, tangent);
    let bitangent = select(across, -across, dot(across, along_v) > 0.0);
    let map = 2.0 * texture_at(maps.normal, uv, 0.0) - 1.0;
    let across_map = maps.normal_scale * map.xy;
    let mapped = across_map.x * tangent + across_map.y * bitangent + map.z * n;
    if (!(dot(mapped, mapped) > 0.0)) {
        return vec3f(0.0);
    }
    return normalize(mapped);
}

// The normal, raised to be at least slightly above the surface with normal `n`.
fn lifted(mapped: vec3f, n: vec3f) -> vec3f {
    let lift = REFLECTION_SINE_MIN - dot(mapped, n);
    if (lift <= 0.0) {
        return mapped;
    }
    return normalize(mapped + lift * n);
}

// Linear red, green and blue, trilinearly filtered. `footprint` is in units of texture coordinates.
fn texture_at(image: u32, uv: vec2f, footprint: f32) -> vec3f {
    let data = textures.images[image];
    let across = sqrt(f32(data.width) * f32(data.height));
    // A lower bound, as log2(0) is undefined.
    let level = clamp(log2(max(footprint * across, 1e-30)), 0.0, f32(data.levels - 1u));
    let finer = floor(level);
    let share = level - finer;
    let sampled = bilinear(data, uv, u32(finer));
    if (share > 0.0) {
        return fma(vec3f(share), bilinear(data, uv, u32(finer) + 1u) - sampled, sampled);
    }
    return sampled;
}

fn bilinear(data: TextureData, uv: vec2f, level: u32) -> vec3f {
    var first = data.first;
    var size = vec2u(data.width, data.height);
    for (var i = 0u; i < min(level, 31u); i++) {
        first += size.x * size.y;
        size = max(size >> vec2u(1u), vec2u(1u));
    }
    let x = taps(uv.x, size.x, data.wrap_u);
    let y = taps(uv.y, size.y, data.wrap_v);
    let top = mix_texels(data, first + y.before * size.x, x);
    let bottom = mix_texels(data, first + y.after * size.x, x);
    return (1.0 - y.share) * top + y.share * bottom;
}

// The two texels next to a coordinate, and the weight of the second.
struct Taps {
    before: u32,
    after: u32,
    share: f32,
}

fn taps(coordinate: f32, count: u32, wrap: u32) -> Taps {
    let at = wrapped(coordinate, wrap) * f32(count) - 0.5;
    let before = floor(at);
    return Taps(texel_place(before, count, wrap), texel_place(before + 1.0, count, wrap), at - before);
}

// Whole periods are removed first, as they would cost precision in the product.
fn wrapped(coordinate: f32, wrap: u32) -> f32 {
    if (wrap == WRAP_REPEAT) {
        return coordinate - floor(coordinate);
    }
    if (wrap == WRAP_CLAMP) {
        return clamp(coordinate, 0.0, 1.0);
    }
    let half = 0.5 * coordinate;
    return 1.0 - abs(2.0 * (half - floor(half)) - 1.0);
}

// The coordinates −1 and `count` lie beyond the edges.
fn texel_place(place: f32, count: u32, wrap: u32) -> u32 {
    let last = count - 1u;
    let inside = min(u32(max(place, 0.0)), last);
    let below = select(0u, last, wrap == WRAP_REPEAT);
    let above = select(last, 0u, wrap == WRAP_REPEAT);
    return select(select(inside, above, place > f32(last)), below, place < 0.0);
}

fn mix_texels(data: TextureData, row: u32, x: Taps) -> vec3f {
    let a = texel(data, row + x.before);
    return fma(vec3f(x.share), texel(data, row + x.after) - a, a);
}

fn texel(data: TextureData, place: u32) -> vec3f {
    let word = textures.texels[place];
    let bytes = vec3u(word, word >> 8u, word >> 16u) & vec3u(255u);
    if (data.is_srgb == 0u) {
        return vec3f(bytes) * (1.0 / 255.0);
    }
    return vec3f(textures.srgb[bytes.x], textures.srgb[bytes.y], textures.srgb[bytes.z]);
}
