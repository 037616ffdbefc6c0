//! Image textures at hits on meshes.

use glam::DVec3;

use super::intersect::{Hit, vector};
use super::metallic_roughness::TextureFactors;
use super::normal_map::{NormalMap, interpolate, textures_at};
use super::triangle::{facing, interpolated_normal, visible_shading_normal};
use crate::CompiledScene;
use crate::compiled::{MaterialTextureData, Primitive, TriangleData};

/// Texture values at a hit for a footprint of `footprint_m` metres, by which the material's parameters are
/// multiplied.
pub(super) fn texture_factors(
    scene: &CompiledScene,
    hit: &Hit,
    footprint_m: f64,
) -> TextureFactors {
    let color_of_vertices = vertex_color(scene, hit);
    let Some((textures, triangle, uvs)) = textures_at(scene, hit.primitive) else {
        return TextureFactors {
            base_color: color_of_vertices,
            ..TextureFactors::ONE
        };
    };
    let uv = interpolate(uvs, barycentric(triangle, hit.point));
    let layers = scene.textures.layers.get(triangle.material as usize);
    let sample = |image: u32| {
        if image == MaterialTextureData::NONE {
            return None;
        }
        let data = &scene.textures.images[image as usize];
        let across = (f64::from(data.width) * f64::from(data.height)).sqrt();
        // log2 of the footprint in texels of the finest level; for a footprint of 0 the level is −∞, which
        // is clamped to the finest.
        let level = (footprint_m * f64::from(uvs.density) * across).log2();
        let rgba = scene.textures.sample(image, uv, level as f32);
        Some(rgba.map(f64::from))
    };
    let color = |image: u32| sample(image).map_or(DVec3::ONE, |[r, g, b, _]| DVec3::new(r, g, b));
    let [_, roughness, metallic, _] = sample(textures.metallic_roughness).unwrap_or([1.0; 4]);
    let [clearcoat, ..] = sample(textures.clearcoat).unwrap_or([1.0; 4]);
    let [_, clearcoat_roughness, ..] = sample(textures.clearcoat_roughness).unwrap_or([1.0; 4]);
    let factors = TextureFactors {
        base_color: color(textures.base_color) * color_of_vertices,
        roughness,
        metallic,
        emission: color(textures.emission),
        clearcoat,
        clearcoat_roughness,
        ..TextureFactors::ONE
    };
    let transmission = scene.textures.transmission.get(triangle.material as usize);
    let factors = TextureFactors {
        transmission: transmission.map_or(1.0, |image| color(*image).x),
        ..factors
    };
    layers.map_or(factors, |layers| TextureFactors {
        sheen: color(layers.sheen),
        sheen_roughness: color(layers.sheen_roughness).x,
        specular: color(layers.specular).x,
        specular_color: color(layers.specular_color),
        ..factors
    })
}

/// Normal of a clear coat, seen from `wo` and on its side, if it differs from that of the base.
pub(super) fn clearcoat_normal(scene: &CompiledScene, hit: &Hit, wo: DVec3) -> Option<DVec3> {
    let Primitive::Triangle(index) = hit.primitive else {
        return None;
    };
    let (_, triangle, uvs) = textures_at(scene, hit.primitive)?;
    let layers = scene.textures.layers.get(triangle.material as usize)?;
    if layers.has_coat_normal == 0 {
        return None;
    }
    let map = NormalMap {
        image: layers.clearcoat_normal,
        scale: layers.clearcoat_normal_scale,
    };
    let barycentric = barycentric(triangle, hit.point);
    let n_out = interpolated_normal(scene, index, barycentric).unwrap_or(hit.n);
    let mapped = map.normal(scene, triangle, uvs, barycentric, n_out);
    let shading_n = facing(mapped, n_out, hit.n);
    let side = if wo.dot(hit.n) < 0.0 { -1.0 } else { 1.0 };
    Some(visible_shading_normal(side * shading_n, side * hit.n, wo))
}

/// Vertex colour at a hit, by which the albedo is multiplied.
pub(super) fn vertex_color(scene: &CompiledScene, hit: &Hit) -> DVec3 {
    let Primitive::Triangle(index) = hit.primitive else {
        return DVec3::ONE;
    };
    let Some(colors) = scene.meshes.colors.get(index as usize) else {
        return DVec3::ONE;
    };
    let weights = barycentric(&scene.meshes.triangles[index as usize], hit.point);
    let color = colors.at(weights.map(|weight| weight as f32));
    color.truncate().as_dvec3()
}

/// Barycentric coordinates of a point of a triangle.
fn barycentric(triangle: &TriangleData, point: DVec3) -> [f64; 3] {
    let [a, b, c] = [triangle.a, triangle.b, triangle.c].map(vector);
    let across = (b - a).cross(c - a);
    let area = across.length_squared();
    // Ratio of the signed area opposite to a corner to that of the triangle.
    let weight = |from: DVec3, to: DVec3| (to - from).cross(point - from).dot(across) / area;
    [weight(b, c), weight(c, a), weight(a, b)]
}
