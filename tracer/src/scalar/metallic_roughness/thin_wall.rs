//! Transmission through thin walls: Khronos Group, `KHR_materials_transmission`, for a surface without
//! volume.
//!
//! Part of the light that is not reflected is transmitted, coloured by the base and undeviated: it leaves
//! the other side of the wall in the direction in which it entered. A rough wall scatters it like its
//! reflection, mirrored in the plane of the wall (Burley, "Extending the Disney BRDF to a BSDF with
//! Integrated Subsurface Scattering", SIGGRAPH 2015 course notes, section 3). Each microfacet transmits at
//! most what it does not reflect, so that energy is conserved. Through a smooth wall light goes straight
//! on, without a density.
//!
//! Coats and sheens lie on both sides, and attenuate transmitted light in both directions.

use glam::DVec3;

use super::{MetallicRoughness, grazing};
use crate::scalar::bsdf::BsdfSample;
use crate::scalar::ggx::{ggx, sample_visible, visibility};
use crate::scalar::microfacet::reflect;

/// Transmission parameters of a thin wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinWall {
    /// Albedo of the base times the transmission.
    pub color: DVec3,
    /// Reflectance of the dielectric part at grazing incidence.
    pub f90: f64,
    /// Whether light is transmitted without scattering.
    pub is_smooth: bool,
}

impl MetallicRoughness {
    /// Whether `wi` leaves on the other side than that of `n`, through a wall that transmits light.
    pub(super) fn is_passed(&self, wi: DVec3, n: DVec3) -> bool {
        self.wall.is_some() && wi.dot(n) < 0.0
    }

    /// [`MetallicRoughness::eval`] of transmitted light.
    pub(super) fn eval_passed(&self, wo: DVec3, wi: DVec3, n: DVec3) -> (DVec3, f64) {
        let cos_o = wo.dot(n);
        let Some(wall) = self.wall.filter(|wall| !wall.is_smooth && cos_o > 0.0) else {
            return (DVec3::ZERO, 0.0);
        };
        // Evaluated as the reflection lobe in the direction mirrored to the side of `wo`.
        let wi = mirrored(wi, n);
        let h = (wo + wi).normalize();
        let seen = 0.25 * ggx(self.alpha, h.dot(n)) * visibility(self.alpha, cos_o);
        let passed = self.wall_passed(&wall, wo, wi, h, n);
        let f = passed * (seen * visibility(self.alpha, wi.dot(n)));
        (f, self.passed_share(wo, n) * seen)
    }

    /// Draws a transmitted direction.
    pub(super) fn sample_passed(
        &self,
        wall: &ThinWall,
        wo: DVec3,
        n: DVec3,
        u: [f64; 4],
    ) -> BsdfSample {
        if wall.is_smooth {
            return BsdfSample {
                wi: -wo,
                weight: self.straight_passed(wall, wo, n) / self.passed_share(wo, n),
                pdf: None,
            };
        }
        let h = sample_visible(self.alpha, wo, n, u[1], u[2]);
        let wi = mirrored(reflect(wo, h), n);
        let (f, pdf) = self.eval(wo, wi, n);
        let weight = match pdf > 0.0 && wi.dot(n) < 0.0 {
            true => f * (-wi.dot(n) / pdf),
            false => DVec3::ZERO,
        };
        let pdf = Some(pdf);
        BsdfSample { wi, weight, pdf }
    }

    /// Transmittance straight through a smooth wall, per channel.
    pub(super) fn straight_passed(&self, wall: &ThinWall, wo: DVec3, n: DVec3) -> DVec3 {
        self.wall_passed(wall, wo, mirrored(-wo, n), n, n)
    }

    /// Probability with which [`MetallicRoughness::sample`] chooses transmission.
    pub(super) fn passed_share(&self, wo: DVec3, n: DVec3) -> f64 {
        let Some(wall) = &self.wall else {
            return 0.0;
        };
        let coat = self.coat_reflected(wo.dot(self.clearcoat_n.unwrap_or(n)));
        let [reflected, scattered] = self.weights(wo.dot(n));
        let passed = (1.0 - coat) * wall.color.element_sum() * self.facet_passed(wall, wo.dot(n));
        let others = (1.0 - coat) * (reflected + scattered) + 3.0 * coat;
        passed / (passed + others).max(f64::MIN_POSITIVE)
    }

    /// Transmittance of a facet with normal `h` and of the layers on both sides, per channel; `wi` is
    /// mirrored to the side of `wo`.
    fn wall_passed(&self, wall: &ThinWall, wo: DVec3, wi: DVec3, h: DVec3, n: DVec3) -> DVec3 {
        let coat_n = self.clearcoat_n.unwrap_or(n);
        let [coat_o, coat_i] = [wo, wi].map(|w| self.coat_reflected(w.dot(coat_n)));
        let [sheen_o, sheen_i] = [wo, wi].map(|w| self.sheen_reflected(w.dot(n)));
        let layers = (1.0 - coat_o) * (1.0 - coat_i) * (1.0 - sheen_o.max(sheen_i)).max(0.0);
        wall.color * (layers * self.facet_passed(wall, wo.dot(h)))
    }

    /// Fresnel transmittance of a facet at a cosine.
    fn facet_passed(&self, wall: &ThinWall, cos: f64) -> f64 {
        1.0 - self.dielectric_f0 - (wall.f90 - self.dielectric_f0) * grazing(cos)
    }
}

/// Reflection of a direction in the plane of the wall.
fn mirrored(w: DVec3, n: DVec3) -> DVec3 {
    w - 2.0 * w.dot(n) * n
}

#[cfg(test)]
mod tests {
    use super::super::tests::{direction, layered, random, surface};
    use super::*;
    use crate::scalar::basis::basis;
    use crate::scalar::microfacet::tests::assert_drawn;

    /// A surface whose base transmits part of the light.
    fn wall(
        base: DVec3,
        metallic: f64,
        roughness: f64,
        transmission: f64,
        coat: f64,
        sheen: f64,
    ) -> MetallicRoughness {
        let surface = surface(metallic, roughness.max(0.04), base);
        let surface = layered(surface, coat, sheen, 0.5);
        MetallicRoughness {
            diffuse: surface.diffuse * (1.0 - transmission),
            wall: Some(ThinWall {
                color: surface.diffuse * transmission,
                f90: 1.0,
                is_smooth: roughness == 0.0,
            }),
            ..surface
        }
    }

    #[test]
    fn light_that_passes_is_the_same_both_ways() {
        for i in 0..1000 {
            let [a, b, turn, metallic] = random(i);
            let base = DVec3::new(0.9, 0.5, 0.1);
            let surface = wall(base, metallic, 0.6, 0.7, f64::from(i % 3) * 0.5, 0.4);
            let wo = direction(0.02 + 0.98 * a, 0.3);
            let wi = -direction(0.02 + 0.98 * b, 7.0 * turn);
            let there = surface.eval(wo, wi, DVec3::Z).0;
            let back = surface.eval(wi, wo, -DVec3::Z).0;
            assert!(there.min_element() > 0.0);
            assert!((there - back).length() <= 1e-9 * there.length());
        }
    }

    #[test]
    fn directions_on_both_sides_are_drawn_with_their_density() {
        let n = DVec3::new(0.3, -0.8, -0.4).normalize();
        let (t, b) = basis(n);
        for (metallic, roughness, transmission) in [(0.0, 0.6, 0.5), (0.5, 0.8, 1.0)] {
            for cos_o in [0.15, 0.8f64] {
                let base = DVec3::new(0.9, 0.5, 0.1);
                let plain = wall(base, metallic, roughness, transmission, metallic, 0.3);
                let bumpy = MetallicRoughness {
                    clearcoat_n: Some((n + 0.5 * b).normalize()),
                    ..plain
                };
                for surface in [plain, bumpy] {
                    let wo = cos_o * n + (1.0 - cos_o * cos_o).sqrt() * t;
                    let density = |wi| surface.eval(wo, wi, n).1;
                    let sample = |u| surface.sample(wo, n, u);
                    assert_drawn(n, density, sample, &format!("{surface:?} {cos_o}"));
                }
            }
        }
    }

    /// White furnace: a smooth white wall reflects or transmits all light, and no wall creates any.
    #[test]
    fn white_walls_make_no_light() {
        for (coat, sheen) in [(0.0, 0.0), (1.0, 0.0), (0.5, 1.0)] {
            for roughness in [0.0, 0.3, 1.0] {
                for transmission in [0.0, 0.5, 1.0] {
                    for cos_o in [0.05, 0.3, 1.0] {
                        let surface = wall(DVec3::ONE, 0.0, roughness, transmission, coat, sheen);
                        let wo = direction(cos_o, 0.3);
                        let draws = 20_000;
                        let weights = (0..draws)
                            .map(|i| surface.sample(wo, DVec3::Z, random(i)).weight.x)
                            .sum::<f64>();
                        let albedo = weights / f64::from(draws);
                        let what =
                            format!("{coat} {sheen} {roughness} {transmission} {cos_o}: {albedo}");
                        assert!(albedo < 1.01, "{what}");
                        let is_plain = roughness == 0.0 && coat + sheen == 0.0;
                        let least = if is_plain { 0.97 } else { 0.05 };
                        assert!(albedo > least, "{what}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_smooth_wall_is_the_limit_of_rough_ones() {
        let base = DVec3::new(0.9, 0.5, 0.1);
        let [smooth, rough] = [0.0, 1e-3].map(|roughness| {
            let mut surface = wall(base, 0.0, roughness, 0.8, 0.3, 0.2);
            surface.alpha = 1e-5;
            surface
        });
        for i in 0..500 {
            let wo = direction(0.7, 2.0);
            let [smooth, rough] = [smooth, rough].map(|s| s.sample(wo, DVec3::Z, random(i)));
            if smooth.wi.z > 0.0 {
                continue;
            }
            assert!((smooth.wi - rough.wi).length() < 5e-3);
            assert!((smooth.weight - rough.weight).length() < 5e-3);
            assert_eq!(smooth.pdf, None);
        }
    }
}
