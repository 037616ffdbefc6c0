//! The material of glTF 2.0, a lane each: the arithmetic of [`crate::scalar::metallic_roughness`].
//!
//! Only packets that met such a surface come here, out of line: other scenes are not to pay for it.

use std::f32::consts::FRAC_1_PI;

use fearless_simd::prelude::*;

use super::image_texture::TextureLanes;
use super::lanes::{Float, Mask, Vec3x, Word};
use super::microfacet::{ggx, normalize, sample_visible, visibility};
use super::rows::Rows;
use super::sampling::{BsdfSample, cosine_hemisphere};
use crate::compiled::{KIND_METALLIC_ROUGHNESS, MaterialData};
use crate::regularisation::ALPHA_MIN;
use crate::scalar::metallic_roughness::ALPHA_LEAST;

/// One row of numbers per primitive that scatters, in the order of ids.
pub(super) type MetallicRoughnessRow = [f32; 10];

const IS_SUCH: usize = 0;
const DIELECTRIC_F0: usize = 1;
const METALLIC: usize = 2;
const ALPHA: usize = 3;
const BASE_COLOR: usize = 4;
const EMISSION: usize = 7;

pub(super) fn metallic_roughness_row(material: &MaterialData) -> MetallicRoughnessRow {
    let mut row = [0.0; 10];
    if material.kind != KIND_METALLIC_ROUGHNESS {
        return row;
    }
    row[IS_SUCH] = 1.0;
    row[DIELECTRIC_F0] = material.eta[0];
    row[METALLIC] = material.metallic;
    row[ALPHA] = material.alpha;
    row[BASE_COLOR..][..3].copy_from_slice(&material.albedo);
    row[EMISSION..][..3].copy_from_slice(&material.k);
    row
}

/// Such surfaces of a packet's hits. Normals are on the side of `wo`.
#[derive(Clone, Copy)]
pub(super) struct MetallicRoughness<S: Simd> {
    pub(super) lanes: Mask<S>,
    pub(super) emission: Vec3x<S>,
    diffuse: Vec3x<S>,
    f0: Vec3x<S>,
    dielectric_f0: Float<S>,
    base_f90: Float<S>,
    alpha: Float<S>,
}

impl<S: Simd> MetallicRoughness<S> {
    /// None if all lanes met other surfaces.
    #[inline(never)]
    pub(super) fn new(
        simd: S,
        table: &[MetallicRoughnessRow],
        id: Word<S>,
        textures: Option<&TextureLanes<S>>,
    ) -> Option<Self> {
        simd.vectorize(
            #[inline(always)]
            || {
                let rows = Rows::new(table, id);
                let lanes = rows.number(simd, IS_SUCH).simd_gt(0.0);
                if !lanes.any_true() {
                    return None;
                }
                let mut base = rows.triple(simd, BASE_COLOR);
                let mut metallic = rows.number(simd, METALLIC);
                let mut alpha = rows.number(simd, ALPHA);
                let mut emission = rows.triple(simd, EMISSION);
                if let Some(textures) = textures {
                    base = base.scale(textures.base_color);
                    metallic *= textures.metallic;
                    alpha *= textures.roughness * textures.roughness;
                    emission = emission.scale(textures.emission);
                }
                let dielectric_f0 = rows.number(simd, DIELECTRIC_F0);
                let even = Vec3x::new(dielectric_f0, dielectric_f0, dielectric_f0);
                Some(Self {
                    lanes,
                    emission,
                    diffuse: base * (1.0 - metallic),
                    f0: (base - even).mul_add(metallic, even),
                    dielectric_f0,
                    base_f90: ((1.0 - alpha) * (1.0 - alpha)).max(dielectric_f0),
                    alpha: alpha.max(ALPHA_LEAST),
                })
            },
        )
    }

    /// Mollifies it in lanes that are `regularised` ([`crate::regularisation`]).
    #[inline(always)]
    pub(super) fn regularise(&mut self, regularised: Mask<S>) {
        self.alpha = regularised.select(self.alpha.max(ALPHA_MIN), self.alpha);
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
        let zero = Float::splat(simd, 0.0);
        let (cos_o, cos_i) = (normal.dot(wo), normal.dot(wi));
        let valid = cos_o.simd_gt(0.0) & cos_i.simd_gt(0.0);
        let h = normalize(wo + wi);
        let seen = ggx(self.alpha, normal, h) * visibility(self.alpha, cos_o) * 0.25;
        let shadowing = visibility(self.alpha, cos_i) * cos_i;
        let off = grazing(wo.dot(h));
        let reflected = self.schlick(simd, off) * (seen * shadowing);
        let passed = self.passed(cos_o) * self.passed(cos_i);
        let rise = self.base_f90 - self.dielectric_f0;
        let scale = 1.0 / (1.0 - self.dielectric_f0 - rise * (1.0 / 21.0));
        let scattered = self.diffuse * (passed * scale * cos_i * FRAC_1_PI);
        let share = self.reflected_share(simd, cos_o);
        let pdf = share.mul_add(seen, (1.0 - share) * cos_i * FRAC_1_PI);
        let black = Vec3x::new(zero, zero, zero);
        (
            Vec3x::select(valid, reflected + scattered, black),
            valid.select(pdf, zero),
        )
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
                let share = self.reflected_share(simd, normal.dot(wo));
                let h = sample_visible(simd, self.alpha, normal, wo, u[1], u[2]);
                let mirrored = h.mul_add(wo.dot(h) * 2.0, -wo);
                let even = cosine_hemisphere(simd, normal, u[1], u[2]);
                let wi = Vec3x::select(u[0].simd_lt(share), mirrored, even);
                let (f_cos, pdf) = self.evaluate_inline(simd, normal, wo, wi);
                let is_some = pdf.simd_gt(0.0);
                let one = Float::splat(simd, 1.0);
                let weight = f_cos * (one / is_some.select(pdf, one));
                let black = Vec3x::splat(simd, [0.0; 3]);
                BsdfSample {
                    wi,
                    weight: Vec3x::select(is_some, weight, black),
                    pdf,
                }
            },
        )
    }

    /// About what it reflects of even light.
    #[inline(always)]
    pub(super) fn albedo(&self) -> Vec3x<S> {
        let sum = self.diffuse + self.f0;
        Vec3x::new(sum.x.min(1.0), sum.y.min(1.0), sum.z.min(1.0))
    }

    #[inline(always)]
    fn schlick(&self, simd: S, off: Float<S>) -> Vec3x<S> {
        let white = Vec3x::splat(simd, [1.0; 3]);
        (white - self.f0).mul_add(off, self.f0)
    }

    /// Into the base or out of it.
    #[inline(always)]
    fn passed(&self, cos: Float<S>) -> Float<S> {
        1.0 - self.dielectric_f0 - (self.base_f90 - self.dielectric_f0) * grazing(cos)
    }

    #[inline(always)]
    fn reflected_share(&self, simd: S, cos_o: Float<S>) -> Float<S> {
        let sum = |v: Vec3x<S>| v.x + v.y + v.z;
        let reflected = sum(self.schlick(simd, grazing(cos_o)));
        reflected / sum(self.diffuse).mul_add(self.passed(cos_o), reflected)
    }
}

/// The fifth power in Schlick's term.
#[inline(always)]
fn grazing<S: Simd>(cos: Float<S>) -> Float<S> {
    let off = (1.0 - cos).max(0.0).min(1.0);
    let square = off * off;
    square * square * off
}
