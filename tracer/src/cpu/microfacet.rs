//! Metals, dielectrics and their interior media, one surface point per lane: the arithmetic of
//! [`crate::scalar::microfacet`] and [`crate::scalar::medium`].
//!
//! Evaluated only for packets that hit such a surface; only scenes with such a surface store its rows.

use std::f32::consts::FRAC_1_PI;

use fearless_simd::prelude::*;

use super::fresnel::fresnel;
use super::lanes::{Float, Mask, Vec3x, Word};
use super::rays::INSIDE;
use super::rows::Rows;
use super::sampling::{BsdfSample, basis, sin_cos_turns, uniform_direction};
use crate::compiled::{
    KIND_CONDUCTOR, KIND_DIELECTRIC, KIND_LAYERED, KIND_METALLIC_ROUGHNESS, MaterialData,
};
use crate::regularisation::ALPHA_MIN;

/// One row per primitive that scatters, in the order of ids.
pub(super) type MicrofacetRow = [f32; 16];

const KIND: usize = 0;
const ALPHA: usize = 1;
const IOR: usize = 2;
pub(super) const SAMPLING_DENSITY: usize = 3;
/// Real part of a metal's refractive index; extinction coefficient of a dielectric's interior.
pub(super) const ETA_OR_EXTINCTION: usize = 4;
/// Imaginary part of a metal's refractive index; scattering coefficient of a dielectric's interior.
pub(super) const K_OR_SCATTERING: usize = 7;

/// Flag beside [`INSIDE`] in the id of a body inside which a path was scattered.
pub(super) const SCATTERED: u32 = 1 << 30;

/// An id without its flags; [`super::rays::NONE`] stays above all other ids.
#[inline(always)]
pub(super) fn untagged<S: Simd>(id: Word<S>) -> Word<S> {
    id & !(INSIDE | SCATTERED)
}

pub(super) fn microfacet_row(material: &MaterialData) -> MicrofacetRow {
    let mut row = [0.0; 16];
    // glTF's material is handled by a table of its own.
    row[KIND] = match material.kind {
        KIND_METALLIC_ROUGHNESS => KIND_LAYERED,
        kind => kind,
    } as f32;
    row[ALPHA] = material.alpha;
    row[IOR] = material.ior;
    row[SAMPLING_DENSITY] = material.sampling_density;
    let (first, second) = if material.kind == KIND_CONDUCTOR {
        (material.eta, material.k)
    } else {
        (material.extinction, material.scattering)
    };
    row[ETA_OR_EXTINCTION..][..3].copy_from_slice(&first);
    row[K_OR_SCATTERING..][..3].copy_from_slice(&second);
    row
}

/// BSDF of metals and dielectrics hit by a packet. `normal` is on the side of `wo`.
#[derive(Clone, Copy)]
pub(super) struct MicrofacetBsdf<S: Simd> {
    metal: Mask<S>,
    dielectric: Mask<S>,
    /// The path was scattered inside the body and has hit no surface.
    scattered: Mask<S>,
    /// `wo` is inside the body.
    within: Mask<S>,
    rough: Mask<S>,
    alpha: Float<S>,
    /// Relative index of refraction of a dielectric, of the far side over that of `wo`.
    eta: Float<S>,
    metal_eta: Vec3x<S>,
    metal_k: Vec3x<S>,
}

impl<S: Simd> MicrofacetBsdf<S> {
    /// `None` if all lanes hit other materials.
    #[inline(always)]
    pub(super) fn new(simd: S, table: &[MicrofacetRow], tag: Word<S>) -> Option<Self> {
        let rows = Rows::new(table, untagged(tag));
        let kind = rows.number(simd, KIND);
        let other = kind.simd_ne(KIND_LAYERED as f32);
        if !other.any_true() {
            return None;
        }
        let within = (tag & INSIDE).simd_ne(0);
        let scattered = (tag & SCATTERED).simd_ne(0);
        let alpha = rows.number(simd, ALPHA);
        let ior = rows.number(simd, IOR);
        Some(Self {
            metal: kind.simd_eq(KIND_CONDUCTOR as f32),
            dielectric: kind.simd_eq(KIND_DIELECTRIC as f32) & !scattered,
            scattered,
            within,
            rough: other & alpha.simd_gt(0.0) & !scattered,
            alpha,
            eta: within.select(1.0 / ior, ior),
            metal_eta: rows.triple(simd, ETA_OR_EXTINCTION),
            metal_k: rows.triple(simd, K_OR_SCATTERING),
        })
    }

    /// Widens the lobes of metals in lanes that are `regularised` ([`crate::regularisation`]).
    #[inline(always)]
    pub(super) fn regularise(&mut self, regularised: Mask<S>) {
        let rougher = regularised & self.metal;
        self.alpha = rougher.select(self.alpha.max(ALPHA_MIN), self.alpha);
        self.rough |= rougher;
    }

    /// Lanes of these materials, including those scattered inside bodies.
    #[inline(always)]
    pub(super) fn lanes(&self) -> Mask<S> {
        self.metal | self.dielectric | self.scattered
    }

    #[inline(always)]
    pub(super) fn is_scattered(&self) -> Mask<S> {
        self.scattered
    }

    /// Lanes whose surface transmits light.
    #[inline(always)]
    pub(super) fn is_transmissive(&self) -> Mask<S> {
        self.dielectric
    }

    /// Lanes that hit the boundary of a dielectric from inside.
    #[inline(always)]
    pub(super) fn is_left(&self) -> Mask<S> {
        self.dielectric & self.within
    }

    /// Lanes in which light arriving from outside, at `cos_i` to the normal, can be scattered to `wo`.
    #[inline(always)]
    pub(super) fn sees(&self, cos_i: Float<S>) -> Mask<S> {
        // From inside a body only light on the far side of the boundary arrives unobstructed.
        let outside = self.dielectric & self.within;
        let faces = (outside & cos_i.simd_lt(0.0)) | (!outside & cos_i.simd_gt(0.0));
        self.rough & faces
    }

    /// `f · |cos θ|` and the density of `wi` where the surface is rough; 0 elsewhere.
    #[inline(always)]
    pub(super) fn evaluate(
        &self,
        simd: S,
        normal: Vec3x<S>,
        wo: Vec3x<S>,
        wi: Vec3x<S>,
    ) -> (Vec3x<S>, Float<S>) {
        let zero = Float::splat(simd, 0.0);
        if !self.rough.any_true() {
            return (Vec3x::new(zero, zero, zero), zero);
        }
        let (cos_o, cos_i) = (normal.dot(wo), normal.dot(wi));
        let reflected = cos_i.simd_gt(0.0);
        // Walter et al. 2007, equations 13 and 16: the half vector of reflection is that of refraction with
        // η = 1.
        let h = normalize(wo + Vec3x::select(reflected, wi, wi * self.eta));
        let h = Vec3x::select(h.dot(normal).simd_lt(0.0), -h, h);
        let (o, i) = (wo.dot(h), -wi.dot(h));
        let seen = ggx(self.alpha, normal, h) * self.visibility(cos_o);
        let shadowing = self.visibility(cos_i.abs()) * cos_i.abs();

        // Jacobian 1 / (4 wo·h) of reflection, whose wo·h cancels against that of the visible normals.
        let quarter = seen * 0.25;
        let f = fresnel(simd, o, self.eta);
        let thinner = 1.0 / (self.eta * self.eta);
        let sum = o - self.eta * i;
        // Jacobian of equation 17 for rays from `wo`, with the factor η² written as division by its
        // inverse.
        let refracted = (1.0 - f) * seen * o * i / (thinner * (sum * sum));
        let passes = o.simd_gt(0.0) & i.simd_gt(0.0);
        let refracted = passes.select(refracted, zero);
        let glass_pdf = reflected.select(f * quarter, refracted);
        // Visible normals are drawn from `wo`, so that value and density differ by the shadowing of `wi`
        // only, and for refracted radiance by 1/η².
        let glass = glass_pdf * shadowing * reflected.select(Float::splat(simd, 1.0), thinner);

        let on_metal = self.metal & reflected;
        let pdf = on_metal.select(quarter, glass_pdf);
        let mut f_cos = Vec3x::new(glass, glass, glass);
        if on_metal.any_true() {
            let metal = self.reflectance(simd, o) * (quarter * shadowing);
            f_cos = Vec3x::select(on_metal, metal, f_cos);
        }
        let valid = self.rough & cos_o.simd_gt(0.0) & (reflected | self.dielectric);
        let black = Vec3x::new(zero, zero, zero);
        (Vec3x::select(valid, f_cos, black), valid.select(pdf, zero))
    }

    /// Draws a direction, by the same choices as the scalar tracer; sets the lanes whose ray continues
    /// inside in `inside`.
    #[inline(always)]
    pub(super) fn sample(
        &self,
        simd: S,
        normal: Vec3x<S>,
        wo: Vec3x<S>,
        u: [Float<S>; 3],
        inside: &mut Mask<S>,
    ) -> BsdfSample<S> {
        let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
        let mut h = normal;
        if self.rough.any_true() {
            let drawn = sample_visible(simd, self.alpha, normal, wo, u[1], u[2]);
            h = Vec3x::select(self.rough, drawn, normal);
        }
        let cos_h = wo.dot(h);
        let f = fresnel(simd, cos_h, self.eta);
        let reflected = self.metal | u[0].simd_lt(f);
        let mirrored = h.mul_add(cos_h * 2.0, -wo);
        // η² − sin² θ = η² cos² θt, factored: η² − 1 would cancel for indices near 1.
        let cos_t = ((self.eta - 1.0) * (self.eta + 1.0) + cos_h * cos_h).max(zero);
        let inverse_eta = one / self.eta;
        let bent = h * ((cos_h - cos_t.sqrt()) * inverse_eta) - wo * inverse_eta;
        let wi = Vec3x::select(reflected, mirrored, normalize(bent));

        let cos_i = normal.dot(wi);
        // A facet may send light to the wrong side of the macroscopic surface; such a direction has weight
        // 0.
        let facing = reflected.select(cos_i, -cos_i).max(zero);
        let shadowing = self.rough.select(self.visibility(facing) * facing, one);
        let thinner = reflected.select(one, inverse_eta * inverse_eta);
        let weight = shadowing * thinner;
        let mut weight = Vec3x::new(weight, weight, weight);
        if self.metal.any_true() {
            let metal = self.reflectance(simd, cos_h) * shadowing;
            weight = Vec3x::select(self.metal, metal, weight);
        }
        let density = self.evaluate(simd, normal, wo, wi).1;
        let infinite = Float::splat(simd, f32::INFINITY);
        let passed = cos_i.simd_lt(0.0);
        // Internally reflected, or refracted inwards; a path scattered inside stays inside.
        *inside = (self.dielectric & ((self.within & !passed) | (!self.within & passed)))
            | self.scattered;
        let even = uniform_direction(simd, u[1], u[2]);
        let unweighted = Vec3x::new(one, one, one);
        BsdfSample {
            wi: Vec3x::select(self.scattered, even, wi),
            weight: Vec3x::select(self.scattered, unweighted, weight),
            // ∞ for specular directions, −∞ for scattering inside a body.
            pdf: self
                .rough
                .select(density, self.scattered.select(-infinite, infinite)),
        }
    }

    /// Specular reflectance of smooth surfaces at the cosine of `wo`; 0 where the surface is rough.
    #[inline(always)]
    pub(super) fn mirror(&self, simd: S, cos: Float<S>) -> Vec3x<S> {
        let f = fresnel(simd, cos, self.eta);
        let mut reflectance = Vec3x::new(f, f, f);
        if self.metal.any_true() {
            reflectance = Vec3x::select(self.metal, self.reflectance(simd, cos), reflectance);
        }
        Vec3x::select(self.rough, Vec3x::splat(simd, [0.0; 3]), reflectance)
    }

    #[inline(always)]
    fn visibility(&self, cos: Float<S>) -> Float<S> {
        visibility(self.alpha, cos)
    }

    /// [`crate::fresnel::fresnel_conductor`] per channel.
    #[inline(always)]
    fn reflectance(&self, simd: S, cos: Float<S>) -> Vec3x<S> {
        let (eta, k) = (self.metal_eta, self.metal_k);
        let cos = cos.max(0.0).min(Float::splat(simd, 1.0));
        Vec3x::new(
            fresnel_conductor(cos, eta.x, k.x),
            fresnel_conductor(cos, eta.y, k.y),
            fresnel_conductor(cos, eta.z, k.z),
        )
    }
}

/// A function rather than a closure: a closure with three uses would not be inlined, nor the SIMD
/// operations in it.
#[inline(always)]
fn fresnel_conductor<S: Simd>(cos: Float<S>, eta: Float<S>, k: Float<S>) -> Float<S> {
    let (cos2, sin2) = (cos * cos, 1.0 - cos * cos);
    let (eta2, k2) = (eta * eta, k * k);
    let difference = eta2 - k2 - sin2;
    let sum = difference.mul_add(difference, eta2 * k2 * 4.0).sqrt();
    let a = ((sum + difference) * 0.5).max(0.0).sqrt();
    let (even, odd) = (sum + cos2, cos * a * 2.0);
    let perpendicular = (even - odd) / (even + odd);
    let (even, odd) = (cos2.mul_add(sum, sin2 * sin2), odd * sin2);
    perpendicular * 0.5 * (1.0 + (even - odd) / (even + odd))
}

/// GGX distribution of normals, sr⁻¹. Uses sin² θ rather than 1 − cos² θ, which cancels near the normal.
#[inline(always)]
pub(super) fn ggx<S: Simd>(alpha: Float<S>, normal: Vec3x<S>, h: Vec3x<S>) -> Float<S> {
    let cos = h.dot(normal);
    let sine2 = (h - normal * cos).length_squared();
    let alpha2 = alpha * alpha;
    let root = (alpha2 * cos).mul_add(cos, sine2);
    alpha2 * FRAC_1_PI / (root * root)
}

/// `G1(cos) / cos`: [`crate::scalar::ggx::visibility`].
#[inline(always)]
pub(super) fn visibility<S: Simd>(alpha: Float<S>, cos: Float<S>) -> Float<S> {
    let alpha2 = alpha * alpha;
    2.0 / (cos + ((1.0 - alpha2) * cos).mul_add(cos, alpha2).sqrt())
}

/// Draws a visible microfacet normal: [`crate::scalar::ggx::sample_visible`].
#[inline(always)]
pub(super) fn sample_visible<S: Simd>(
    simd: S,
    alpha: Float<S>,
    normal: Vec3x<S>,
    wo: Vec3x<S>,
    u1: Float<S>,
    u2: Float<S>,
) -> Vec3x<S> {
    let (t, b) = basis(simd, normal);
    let (x, y, z) = (wo.dot(t), wo.dot(b), wo.dot(normal));
    let stretched = normalize(Vec3x::new(alpha * x, alpha * y, z));
    let z = (1.0 - u1) * (1.0 + stretched.z) - stretched.z;
    let sine = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = sin_cos_turns(u2);
    let cap = Vec3x::new(sine * cos, sine * sin, z) + stretched;
    let h = normalize(Vec3x::new(alpha * cap.x, alpha * cap.y, cap.z.max(0.0)));
    t.mul_add(h.x, b.mul_add(h.y, normal * h.z))
}

#[inline(always)]
pub(super) fn normalize<S: Simd>(v: Vec3x<S>) -> Vec3x<S> {
    v * (1.0 / v.length_squared().sqrt())
}
