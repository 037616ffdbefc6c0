//! Sheen of napped cloth, one surface point per lane: the arithmetic of [`crate::sheen`].

use fearless_simd::prelude::*;

use super::lanes::{Float, Vec3x, Word};
use super::math::{exp, ln};
use super::rows::Rows;
use crate::sheen::{SHEEN_REFLECTANCES, SHEEN_ROOT_MIN};

/// Strength over 2π (three channels) and width of a primitive that scatters.
pub(super) type SheenRow = [f32; 4];

/// Sheen of the cloth hit by a packet; other lanes have strength 0.
#[derive(Clone, Copy)]
pub(super) struct Sheen<S: Simd> {
    strength: Vec3x<S>,
    exponent: Float<S>,
}

impl<S: Simd> Sheen<S> {
    /// `None` if no lane hit cloth.
    #[inline(always)]
    pub(super) fn new(simd: S, table: &[SheenRow], id: Word<S>) -> Option<Self> {
        let rows = Rows::new(table, id);
        let strength = rows.triple(simd, 0);
        let sum = strength.x + strength.y + strength.z;
        let cloth = sum.simd_gt(0.0);
        if !cloth.any_true() {
            return None;
        }
        let one = Float::splat(simd, 1.0);
        let exponent = cloth.select(1.0 / rows.number(simd, 3), one);
        Some(Self { strength, exponent })
    }

    /// Sheen of a strength over 2π and a width above 0.
    #[inline(always)]
    pub(super) fn of(strength: Vec3x<S>, width: Float<S>) -> Self {
        let exponent = 1.0 / width;
        Self { strength, exponent }
    }

    /// BSDF `f`, sr⁻¹; 0 unless both directions are above the surface.
    #[inline(always)]
    pub(super) fn evaluate(
        &self,
        simd: S,
        normal: Vec3x<S>,
        wo: Vec3x<S>,
        wi: Vec3x<S>,
    ) -> Vec3x<S> {
        let (zero, one) = (Float::splat(simd, 0.0), Float::splat(simd, 1.0));
        let (cos_o, cos_i) = (normal.dot(wo), normal.dot(wi));
        let h = wo + wi;
        let along = h.dot(normal);
        let sine2 = (one - along * along / h.length_squared())
            .max(1e-12)
            .min(one);
        // (sin θh)ᵉ = exp(½ e ln sin² θh), which saves the square root.
        let power = exp(simd, ln(simd, sine2) * self.exponent * 0.5);
        let shadowing = 4.0 * (cos_o + cos_i - cos_o * cos_i);
        let f = (self.exponent + 2.0) * power / shadowing;
        let above = cos_o.simd_gt(0.0) & cos_i.simd_gt(0.0);
        self.strength * above.select(f, zero)
    }
}

/// [`crate::sheen::sheen_reflectances`] times a strength.
#[inline(always)]
pub(super) fn sheen_reflectances<S: Simd>(
    simd: S,
    width: Float<S>,
    strength: Float<S>,
) -> [Float<S>; 6] {
    let last = (SHEEN_REFLECTANCES.len() - 1) as f32;
    // Linear interpolation between rows that are equidistant in √width.
    let place = (width.sqrt() - SHEEN_ROOT_MIN) * (last / (1.0 - SHEEN_ROOT_MIN));
    let place = place.max(0.0).min(last);
    let mut nodes = [Float::splat(simd, 0.0); 6];
    for (row, reflectances) in (0u8..).zip(SHEEN_REFLECTANCES) {
        let hat = (1.0 - (place - f32::from(row)).abs()).max(0.0) * strength;
        for (node, reflectance) in nodes.iter_mut().zip(reflectances) {
            *node += hat * reflectance;
        }
    }
    nodes
}
