//! Metals, clear bodies and what fills them, a lane each: the arithmetic of
//! [`crate::scalar::specular`] and [`crate::scalar::medium`].
//!
//! Only packets that met such a surface come here, and only scenes that have one pack its rows.

use std::f32::consts::FRAC_1_PI;

use fearless_simd::{i32x16, prelude::*};

use super::bsdf::{Scattered, fresnel};
use super::geometry::INSIDE;
use super::lanes::{Float, Mask, Vec3x, Word};
use super::sampling::{basis, sin_cos_turns};
use super::surface::Rows;
use crate::compiled::{KIND_CONDUCTOR, KIND_DIELECTRIC, KIND_LAYERED, MaterialData};

/// One row of numbers per primitive that scatters, in the order of ids.
pub(super) type GlossRow = [f32; 16];

const KIND: usize = 0;
const ALPHA: usize = 1;
const IOR: usize = 2;
const FLIGHT_RATE: usize = 3;
/// Real part of a metal's index; extinction of a clear body.
const FIRST: usize = 4;
/// Imaginary part of a metal's index; scattering of a clear body.
const SECOND: usize = 7;

/// Set beside [`INSIDE`] in the id of a body within which a path was scattered.
pub(super) const SCATTERED: u32 = 1 << 30;

/// An id without its tags; [`super::geometry::NONE`] stays above all others.
#[inline(always)]
pub(super) fn untagged<S: Simd>(id: Word<S>) -> Word<S> {
    id & !(INSIDE | SCATTERED)
}

pub(super) fn gloss_row(material: &MaterialData) -> GlossRow {
    let mut row = [0.0; 16];
    row[KIND] = material.kind as f32;
    row[ALPHA] = material.alpha;
    row[IOR] = material.ior;
    row[FLIGHT_RATE] = material.flight_rate;
    let (first, second) = if material.kind == KIND_CONDUCTOR {
        (material.eta, material.k)
    } else {
        (material.extinction, material.scattering)
    };
    row[FIRST..][..3].copy_from_slice(&first);
    row[SECOND..][..3].copy_from_slice(&second);
    row
}

/// The metals and clear bodies of a packet's hits. `normal` is on the side of `wo`.
#[derive(Clone, Copy)]
pub(super) struct Gloss<S: Simd> {
    metal: Mask<S>,
    clear: Mask<S>,
    /// The path was scattered inside the body and met no surface.
    scattered: Mask<S>,
    /// `wo` is inside the body.
    within: Mask<S>,
    rough: Mask<S>,
    alpha: Float<S>,
    /// Relative index of a clear body.
    eta: Float<S>,
    metal_eta: Vec3x<S>,
    metal_k: Vec3x<S>,
}

impl<S: Simd> Gloss<S> {
    /// None if all lanes met other surfaces.
    #[inline(always)]
    pub(super) fn new(simd: S, table: &[GlossRow], tag: Word<S>) -> Option<Self> {
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
            clear: kind.simd_eq(KIND_DIELECTRIC as f32) & !scattered,
            scattered,
            within,
            rough: other & alpha.simd_gt(0.0) & !scattered,
            alpha,
            eta: within.select(1.0 / ior, ior),
            metal_eta: rows.triple(simd, FIRST),
            metal_k: rows.triple(simd, SECOND),
        })
    }

    /// The lanes of this material.
    #[inline(always)]
    pub(super) fn lanes(&self) -> Mask<S> {
        self.metal | self.clear | self.scattered
    }

    #[inline(always)]
    pub(super) fn is_scattered(&self) -> Mask<S> {
        self.scattered
    }

    /// Where the boundary of a clear body is met from inside.
    #[inline(always)]
    pub(super) fn is_left(&self) -> Mask<S> {
        self.clear & self.within
    }

    /// Where light from `wi`, at `cos_i`, that comes straight from an area light may be scattered to `wo`.
    #[inline(always)]
    pub(super) fn sees(&self, cos_i: Float<S>) -> Mask<S> {
        let outside = self.clear & self.within;
        let faces = (outside & cos_i.simd_lt(0.0)) | (!outside & cos_i.simd_gt(0.0));
        self.rough & faces
    }

    /// `f · |cos θ|` and the density of `wi`, where the surface is rough; else 0.
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
        let h = normalize(wo + Vec3x::select(reflected, wi, wi * self.eta));
        let h = Vec3x::select(h.dot(normal).simd_lt(0.0), -h, h);
        let (o, i) = (wo.dot(h), -wi.dot(h));
        let seen = self.ggx(normal, h) * self.visibility(cos_o);
        let shadowing = self.visibility(cos_i.abs()) * cos_i.abs();

        let quarter = seen * 0.25;
        let f = fresnel(simd, o, self.eta);
        let thinner = 1.0 / (self.eta * self.eta);
        let sum = o - self.eta * i;
        let refracted = (1.0 - f) * seen * o * i / (thinner * (sum * sum));
        let passes = o.simd_gt(0.0) & i.simd_gt(0.0);
        let refracted = passes.select(refracted, zero);
        let glass_pdf = reflected.select(f * quarter, refracted);
        let glass = glass_pdf * shadowing * reflected.select(Float::splat(simd, 1.0), thinner);

        let on_metal = self.metal & reflected;
        let pdf = on_metal.select(quarter, glass_pdf);
        let mut f_cos = Vec3x::new(glass, glass, glass);
        if on_metal.any_true() {
            let metal = self.reflectance(simd, o) * (quarter * shadowing);
            f_cos = Vec3x::select(on_metal, metal, f_cos);
        }
        let valid = self.rough & cos_o.simd_gt(0.0) & (reflected | self.clear);
        let black = Vec3x::new(zero, zero, zero);
        (Vec3x::select(valid, f_cos, black), valid.select(pdf, zero))
    }

    /// Draws a direction as the scalar tracer does; the lanes whose ray goes on inside are set in
    /// `inside`.
    #[inline(always)]
    pub(super) fn sample(
        &self,
        simd: S,
        normal: Vec3x<S>,
        wo: Vec3x<S>,
        u: [Float<S>; 3],
        inside: &mut Mask<S>,
    ) -> Scattered<S> {
        let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
        let mut h = normal;
        if self.rough.any_true() {
            let drawn = self.sample_visible(simd, normal, wo, u[1], u[2]);
            h = Vec3x::select(self.rough, drawn, normal);
        }
        let cos_h = wo.dot(h);
        let f = fresnel(simd, cos_h, self.eta);
        let reflected = self.metal | u[0].simd_lt(f);
        let mirrored = h.mul_add(cos_h * 2.0, -wo);
        let cos_t = ((self.eta - 1.0) * (self.eta + 1.0) + cos_h * cos_h).max(zero);
        let inverse_eta = one / self.eta;
        let bent = h * ((cos_h - cos_t.sqrt()) * inverse_eta) - wo * inverse_eta;
        let wi = Vec3x::select(reflected, mirrored, normalize(bent));

        let cos_i = normal.dot(wi);
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
        *inside =
            (self.clear & ((self.within & !passed) | (!self.within & passed))) | self.scattered;
        let even = uniform_direction(simd, u[1], u[2]);
        let unweighted = Vec3x::new(one, one, one);
        Scattered {
            wi: Vec3x::select(self.scattered, even, wi),
            weight: Vec3x::select(self.scattered, unweighted, weight),
            pdf: self
                .rough
                .select(density, self.scattered.select(-infinite, infinite)),
        }
    }

    /// Reflectance of what is smooth, at a cosine of `wo`; 0 where it is rough.
    #[inline(always)]
    pub(super) fn mirror(&self, simd: S, cos: Float<S>) -> Vec3x<S> {
        let f = fresnel(simd, cos, self.eta);
        let mut reflectance = Vec3x::new(f, f, f);
        if self.metal.any_true() {
            reflectance = Vec3x::select(self.metal, self.reflectance(simd, cos), reflectance);
        }
        Vec3x::select(self.rough, Vec3x::splat(simd, [0.0; 3]), reflectance)
    }

    /// The sine is measured rather than the cosine, of which nothing is left near 1.
    #[inline(always)]
    fn ggx(&self, normal: Vec3x<S>, h: Vec3x<S>) -> Float<S> {
        let cos = h.dot(normal);
        let sine2 = (h - normal * cos).length_squared();
        let alpha2 = self.alpha * self.alpha;
        let root = (alpha2 * cos).mul_add(cos, sine2);
        alpha2 * FRAC_1_PI / (root * root)
    }

    #[inline(always)]
    fn visibility(&self, cos: Float<S>) -> Float<S> {
        let alpha2 = self.alpha * self.alpha;
        2.0 / (cos + ((1.0 - alpha2) * cos).mul_add(cos, alpha2).sqrt())
    }

    #[inline(always)]
    fn sample_visible(
        &self,
        simd: S,
        normal: Vec3x<S>,
        wo: Vec3x<S>,
        u1: Float<S>,
        u2: Float<S>,
    ) -> Vec3x<S> {
        let (t, b) = basis(simd, normal);
        let (x, y, z) = (wo.dot(t), wo.dot(b), wo.dot(normal));
        let stretched = normalize(Vec3x::new(self.alpha * x, self.alpha * y, z));
        let z = (1.0 - u1) * (1.0 + stretched.z) - stretched.z;
        let sine = (1.0 - z * z).max(0.0).sqrt();
        let (sin, cos) = sin_cos_turns(u2);
        let cap = Vec3x::new(sine * cos, sine * sin, z) + stretched;
        let h = Vec3x::new(self.alpha * cap.x, self.alpha * cap.y, cap.z.max(0.0));
        let h = normalize(h);
        t.mul_add(h.x, b.mul_add(h.y, normal * h.z))
    }

    /// [`crate::fresnel::fresnel_conductor`] by channel.
    #[inline(always)]
    fn reflectance(&self, simd: S, cos: Float<S>) -> Vec3x<S> {
        let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
        let cos = cos.max(zero).min(one);
        let (cos2, sin2) = (cos * cos, one - cos * cos);
        let channel = |eta: Float<S>, k: Float<S>| {
            let (eta2, k2) = (eta * eta, k * k);
            let difference = eta2 - k2 - sin2;
            let sum = difference.mul_add(difference, eta2 * k2 * 4.0).sqrt();
            let a = ((sum + difference) * 0.5).max(zero).sqrt();
            let (even, odd) = (sum + cos2, cos * a * 2.0);
            let perpendicular = (even - odd) / (even + odd);
            let (even, odd) = (cos2.mul_add(sum, sin2 * sin2), odd * sin2);
            perpendicular * 0.5 * (1.0 + (even - odd) / (even + odd))
        };
        Vec3x::new(
            channel(self.metal_eta.x, self.metal_k.x),
            channel(self.metal_eta.y, self.metal_k.y),
            channel(self.metal_eta.z, self.metal_k.z),
        )
    }
}

/// A free flight through what fills a clear body: how far, and the weight of what is left.
pub(super) struct Flight<S: Simd> {
    /// Scattered before the boundary.
    pub(super) scattered: Mask<S>,
    pub(super) distance: Float<S>,
    pub(super) weight: Vec3x<S>,
}

impl<S: Simd> Flight<S> {
    /// Towards a boundary at `distance`, for the lanes of `within`; the others keep their light.
    #[inline(always)]
    pub(super) fn new(
        simd: S,
        table: &[GlossRow],
        id: Word<S>,
        within: Mask<S>,
        distance: Float<S>,
        u: Float<S>,
    ) -> Self {
        let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
        let rows = Rows::new(table, id);
        let rate = rows.number(simd, FLIGHT_RATE);
        let flown = -ln(simd, one - u) / rate;
        let scattered = within & rate.simd_gt(0.0) & flown.simd_lt(distance);
        let distance = scattered.select(flown, distance);
        let beyond = rows.triple(simd, FIRST) - Vec3x::new(rate, rate, rate);
        let left = beyond * -distance;
        let left = Vec3x::new(exp(simd, left.x), exp(simd, left.y), exp(simd, left.z));
        let unscattered = Vec3x::new(one, one, one);
        let weight = Vec3x::select(scattered, rows.triple(simd, SECOND), unscattered);
        let weight = weight.scale(left);
        Self {
            scattered,
            distance: distance.max(zero),
            weight: Vec3x::select(within, weight, unscattered),
        }
    }
}

#[inline(always)]
fn normalize<S: Simd>(v: Vec3x<S>) -> Vec3x<S> {
    v * (1.0 / v.length_squared().sqrt())
}

#[inline(always)]
fn uniform_direction<S: Simd>(simd: S, u1: Float<S>, u2: Float<S>) -> Vec3x<S> {
    let z = Float::splat(simd, 1.0) - u1 * 2.0;
    let sine = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = sin_cos_turns(u2);
    Vec3x::new(sine * cos, sine * sin, z)
}

/// Natural logarithm of a normal number, within 2 ulp (Cephes' `logf`, Moshier 1992).
#[inline(always)]
pub(super) fn ln<S: Simd>(simd: S, x: Float<S>) -> Float<S> {
    let bits: Word<S> = x.bitcast();
    let exponent: i32x16<S> = (bits >> 23).bitcast();
    let exponent = exponent.to_float::<Float<S>>() - 126.0;
    let mantissa: Float<S> = ((bits & 0x007f_ffff) | 0x3f00_0000).bitcast();
    let low = mantissa.simd_lt(std::f32::consts::FRAC_1_SQRT_2);
    let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
    let exponent = exponent - low.select(one, zero);
    let m = mantissa + low.select(mantissa, zero) - one;
    let z = m * m;
    let y = m
        .mul_add(0.070_376_84, -0.115_146_1)
        .mul_add(m, 0.116_769_99)
        .mul_add(m, -0.124_201_41)
        .mul_add(m, 0.142_493_23)
        .mul_add(m, -0.166_680_58)
        .mul_add(m, 0.200_007_15)
        .mul_add(m, -0.249_999_94)
        .mul_add(m, 0.333_333_3);
    let y = y * m * z + exponent * -2.121_944_4e-4 - z * 0.5;
    m + y + exponent * 0.693_359_4
}

/// e^x for x ≤ 0, within 2 ulp (Cephes' `expf`); 0 where the result would be subnormal.
#[inline(always)]
pub(super) fn exp<S: Simd>(simd: S, x: Float<S>) -> Float<S> {
    let zero = Float::splat(simd, 0.0);
    let tiny = x.simd_lt(-87.0);
    let x = x.max(-87.0).min(zero);
    let n = (x * std::f32::consts::LOG2_E + 0.5).floor();
    let r = x - n * 0.693_359_4 - n * -2.121_944_4e-4;
    let y = r
        .mul_add(1.987_569_1e-4, 1.398_2e-3)
        .mul_add(r, 8.333_452e-3)
        .mul_add(r, 4.166_579_6e-2)
        .mul_add(r, 0.166_666_65)
        .mul_add(r, 0.5);
    let y = (y * r).mul_add(r, r + 1.0);
    let n: i32x16<S> = n.to_int();
    let n: Word<S> = n.bitcast();
    let power: Float<S> = ((n + 127) << 23).bitcast();
    tiny.select(zero, y * power)
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};

    use super::super::lanes::LANES;
    use super::*;

    #[inline(always)]
    fn both<S: Simd>(simd: S, x: [f32; LANES]) -> [[f32; LANES]; 2] {
        let x = Float::load_array(simd, x);
        [ln(simd, x).to_array(), exp(simd, x * -20.0).to_array()]
    }

    #[test]
    fn logarithm_and_exponential_are_within_their_bounds() {
        for start in (0..1 << 20).step_by(LANES) {
            let x: [f32; LANES] =
                std::array::from_fn(|lane| (start + lane + 1) as f32 / (1 << 20) as f32);
            let [ln, exp] = dispatch!(Level::new(), simd => both(simd, x));
            for lane in 0..LANES {
                let exact = f64::from(x[lane]).ln();
                let error = (f64::from(ln[lane]) - exact).abs();
                assert!(error <= 3e-7 * exact.abs().max(1e-6), "ln {}", x[lane]);
                let exact = (-20.0 * f64::from(x[lane])).exp();
                let error = (f64::from(exp[lane]) - exact).abs();
                // The argument's own rounding, an ulp of up to 20, is in it.
                assert!(error <= 3e-6 * exact, "exp {}", x[lane]);
            }
        }
    }
}
