//! The material of glTF 2.0, one surface point per lane: the arithmetic of
//! [`crate::scalar::metallic_roughness`].
//!
//! Evaluated only for packets that hit such a surface, and not inlined, so that other scenes do not pay for
//! the code.

mod thin_wall;

use std::f32::consts::{FRAC_1_PI, TAU};

use fearless_simd::prelude::*;

use self::thin_wall::WallLanes;
use super::image_texture::TextureLanes;
use super::lanes::{Float, Mask, Vec3x, Word};
use super::microfacet::{ggx, normalize, sample_visible, visibility};
use super::rows::Rows;
use super::sampling::{BsdfSample, cosine_hemisphere};
use super::sheen::{Sheen, sheen_reflectances};
use super::triangle_surface::TriangleHit;
use crate::CompiledScene;
use crate::compiled::{KIND_METALLIC_ROUGHNESS, MaterialData, ShapeKind};
use crate::regularisation::ALPHA_MIN;
use crate::scalar::metallic_roughness::{ALPHA_LEAST, CLEARCOAT_F0};
use crate::scene::validate::SHEEN_ROUGHNESS as SHEEN_WIDTHS;

/// Parameters of all metallic-roughness materials of a scene.
pub(super) struct MetallicRoughnessTable {
    /// One row per primitive that scatters, in the order of ids; empty without such a material.
    rows: Vec<MetallicRoughnessRow>,
    /// Whether some material has a clear coat or a sheen.
    has_layers: bool,
    /// Whether some material is a thin wall.
    has_walls: bool,
}

type MetallicRoughnessRow = [f32; 27];

// Columns of a row.
const IS_SUCH: usize = 0;
const DIELECTRIC_F0: usize = 1;
const METALLIC: usize = 4;
const ALPHA: usize = 5;
const BASE_COLOR: usize = 6;
const EMISSION: usize = 9;
// Reflectance of the dielectric part at grazing incidence (F90).
const SPECULAR: usize = 12;
const CLEARCOAT: usize = 13;
const CLEARCOAT_ALPHA: usize = 14;
const SHEEN: usize = 15;
const SHEEN_ROUGHNESS: usize = 18;
// Directional albedo of the sheen at six cosines.
const SHEEN_REFLECTED: usize = 19;
// Density with which light sampling draws points on the surface, m⁻²; 0 for shapes that it does not sample.
const POINT_DENSITY: usize = 25;
const TRANSMISSION: usize = 26;

impl MetallicRoughnessTable {
    /// `materials` returns shape and material of each row.
    pub(super) fn new<'a, I: Iterator<Item = (ShapeKind, &'a MaterialData)>>(
        scene: &CompiledScene,
        materials: impl FnOnce() -> I,
    ) -> Self {
        let has_some = (scene.materials.iter()).any(|m| m.kind == KIND_METALLIC_ROUGHNESS);
        Self {
            rows: match has_some {
                true => materials().map(metallic_roughness_row).collect(),
                false => Vec::new(),
            },
            has_layers: scene.materials.iter().any(MaterialData::has_layers),
            has_walls: scene.materials.iter().any(MaterialData::is_thin_wall),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }
}

fn metallic_roughness_row((shape, material): (ShapeKind, &MaterialData)) -> MetallicRoughnessRow {
    let mut row = [0.0; 27];
    if material.kind != KIND_METALLIC_ROUGHNESS {
        return row;
    }
    row[IS_SUCH] = 1.0;
    // glTF's material reuses fields of other kinds: see `MaterialData`.
    row[DIELECTRIC_F0..][..3].copy_from_slice(&material.eta);
    row[SPECULAR] = material.diffuse_scale;
    row[METALLIC] = material.metallic;
    row[ALPHA] = material.alpha;
    row[BASE_COLOR..][..3].copy_from_slice(&material.albedo);
    row[EMISSION..][..3].copy_from_slice(&material.k);
    row[CLEARCOAT..][..2].copy_from_slice(&material.stripe_albedo[..2]);
    row[TRANSMISSION] = material.stripe_albedo[2];
    row[SHEEN..][..3].copy_from_slice(&material.sheen);
    row[SHEEN_ROUGHNESS] = material.sheen_roughness;
    row[SHEEN_REFLECTED..][..3].copy_from_slice(&material.extinction);
    row[SHEEN_REFLECTED + 3..][..3].copy_from_slice(&material.scattering);
    if shape.is_light_sampled() {
        row[POINT_DENSITY] = material.sampling_density;
    }
    row
}

/// BSDF of the metallic-roughness surfaces hit by a packet. Normals are on the side of `wo`.
#[derive(Clone, Copy)]
pub(super) struct MetallicRoughness<S: Simd> {
    pub(super) lanes: Mask<S>,
    pub(super) emission: Vec3x<S>,
    /// Density with which light sampling draws the point among emissive surfaces, m⁻²; 0 where it does not.
    pub(super) point_density: Float<S>,
    diffuse: Vec3x<S>,
    f0: Vec3x<S>,
    f90: Float<S>,
    dielectric_f0: Float<S>,
    base_f90: Float<S>,
    alpha: Float<S>,
    /// `None` if no material of the scene has layers.
    layers: Option<LayerLanes<S>>,
    /// `None` if no material of the scene is a thin wall.
    wall: Option<WallLanes<S>>,
}

/// Clear coat and sheen.
#[derive(Clone, Copy)]
struct LayerLanes<S: Simd> {
    clearcoat: Float<S>,
    clearcoat_alpha: Float<S>,
    /// Normal of coats with one of their own; 0 in other lanes; `None` if there are none.
    normal: Option<Vec3x<S>>,
    sheen: Sheen<S>,
    /// Directional albedo of the sheen at six cosines.
    sheen_reflected: [Float<S>; 6],
}

impl<S: Simd> LayerLanes<S> {
    #[inline(always)]
    fn new(
        simd: S,
        rows: &Rows<'_, 27>,
        lanes: Mask<S>,
        textures: Option<&TextureLanes<S>>,
        normal: Option<Vec3x<S>>,
    ) -> Self {
        let mut clearcoat = rows.number(simd, CLEARCOAT);
        let mut clearcoat_alpha = rows.number(simd, CLEARCOAT_ALPHA);
        if let Some(textures) = textures {
            let roughness = textures.clearcoat_roughness;
            clearcoat *= textures.clearcoat;
            clearcoat_alpha *= roughness * roughness;
        }
        let width = rows.number(simd, SHEEN_ROUGHNESS);
        let mut width = lanes.select(width, Float::splat(simd, 1.0));
        let mut sheen = rows.triple(simd, SHEEN);
        let mut sheen_reflected = [
            rows.number(simd, SHEEN_REFLECTED),
            rows.number(simd, SHEEN_REFLECTED + 1),
            rows.number(simd, SHEEN_REFLECTED + 2),
            rows.number(simd, SHEEN_REFLECTED + 3),
            rows.number(simd, SHEEN_REFLECTED + 4),
            rows.number(simd, SHEEN_REFLECTED + 5),
        ];
        if let Some(textures) = textures.and_then(|textures| textures.layers.as_ref()) {
            let roughness = textures.sheen_roughness;
            width = (width * roughness * roughness).max(*SHEEN_WIDTHS.start());
            sheen = sheen.scale(textures.sheen);
            let strength = sheen.x.max(sheen.y).max(sheen.z) * TAU;
            sheen_reflected = sheen_reflectances(simd, width, strength);
        }
        Self {
            clearcoat,
            clearcoat_alpha: clearcoat_alpha.max(ALPHA_LEAST),
            normal,
            sheen: Sheen::of(sheen, width),
            sheen_reflected,
        }
    }

    /// Approximate directional albedo of the sheen: linear interpolation between six nodes, equidistant in
    /// √cos.
    #[inline(always)]
    fn sheen_reflected(&self, cos: Float<S>) -> Float<S> {
        let place = cos.max(0.0).min(1.0).sqrt() * 5.0;
        let mut share = Float::splat(cos.token(), 0.0);
        for (node, reflected) in (0u8..).zip(self.sheen_reflected) {
            let hat = (1.0 - (place - f32::from(node)).abs()).max(0.0);
            share += reflected * hat;
        }
        share
    }

    /// Normal of the coat, given that of the base layer.
    #[inline(always)]
    fn normal(&self, below: Vec3x<S>) -> Vec3x<S> {
        match self.normal {
            Some(normal) => {
                let is_own = normal.length_squared().simd_gt(0.0);
                Vec3x::select(is_own, normal, below)
            }
            None => below,
        }
    }

    /// Share of light that the coat reflects at a cosine: Schlick's Fresnel term times its strength.
    #[inline(always)]
    fn reflected(&self, cos: Float<S>) -> Float<S> {
        self.clearcoat * grazing(cos).mul_add(1.0 - CLEARCOAT_F0, CLEARCOAT_F0)
    }
}

impl<S: Simd> MetallicRoughness<S> {
    /// `None` if all lanes hit other materials.
    #[inline(never)]
    pub(super) fn new(
        simd: S,
        table: &MetallicRoughnessTable,
        id: Word<S>,
        triangles: Option<&TriangleHit<S>>,
    ) -> Option<Self> {
        simd.vectorize(
            #[inline(always)]
            || {
                let rows = Rows::new(&table.rows, id);
                let lanes = rows.number(simd, IS_SUCH).simd_gt(0.0);
                if !lanes.any_true() {
                    return None;
                }
                let mut base = rows.triple(simd, BASE_COLOR);
                let mut metallic = rows.number(simd, METALLIC);
                let mut alpha = rows.number(simd, ALPHA);
                let mut emission = rows.triple(simd, EMISSION);
                let textures = triangles.and_then(|triangles| triangles.textures.as_ref());
                if let Some(textures) = textures {
                    base = base.scale(textures.base_color);
                    metallic *= textures.metallic;
                    alpha *= textures.roughness * textures.roughness;
                    emission = emission.scale(textures.emission);
                }
                if let Some(color) = triangles.and_then(|triangles| triangles.color) {
                    base = base.scale(color);
                }
                let mut even = rows.triple(simd, DIELECTRIC_F0);
                let mut specular = rows.number(simd, SPECULAR);
                if let Some(textures) = textures.and_then(|textures| textures.layers.as_ref()) {
                    specular *= textures.specular;
                    let scaled = even.scale(textures.specular_color) * textures.specular;
                    even = Vec3x::new(
                        scaled.x.min(specular),
                        scaled.y.min(specular),
                        scaled.z.min(specular),
                    );
                }
                let dielectric_f0 = even.x.max(even.y).max(even.z);
                let mut layers = None;
                if table.has_layers {
                    let normal = triangles.and_then(|triangles| triangles.clearcoat_normal);
                    layers = Some(LayerLanes::new(simd, &rows, lanes, textures, normal));
                }
                let mut diffuse = base * (1.0 - metallic);
                let mut wall = None;
                if table.has_walls {
                    let mut transmission = rows.number(simd, TRANSMISSION);
                    if let Some(factor) = textures.and_then(|textures| textures.transmission) {
                        transmission *= factor;
                    }
                    let alpha = alpha.max(ALPHA_LEAST);
                    wall = Some(WallLanes::new(diffuse * transmission, specular, alpha));
                    diffuse = diffuse * (1.0 - transmission);
                }
                Some(Self {
                    lanes,
                    emission,
                    point_density: rows.number(simd, POINT_DENSITY),
                    diffuse,
                    f0: (base - even).mul_add(metallic, even),
                    // Metals reflect all light at grazing incidence.
                    f90: (1.0 - specular).mul_add(metallic, specular),
                    dielectric_f0,
                    base_f90: ((1.0 - alpha) * (1.0 - alpha) * specular).max(dielectric_f0),
                    alpha: alpha.max(ALPHA_LEAST),
                    layers,
                    wall,
                })
            },
        )
    }

    /// Widens the lobes in lanes that are `regularised` ([`crate::regularisation`]).
    #[inline(always)]
    pub(super) fn regularise(&mut self, regularised: Mask<S>) {
        self.alpha = regularised.select(self.alpha.max(ALPHA_MIN), self.alpha);
        if let Some(layers) = &mut self.layers {
            let alpha = layers.clearcoat_alpha;
            layers.clearcoat_alpha = regularised.select(alpha.max(ALPHA_MIN), alpha);
        }
    }

    /// `f · |cos θ|`, and the density of `wi` per solid angle.
    #[inline(never)]
    pub(super) fn evaluate(
        &self,
        simd: S,
        normal: Vec3x<S>,
        wo: Vec3x<S>,
        wi: Vec3x<S>,
    ) -> (Vec3x<S>, Float<S>) {
        simd.vectorize(
            #[inline(always)]
            || self.evaluate_inline(simd, normal, wo, wi),
        )
    }

    #[inline(always)]
    fn evaluate_inline(
        &self,
        simd: S,
        normal: Vec3x<S>,
        wo: Vec3x<S>,
        wi: Vec3x<S>,
    ) -> (Vec3x<S>, Float<S>) {
        let above = self.evaluate_above(simd, normal, wo, wi);
        match &self.wall {
            Some(wall) => self.with_wall(simd, wall, normal, wo, wi, above),
            None => above,
        }
    }

    /// Lobes other than transmission through thin walls.
    #[inline(always)]
    fn evaluate_above(
        &self,
        simd: S,
        normal: Vec3x<S>,
        wo: Vec3x<S>,
        wi: Vec3x<S>,
    ) -> (Vec3x<S>, Float<S>) {
        let zero = Float::splat(simd, 0.0);
        let (cos_o, cos_i) = (normal.dot(wo), normal.dot(wi));
        let valid = cos_o.simd_gt(0.0) & cos_i.simd_gt(0.0);
        let h = normalize(wo + wi);
        let seen = ggx(self.alpha, normal, h) * visibility(self.alpha, cos_o) * 0.25;
        let shadowing = visibility(self.alpha, cos_i) * cos_i;
        let off = grazing(wo.dot(h));
        let reflected = self.schlick(off) * (seen * shadowing);
        // Diffuse light is attenuated by the Fresnel term on entry and on exit, over the mean of the
        // latter. For Schlick's s = (1 − cos)⁵ the cosine-weighted hemispherical mean of s is 1/21, that of
        // s² is 1/66.
        let passed = self.passed(cos_o) * self.passed(cos_i);
        let rise = self.base_f90 - self.dielectric_f0;
        let mut mean_passed = 1.0 - self.dielectric_f0 - rise * (1.0 / 21.0);
        if let Some(layers) = &self.layers {
            let coat_rise = layers.clearcoat * (1.0 - CLEARCOAT_F0);
            let lost = (1.0 - self.dielectric_f0) * (1.0 / 21.0) - rise * (1.0 / 66.0);
            let coat_passed = 1.0 - layers.clearcoat * CLEARCOAT_F0;
            mean_passed = mean_passed * coat_passed - coat_rise * lost;
        }
        let scale = 1.0 / mean_passed;
        let scattered = self.diffuse * (passed * scale * cos_i * FRAC_1_PI);
        let share = self.reflected_share(cos_o);
        let mut pdf = share.mul_add(seen, (1.0 - share) * cos_i * FRAC_1_PI);
        let mut f_cos = reflected + scattered;
        if let Some(layers) = &self.layers {
            // Sheen over base as in glTF's KHR_materials_sheen: the base is scaled by 1 − max(E(wo),
            // E(wi)).
            let napped = layers.sheen.evaluate(simd, normal, wo, wi) * cos_i;
            let shared = (layers.sheen_reflected(cos_o)).max(layers.sheen_reflected(cos_i));
            f_cos = f_cos * (1.0 - shared).max(0.0) + napped * (1.0 / shared.max(1.0));
        }
        let black = Vec3x::new(zero, zero, zero);
        f_cos = Vec3x::select(valid, f_cos, black);
        pdf = valid.select(pdf, zero);
        let Some(layers) = &self.layers else {
            return (f_cos, pdf);
        };
        let (alpha, coat_normal) = (layers.clearcoat_alpha, layers.normal(normal));
        let (cos_o, cos_i) = (coat_normal.dot(wo), coat_normal.dot(wi));
        let valid = cos_o.simd_gt(0.0) & cos_i.simd_gt(0.0);
        let seen = ggx(alpha, coat_normal, h) * visibility(alpha, cos_o) * 0.25;
        let seen = valid.select(seen, zero);
        let shadowing = visibility(alpha, cos_i) * cos_i;
        let coat = valid.select(layers.reflected(wo.dot(h)) * seen * shadowing, zero);
        let passed = (1.0 - layers.reflected(cos_o)) * (1.0 - layers.reflected(cos_i));
        let share = self.clearcoat_share(simd, normal, wo);
        (
            f_cos * passed + Vec3x::new(coat, coat, coat),
            share.mul_add(seen, (1.0 - share) * pdf),
        )
    }

    /// Lanes whose clear coat has a normal of its own that faces `wi`; `None` if the scene has no such
    /// coat.
    #[inline(always)]
    pub(super) fn clearcoat_faces(&self, wi: Vec3x<S>) -> Option<Mask<S>> {
        let normal = self.layers.as_ref()?.normal?;
        Some(self.lanes & normal.dot(wi).simd_gt(0.0))
    }

    /// Draws a direction, by the same choices as the scalar tracer.
    #[inline(never)]
    pub(super) fn sample(
        &self,
        simd: S,
        normal: Vec3x<S>,
        wo: Vec3x<S>,
        u: [Float<S>; 3],
    ) -> BsdfSample<S> {
        simd.vectorize(
            #[inline(always)]
            || {
                let share = self.reflected_share(normal.dot(wo));
                // Each choice rescales u0 for the next; it is unused in lanes that are already decided.
                let (mut u0, mut alpha, mut coated) = (u[0], self.alpha, Mask::splat(simd, false));
                let mut mirror_normal = normal;
                let (mut passes, mut passed_share) = (coated, Float::splat(simd, 0.0));
                if let Some(wall) = &self.wall {
                    passed_share = self.passed_share(simd, wall, normal, wo);
                    passes = u0.simd_lt(passed_share);
                    u0 = (u0 - passed_share) / (1.0 - passed_share);
                }
                if let Some(layers) = &self.layers {
                    let coat = self.clearcoat_share(simd, normal, wo);
                    coated = u0.simd_lt(coat) & !passes;
                    u0 = (u0 - coat) / (1.0 - coat);
                    alpha = coated.select(layers.clearcoat_alpha, alpha);
                    mirror_normal = Vec3x::select(coated, layers.normal(normal), normal);
                }
                let h = sample_visible(simd, alpha, mirror_normal, wo, u[1], u[2]);
                let mirrored = h.mul_add(wo.dot(h) * 2.0, -wo);
                let even = cosine_hemisphere(simd, normal, u[1], u[2]);
                let mut wi = Vec3x::select(coated | u0.simd_lt(share), mirrored, even);
                if let Some(wall) = &self.wall {
                    let passed = Self::passed_direction(wall, normal, wo, h);
                    wi = Vec3x::select(passes, passed, wi);
                }
                let (f_cos, mut pdf) = self.evaluate_inline(simd, normal, wo, wi);
                let mut is_some = pdf.simd_gt(0.0);
                if self
                    .layers
                    .as_ref()
                    .is_some_and(|layers| layers.normal.is_some())
                {
                    is_some &= passes | mirror_normal.dot(wi).simd_gt(0.0);
                }
                if let Some(wall) = &self.wall {
                    // A direction on the other side than that of its lobe has weight 0.
                    let behind = normal.dot(wi).simd_lt(0.0);
                    is_some &= !wall.lanes | !(behind ^ passes);
                }
                let one = Float::splat(simd, 1.0);
                let weight = f_cos * (one / is_some.select(pdf, one));
                let black = Vec3x::splat(simd, [0.0; 3]);
                let mut weight = Vec3x::select(is_some, weight, black);
                if let Some(wall) = &self.wall {
                    let (straight, passed) =
                        self.straight_weight(wall, normal, wo, passes, passed_share);
                    weight = Vec3x::select(straight, passed, weight);
                    pdf = straight.select(Float::splat(simd, f32::INFINITY), pdf);
                }
                BsdfSample { wi, weight, pdf }
            },
        )
    }

    /// Approximate albedo, including transmittance.
    #[inline(always)]
    pub(super) fn albedo(&self) -> Vec3x<S> {
        let mut sum = self.diffuse + self.f0;
        if let Some(wall) = &self.wall {
            sum = sum + wall.color;
        }
        Vec3x::new(sum.x.min(1.0), sum.y.min(1.0), sum.z.min(1.0))
    }

    #[inline(always)]
    fn schlick(&self, off: Float<S>) -> Vec3x<S> {
        let f90 = Vec3x::new(self.f90, self.f90, self.f90);
        (f90 - self.f0).mul_add(off, self.f0)
    }

    /// Fresnel transmittance of the interface over the diffuse base at a cosine.
    #[inline(always)]
    fn passed(&self, cos: Float<S>) -> Float<S> {
        1.0 - self.dielectric_f0 - (self.base_f90 - self.dielectric_f0) * grazing(cos)
    }

    /// Probability of the specular lobe beside the diffuse lobe.
    #[inline(always)]
    fn reflected_share(&self, cos_o: Float<S>) -> Float<S> {
        let sum = |v: Vec3x<S>| v.x + v.y + v.z;
        let reflected = sum(self.schlick(grazing(cos_o)));
        let mut all = sum(self.diffuse).mul_add(self.passed(cos_o), reflected);
        if let Some(layers) = &self.layers {
            all += layers.sheen_reflected(cos_o).min(1.0) * 3.0;
        }
        // All terms are 0 for a black material with index 1 at normal incidence.
        reflected / all.max(f32::MIN_POSITIVE)
    }

    /// Probability of drawing a direction from the coat; 0 without layers.
    #[inline(always)]
    fn clearcoat_share(&self, simd: S, normal: Vec3x<S>, wo: Vec3x<S>) -> Float<S> {
        let Some(layers) = &self.layers else {
            return Float::splat(simd, 0.0);
        };
        let cos_o = normal.dot(wo);
        let sum = |v: Vec3x<S>| v.x + v.y + v.z;
        let reflected = sum(self.schlick(grazing(cos_o)));
        let sheen = layers.sheen_reflected(cos_o).min(1.0) * 3.0;
        let below = sum(self.diffuse).mul_add(self.passed(cos_o), reflected) + sheen;
        let coat = layers.reflected(layers.normal(normal).dot(wo));
        let all = (1.0 - coat).mul_add(below * (1.0 / 3.0), coat);
        coat / all.max(f32::MIN_POSITIVE)
    }
}

/// The fifth power (1 − cos)⁵ of Schlick's approximation.
#[inline(always)]
fn grazing<S: Simd>(cos: Float<S>) -> Float<S> {
    let off = (1.0 - cos).max(0.0).min(1.0);
    let square = off * off;
    square * square * off
}
