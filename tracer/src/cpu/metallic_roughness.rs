//! The material of glTF 2.0, a lane each: the arithmetic of [`crate::scalar::metallic_roughness`].
//!
//! Only packets that met such a surface come here, out of line: other scenes are not to pay for it.

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

/// Such materials of a scene.
pub(super) struct MetallicRoughnessTable {
    /// One row of numbers per primitive that scatters, in the order of ids; empty without such a material.
    rows: Vec<MetallicRoughnessRow>,
    /// Some have a clear coat or a sheen.
    has_layers: bool,
    /// Some are thin walls.
    has_walls: bool,
}

type MetallicRoughnessRow = [f32; 27];

const IS_SUCH: usize = 0;
const DIELECTRIC_F0: usize = 1;
const METALLIC: usize = 4;
const ALPHA: usize = 5;
const BASE_COLOR: usize = 6;
const EMISSION: usize = 9;
/// Reflectance at grazing angles of what is no metal.
const SPECULAR: usize = 12;
const CLEARCOAT: usize = 13;
const CLEARCOAT_ALPHA: usize = 14;
const SHEEN: usize = 15;
const SHEEN_ROUGHNESS: usize = 18;
/// What the sheen would reflect at six cosines.
const SHEEN_REFLECTED: usize = 19;
/// With which light sampling draws points on the surface, m⁻²; 0 of shapes that it does not.
const POINT_DENSITY: usize = 25;
const TRANSMISSION: usize = 26;

impl MetallicRoughnessTable {
    /// `materials` are those of all rows, and of which shape these are.
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

/// Such surfaces of a packet's hits. Normals are on the side of `wo`.
#[derive(Clone, Copy)]
pub(super) struct MetallicRoughness<S: Simd> {
    pub(super) lanes: Mask<S>,
    pub(super) emission: Vec3x<S>,
    /// With which light sampling draws the point among all of surfaces that emit, m⁻²; 0 where it does not.
    pub(super) point_density: Float<S>,
    diffuse: Vec3x<S>,
    f0: Vec3x<S>,
    f90: Float<S>,
    dielectric_f0: Float<S>,
    base_f90: Float<S>,
    alpha: Float<S>,
    /// Of scenes where some have any.
    layers: Option<LayerLanes<S>>,
    /// Of scenes where some let light pass.
    wall: Option<WallLanes<S>>,
}

/// Clear coat and sheen.
#[derive(Clone, Copy)]
struct LayerLanes<S: Simd> {
    clearcoat: Float<S>,
    clearcoat_alpha: Float<S>,
    /// Of coats that have another than what is below; 0 in other lanes.
    normal: Option<Vec3x<S>>,
    sheen: Sheen<S>,
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

    /// The share of light that the sheen would reflect at a cosine, about.
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

    /// The normal of the coat where that of what is below is given.
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

    /// What the coat reflects at a cosine.
    #[inline(always)]
    fn reflected(&self, cos: Float<S>) -> Float<S> {
        self.clearcoat * grazing(cos).mul_add(1.0 - CLEARCOAT_F0, CLEARCOAT_F0)
    }
}

impl<S: Simd> MetallicRoughness<S> {
    /// None if all lanes met other surfaces.
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

    /// Mollifies it in lanes that are `regularised` ([`crate::regularisation`]).
    #[inline(always)]
    pub(super) fn regularise(&mut self, regularised: Mask<S>) {
        self.alpha = regularised.select(self.alpha.max(ALPHA_MIN), self.alpha);
        if let Some(layers) = &mut self.layers {
            let alpha = layers.clearcoat_alpha;
            layers.clearcoat_alpha = regularised.select(alpha.max(ALPHA_MIN), alpha);
        }
    }

    /// `f · |cos θ|` and the density of `wi`.
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

    /// Without what passes.
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

    /// Where a clear coat that has another normal than what is below faces `wi`; none if no lane has.
    #[inline(always)]
    pub(super) fn clearcoat_faces(&self, wi: Vec3x<S>) -> Option<Mask<S>> {
        let normal = self.layers.as_ref()?.normal?;
        Some(self.lanes & normal.dot(wi).simd_gt(0.0))
    }

    /// Draws a direction as the scalar tracer does.
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
                    // What a lobe draws on the other side than its own has no weight.
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

    /// About what it reflects of even light and lets pass.
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

    /// Into the base or out of it.
    #[inline(always)]
    fn passed(&self, cos: Float<S>) -> Float<S> {
        1.0 - self.dielectric_f0 - (self.base_f90 - self.dielectric_f0) * grazing(cos)
    }

    #[inline(always)]
    fn reflected_share(&self, cos_o: Float<S>) -> Float<S> {
        let sum = |v: Vec3x<S>| v.x + v.y + v.z;
        let reflected = sum(self.schlick(grazing(cos_o)));
        let mut all = sum(self.diffuse).mul_add(self.passed(cos_o), reflected);
        if let Some(layers) = &self.layers {
            all += layers.sheen_reflected(cos_o).min(1.0) * 3.0;
        }
        // What is black and of index 1 sends nothing on along its normal.
        reflected / all.max(f32::MIN_POSITIVE)
    }

    /// The probability with which a direction is drawn from the coat; 0 without layers.
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

/// The fifth power in Schlick's term.
#[inline(always)]
fn grazing<S: Simd>(cos: Float<S>) -> Float<S> {
    let off = (1.0 - cos).max(0.0).min(1.0);
    let square = off * off;
    square * square * off
}
