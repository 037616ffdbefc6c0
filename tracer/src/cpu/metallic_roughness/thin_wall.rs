//! Transmission through thin walls, one surface point per lane: the arithmetic of
//! [`crate::scalar::metallic_roughness::thin_wall`].

use fearless_simd::prelude::*;

use super::{MetallicRoughness, grazing};
use crate::cpu::lanes::{Float, Mask, Vec3x};
use crate::cpu::microfacet::{ggx, normalize, visibility};
use crate::scalar::metallic_roughness::ALPHA_LEAST;

/// Transmission parameters of thin walls; black in other lanes.
#[derive(Clone, Copy)]
pub(super) struct WallLanes<S: Simd> {
    pub(super) lanes: Mask<S>,
    rough: Mask<S>,
    pub(super) color: Vec3x<S>,
    f90: Float<S>,
}

/// A direction of transmitted light, mirrored to the side of `wo`.
struct Passage<S: Simd> {
    wo: Vec3x<S>,
    wi: Vec3x<S>,
    /// Normal of the microfacet.
    h: Vec3x<S>,
}

impl<S: Simd> WallLanes<S> {
    /// `alpha` is at least [`ALPHA_LEAST`].
    #[inline(always)]
    pub(super) fn new(color: Vec3x<S>, f90: Float<S>, alpha: Float<S>) -> Self {
        Self {
            lanes: color.x.max(color.y).max(color.z).simd_gt(0.0),
            rough: alpha.simd_gt(ALPHA_LEAST),
            color,
            f90,
        }
    }
}

impl<S: Simd> MetallicRoughness<S> {
    /// Lanes of thin walls that transmit light; `None` if the scene has no thin walls.
    #[inline(always)]
    pub(in crate::cpu) fn lets_pass(&self) -> Option<Mask<S>> {
        let wall = self.wall.as_ref()?;
        Some(self.lanes & wall.lanes)
    }

    /// Lanes of rough thin walls, whose transmitted directions light sampling can draw.
    #[inline(always)]
    pub(in crate::cpu) fn spreads_behind(&self) -> Option<Mask<S>> {
        let wall = self.wall.as_ref()?;
        Some(self.lanes & wall.lanes & wall.rough)
    }

    /// Lanes of smooth thin walls, and the transmittance straight through them; `None` if there are none.
    #[inline(always)]
    pub(in crate::cpu) fn straight_passed(
        &self,
        normal: Vec3x<S>,
        wo: Vec3x<S>,
    ) -> Option<(Mask<S>, Vec3x<S>)> {
        let wall = self.wall.as_ref()?;
        let smooth = self.lanes & wall.lanes & !wall.rough;
        if !smooth.any_true() {
            return None;
        }
        Some((
            smooth,
            self.wall_passed(wall, normal, &straight(normal, wo)),
        ))
    }

    /// Adds transmission to `f · |cos θ|` and density of the other lobes.
    #[inline(always)]
    pub(super) fn with_wall(
        &self,
        simd: S,
        wall: &WallLanes<S>,
        normal: Vec3x<S>,
        wo: Vec3x<S>,
        wi: Vec3x<S>,
        (f_cos, pdf): (Vec3x<S>, Float<S>),
    ) -> (Vec3x<S>, Float<S>) {
        let zero = Float::splat(simd, 0.0);
        let (cos_o, cos_i) = (normal.dot(wo), -normal.dot(wi));
        // Transmission through a rough wall is its reflection lobe, mirrored in the plane of the wall.
        let share = self.passed_share(simd, wall, normal, wo);
        let wi = mirrored(normal, wi);
        let h = normalize(wo + wi);
        let seen = ggx(self.alpha, normal, h) * visibility(self.alpha, cos_o) * 0.25;
        let passage = Passage { wo, wi, h };
        let shadowing = visibility(self.alpha, cos_i) * cos_i;
        let passed = self.wall_passed(wall, normal, &passage) * (seen * shadowing);
        let behind = wall.lanes & cos_i.simd_gt(0.0);
        let valid = wall.rough & cos_o.simd_gt(0.0);
        let black = Vec3x::new(zero, zero, zero);
        (
            Vec3x::select(behind, Vec3x::select(valid, passed, black), f_cos),
            behind.select(valid.select(share * seen, zero), (1.0 - share) * pdf),
        )
    }

    /// Direction of light that a facet with normal `h` transmits.
    #[inline(always)]
    pub(super) fn passed_direction(
        wall: &WallLanes<S>,
        normal: Vec3x<S>,
        wo: Vec3x<S>,
        h: Vec3x<S>,
    ) -> Vec3x<S> {
        let reflected = h.mul_add(wo.dot(h) * 2.0, -wo);
        Vec3x::select(wall.rough, mirrored(normal, reflected), -wo)
    }

    /// The lanes in `passes` that transmit without a density (smooth walls), and the throughput factor
    /// there.
    #[inline(always)]
    pub(super) fn straight_weight(
        &self,
        wall: &WallLanes<S>,
        normal: Vec3x<S>,
        wo: Vec3x<S>,
        passes: Mask<S>,
        share: Float<S>,
    ) -> (Mask<S>, Vec3x<S>) {
        let passed = self.wall_passed(wall, normal, &straight(normal, wo));
        let share = share.max(f32::MIN_POSITIVE);
        (passes & !wall.rough, passed * (1.0 / share))
    }

    /// Probability of drawing a direction from the transmission lobe.
    #[inline(always)]
    pub(super) fn passed_share(
        &self,
        simd: S,
        wall: &WallLanes<S>,
        normal: Vec3x<S>,
        wo: Vec3x<S>,
    ) -> Float<S> {
        let cos_o = normal.dot(wo);
        let (mut coat, mut sheen) = (Float::splat(simd, 0.0), Float::splat(simd, 0.0));
        if let Some(layers) = &self.layers {
            coat = layers.reflected(layers.normal(normal).dot(wo));
            sheen = layers.sheen_reflected(cos_o).min(1.0) * 3.0;
        }
        let reflected = sum(self.schlick(grazing(cos_o)));
        let above = sum(self.diffuse).mul_add(self.passed(cos_o), reflected) + sheen;
        let uncoated = 1.0 - coat;
        let passed = uncoated * sum(wall.color) * self.facet_passed(wall, cos_o);
        let all = uncoated.mul_add(above, passed) + coat * 3.0;
        passed / all.max(f32::MIN_POSITIVE)
    }

    /// Transmittance of a facet and of the layers on both sides.
    #[inline(always)]
    fn wall_passed(&self, wall: &WallLanes<S>, normal: Vec3x<S>, passage: &Passage<S>) -> Vec3x<S> {
        let Passage { wo, wi, h } = *passage;
        let mut passed = self.facet_passed(wall, wo.dot(h));
        if let Some(layers) = &self.layers {
            let coat_normal = layers.normal(normal);
            let (coat_o, coat_i) = (coat_normal.dot(wo), coat_normal.dot(wi));
            passed *= (1.0 - layers.reflected(coat_o)) * (1.0 - layers.reflected(coat_i));
            let (sheen_o, sheen_i) = (normal.dot(wo), normal.dot(wi));
            let sheen = (layers.sheen_reflected(sheen_o)).max(layers.sheen_reflected(sheen_i));
            passed *= (1.0 - sheen).max(0.0);
        }
        wall.color * passed
    }

    /// Fresnel transmittance of a facet at a cosine.
    #[inline(always)]
    fn facet_passed(&self, wall: &WallLanes<S>, cos: Float<S>) -> Float<S> {
        1.0 - self.dielectric_f0 - (wall.f90 - self.dielectric_f0) * grazing(cos)
    }
}

/// Reflection of a direction in the plane of the wall.
#[inline(always)]
fn mirrored<S: Simd>(normal: Vec3x<S>, w: Vec3x<S>) -> Vec3x<S> {
    normal.mul_add(normal.dot(w) * -2.0, w)
}

/// Passage straight through a smooth wall.
#[inline(always)]
fn straight<S: Simd>(normal: Vec3x<S>, wo: Vec3x<S>) -> Passage<S> {
    Passage {
        wo,
        wi: mirrored(normal, -wo),
        h: normal,
    }
}

#[inline(always)]
fn sum<S: Simd>(v: Vec3x<S>) -> Float<S> {
    v.x + v.y + v.z
}
