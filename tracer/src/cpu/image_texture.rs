//! Image textures and normal maps of meshes. Lanes are looked up one by one, as they rarely share a
//! texture.

use std::sync::Arc;

use fearless_simd::prelude::*;
use glam::{Vec2, Vec3};

use super::lanes::{Float, LANES, Vec3x};
use crate::CompiledScene;
use crate::compiled::{CompiledTextures, MaterialTextureData, TriangleData, TriangleUvs};
use crate::scalar::triangle::REFLECTION_SINE_MIN;

/// The textures of a scene's triangles.
pub(super) struct TriangleTextures {
    uvs: Arc<Vec<TriangleUvs>>,
    textures: CompiledTextures,
}

/// Texture values per lane, by which the parameters of the material are multiplied.
pub(super) struct TextureLanes<S: Simd> {
    pub(super) base_color: Vec3x<S>,
    pub(super) roughness: Float<S>,
    pub(super) metallic: Float<S>,
    pub(super) emission: Vec3x<S>,
    pub(super) clearcoat: Float<S>,
    pub(super) clearcoat_roughness: Float<S>,
    /// `None` if no material of the scene has such textures.
    pub(super) layers: Option<LayerTextureLanes<S>>,
    /// `None` if no thin wall of the scene has a transmission texture.
    pub(super) transmission: Option<Float<S>>,
}

/// Texture values of sheen and specular reflection.
#[derive(Clone, Copy)]
pub(super) struct LayerTextureLanes<S: Simd> {
    pub(super) sheen: Vec3x<S>,
    pub(super) sheen_roughness: Float<S>,
    pub(super) specular: Float<S>,
    pub(super) specular_color: Vec3x<S>,
}

/// Hit of one lane.
pub(super) struct LaneHit<'a> {
    pub(super) triangle: &'a TriangleData,
    /// Barycentric coordinates.
    pub(super) weights: [f32; 3],
    /// Width of the surface that the ray covers, metres; 0 for the finest mip level.
    pub(super) footprint_m: f32,
    /// Unit shading normal, on the outer side of the triangle.
    pub(super) n_out: Vec3,
    /// Unit geometric normal on the side from which the ray comes.
    pub(super) n: Vec3,
}

/// Channels of [`TextureLanes`] as arrays by lane, and mapped normals.
pub(super) struct TextureColumns {
    factors: [[f32; LANES]; 10],
    pub(super) normals: [[f32; LANES]; 3],
    /// Bit mask of the lanes with a normal map.
    pub(super) mapped: u64,
    pub(super) layers: Option<LayerColumns>,
    transmission: Option<[f32; LANES]>,
}

/// Channels of [`LayerTextureLanes`] as arrays by lane, and normals of clear coats.
pub(super) struct LayerColumns {
    factors: [[f32; LANES]; 8],
    pub(super) normals: [[f32; LANES]; 3],
    /// Bit mask of the lanes whose coat has a normal of its own.
    pub(super) coated: u64,
}

impl TriangleTextures {
    pub(super) fn new(scene: &CompiledScene) -> Self {
        Self {
            uvs: Arc::clone(&scene.meshes.uvs),
            textures: scene.textures.clone(),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.textures.is_empty()
    }

    /// Looks up all textures at the hit of one lane and stores them in `columns`.
    pub(super) fn look_up(&self, columns: &mut TextureColumns, lane: usize, hit: &LaneHit<'_>) {
        let material = hit.triangle.material as usize;
        let Some(textures) = self.textures.materials.get(material) else {
            return;
        };
        let Some(uvs) = self.uvs.get(hit.triangle.uvs as usize) else {
            return;
        };
        let uv = interpolate(uvs, hit.weights);
        let store = |columns: &mut [[f32; LANES]], image: u32, channels: &[usize]| {
            if image == MaterialTextureData::NONE {
                return;
            }
            let data = &self.textures.images[image as usize];
            let across = (data.width as f32 * data.height as f32).sqrt();
            // log2 of the footprint in texels: at that mip level a texel is as large as the footprint. A
            // footprint of 0 gives −∞, the finest level.
            let level = (hit.footprint_m * uvs.density * across).log2();
            let rgba = self.textures.sample(image, uv, level);
            for (column, channel) in columns.iter_mut().zip(channels) {
                column[lane] = rgba[*channel];
            }
        };
        let factors = &mut columns.factors;
        store(factors, textures.base_color, &[0, 1, 2]);
        store(&mut factors[3..], textures.metallic_roughness, &[1, 2]);
        store(&mut factors[5..], textures.emission, &[0, 1, 2]);
        store(&mut factors[8..], textures.clearcoat, &[0]);
        store(&mut factors[9..], textures.clearcoat_roughness, &[1]);
        let map = (textures.normal, textures.normal_scale);
        if let Some(normal) = self.mapped_normal(map, uvs, uv, hit) {
            store_normal(&mut columns.normals, lane, normal);
            columns.mapped |= 1 << lane;
        }
        if let (Some(column), Some(image)) = (
            columns.transmission.as_mut(),
            self.textures.transmission.get(material),
        ) {
            store(std::slice::from_mut(column), *image, &[0]);
        }
        let Some((columns, textures)) =
            (columns.layers.as_mut()).zip(self.textures.layers.get(material))
        else {
            return;
        };
        let factors = &mut columns.factors;
        store(factors, textures.sheen, &[0, 1, 2]);
        store(&mut factors[3..], textures.sheen_roughness, &[0]);
        store(&mut factors[4..], textures.specular, &[0]);
        store(&mut factors[5..], textures.specular_color, &[0, 1, 2]);
        if textures.has_coat_normal == 1 {
            let map = (textures.clearcoat_normal, textures.clearcoat_normal_scale);
            let normal = self.mapped_normal(map, uvs, uv, hit);
            store_normal(&mut columns.normals, lane, normal.unwrap_or(hit.n_out));
            columns.coated |= 1 << lane;
        }
    }

    /// Columns before any look-up: factors of 1.
    pub(super) fn columns(&self) -> TextureColumns {
        TextureColumns {
            factors: [[1.0; LANES]; 10],
            normals: [[0.0; LANES]; 3],
            mapped: 0,
            layers: (!self.textures.layers.is_empty()).then_some(LayerColumns {
                factors: [[1.0; LANES]; 8],
                normals: [[0.0; LANES]; 3],
                coated: 0,
            }),
            transmission: (!self.textures.transmission.is_empty()).then_some([1.0; LANES]),
        }
    }

    /// Normal from a normal map, as in [`crate::scalar::triangle`].
    fn mapped_normal(
        &self,
        (image, scale): (u32, f32),
        uvs: &TriangleUvs,
        uv: [f32; 2],
        hit: &LaneHit<'_>,
    ) -> Option<Vec3> {
        if image == MaterialTextureData::NONE {
            return None;
        }
        let [tangent, bitangent] = tangents(hit.triangle, uvs, hit.n_out)?;
        // Always the finest level: averaged normals are shorter and would flatten the surface.
        let [x, y, z, _] = (self.textures.sample(image, uv, 0.0)).map(|c| 2.0 * c - 1.0);
        let (x, y) = (scale * x, scale * y);
        let mapped = (x * tangent + y * bitangent + z * hit.n_out).try_normalize()?;
        let mapped = if hit.n_out.dot(hit.n) < 0.0 {
            -mapped
        } else {
            mapped
        };
        // Lifted above the geometric surface, as by the scalar tracer's `facing`.
        let lift = REFLECTION_SINE_MIN as f32 - mapped.dot(hit.n);
        Some(match lift > 0.0 {
            true => (mapped + lift * hit.n).normalize(),
            false => mapped,
        })
    }
}

impl TextureColumns {
    #[inline(always)]
    pub(super) fn lanes<S: Simd>(&self, simd: S) -> TextureLanes<S> {
        let number = |column: usize| Float::load_array(simd, self.factors[column]);
        let triple = |first: usize| Vec3x::new(number(first), number(first + 1), number(first + 2));
        TextureLanes {
            base_color: triple(0),
            roughness: number(3),
            metallic: number(4),
            emission: triple(5),
            clearcoat: number(8),
            clearcoat_roughness: number(9),
            layers: self.layers.as_ref().map(|layers| layers.lanes(simd)),
            transmission: (self.transmission).map(|column| Float::load_array(simd, column)),
        }
    }
}

impl LayerColumns {
    #[inline(always)]
    fn lanes<S: Simd>(&self, simd: S) -> LayerTextureLanes<S> {
        let number = |column: usize| Float::load_array(simd, self.factors[column]);
        let triple = |first: usize| Vec3x::new(number(first), number(first + 1), number(first + 2));
        LayerTextureLanes {
            sheen: triple(0),
            sheen_roughness: number(3),
            specular: number(4),
            specular_color: triple(5),
        }
    }
}

fn store_normal(columns: &mut [[f32; LANES]; 3], lane: usize, normal: Vec3) {
    for (column, coordinate) in columns.iter_mut().zip(normal.to_array()) {
        column[lane] = coordinate;
    }
}

fn interpolate(uvs: &TriangleUvs, [wa, wb, wc]: [f32; 3]) -> [f32; 2] {
    let [a, b, c] = [uvs.a, uvs.b, uvs.c].map(Vec2::from);
    (wa * a + wb * b + wc * c).to_array()
}

/// Tangent and bitangent of a triangle's texture coordinates, as in the scalar tracer's `normal_map`.
fn tangents(triangle: &TriangleData, uvs: &TriangleUvs, n: Vec3) -> Option<[Vec3; 2]> {
    let [a, b, c] = triangle.corners();
    let [ta, tb, tc] = [uvs.a, uvs.b, uvs.c].map(Vec2::from);
    let (edge_b, edge_c, uv_b, uv_c) = (b - a, c - a, tb - ta, tc - ta);
    // The sign of the determinant instead of a division by it: only directions are needed. It is negative
    // for mirrored textures, which reverses both.
    let turn = uv_b.perp_dot(uv_c).signum();
    let along_u = turn * (uv_c.y * edge_b - uv_b.y * edge_c);
    let along_v = turn * (uv_b.x * edge_c - uv_c.x * edge_b);
    let tangent = (along_u - n * n.dot(along_u)).try_normalize()?;
    let across = n.cross(tangent);
    let side = if across.dot(along_v) > 0.0 { -1.0 } else { 1.0 };
    Some([tangent, side * across])
}
