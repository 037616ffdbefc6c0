//! The material of glTF 2.0: a diffuse base or a metal under a rough reflection.
//!
//! The reflection is that of GGX microfacets ([`super::microfacet`]) with Schlick's Fresnel term ("An Inexpensive BRDF Model
//! for Physically-based Rendering", CGF 13(3), 1994). What it leaves of light is diffuse as under the coat of
//! [`crate::Material::SmoothPlastic`], in both directions, so that light both ways is the same and none is gained;
//! `1 − F_avg`, the mean of what passes into the base, is divided by: a smooth white surface reflects all. Rough surfaces
//! reflect less at grazing angles than smooth ones, so that Schlick's term of what passes rises to `(1 − α)²` alone: about the
//! least with which white surfaces make no light.

use std::f64::consts::PI;

use glam::DVec3;

use super::bsdf::{BsdfSample, basis};
use super::intersect::vector;
use super::microfacet::{ggx, reflect, sample_visible, visibility};
use crate::compiled::MaterialData;

/// One point of such a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MetallicRoughness {
    /// Albedo of the base.
    pub diffuse: DVec3,
    /// Reflectance towards the normal.
    pub f0: DVec3,
    /// The same of what is no metal.
    pub dielectric_f0: f64,
    /// What is taken to be reflected at grazing angles of what goes to the base and comes from it.
    pub base_f90: f64,
    /// GGX width, above 0.
    pub alpha: f64,
    /// Radiance emitted to both sides.
    pub emission: DVec3,
}

/// What textures multiply a material's numbers by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureFactors {
    /// Of the base colour.
    pub base_color: DVec3,
    /// Of the roughness, the square root of α.
    pub roughness: f64,
    /// Of the share of metal.
    pub metallic: f64,
    /// Of the emission.
    pub emission: DVec3,
}

impl TextureFactors {
    /// No textures.
    pub const ONE: Self = Self {
        base_color: DVec3::ONE,
        roughness: 1.0,
        metallic: 1.0,
        emission: DVec3::ONE,
    };
}

/// The smallest GGX width, which smoother surfaces have too.
pub const ALPHA_LEAST: f32 = crate::scene::validate::ALPHA_SMOOTH_MAX;

impl MetallicRoughness {
    /// A material, multiplied.
    pub fn new(material: &MaterialData, factors: &TextureFactors) -> Self {
        let base = vector(material.albedo) * factors.base_color;
        let metallic = f64::from(material.metallic) * factors.metallic;
        let dielectric_f0 = f64::from(material.eta[0]);
        let alpha = f64::from(material.alpha) * factors.roughness * factors.roughness;
        Self {
            diffuse: base * (1.0 - metallic),
            f0: DVec3::splat(dielectric_f0).lerp(base, metallic),
            dielectric_f0,
            base_f90: (1.0 - alpha).powi(2).max(dielectric_f0),
            alpha: alpha.max(f64::from(ALPHA_LEAST)),
            emission: vector(material.k) * factors.emission,
        }
    }

    /// `f` in sr⁻¹, and the density per solid angle with which [`MetallicRoughness::sample`] draws `wi`.
    pub fn eval(&self, wo: DVec3, wi: DVec3, n: DVec3) -> (DVec3, f64) {
        let (cos_o, cos_i) = (wo.dot(n), wi.dot(n));
        if cos_o <= 0.0 || cos_i <= 0.0 {
            return (DVec3::ZERO, 0.0);
        }
        let h = (wo + wi).normalize();
        let seen = 0.25 * ggx(self.alpha, h.dot(n)) * visibility(self.alpha, cos_o);
        let reflected = schlick(self.f0, wo.dot(h)) * (seen * visibility(self.alpha, cos_i));
        let passed = self.passed(cos_o) * self.passed(cos_i);
        let scattered = self.diffuse * (passed * self.diffuse_scale() / PI);
        let share = self.reflected_share(cos_o);
        let pdf = share * seen + (1.0 - share) * cos_i / PI;
        (reflected + scattered, pdf)
    }

    /// Draws a direction: `u[0]` chooses between reflection and base, `u[1]` and `u[2]` the direction.
    pub fn sample(&self, wo: DVec3, n: DVec3, u: [f64; 4]) -> BsdfSample {
        let wi = if u[0] < self.reflected_share(wo.dot(n)) {
            reflect(wo, sample_visible(self.alpha, wo, n, u[1], u[2]))
        } else {
            let (radius, phi) = (u[1].sqrt(), 2.0 * PI * u[2]);
            let (t, b) = basis(n);
            let cos_i = (1.0 - u[1]).max(0.0).sqrt();
            radius * phi.cos() * t + radius * phi.sin() * b + cos_i * n
        };
        let (f, pdf) = self.eval(wo, wi, n);
        let weight = match pdf > 0.0 {
            true => f * (wi.dot(n) / pdf),
            false => DVec3::ZERO,
        };
        let pdf = Some(pdf);
        BsdfSample { wi, weight, pdf }
    }

    /// About what it reflects of even light.
    pub fn albedo(&self) -> DVec3 {
        (self.diffuse + self.f0).min(DVec3::ONE)
    }

    /// The share of light that passes into the base or out of it.
    fn passed(&self, cos: f64) -> f64 {
        1.0 - self.dielectric_f0 - (self.base_f90 - self.dielectric_f0) * grazing(cos)
    }

    /// The reciprocal of the mean of that over even light: [`grazing`] has the mean 1/21 over the cosine.
    fn diffuse_scale(&self) -> f64 {
        1.0 / (1.0 - self.dielectric_f0 - (self.base_f90 - self.dielectric_f0) / 21.0)
    }

    /// The probability with which [`MetallicRoughness::sample`] chooses the reflection.
    fn reflected_share(&self, cos_o: f64) -> f64 {
        let reflected = schlick(self.f0, cos_o).element_sum();
        reflected / (reflected + self.passed(cos_o) * self.diffuse.element_sum())
    }
}

/// Schlick's approximation of Fresnel's term.
fn schlick(f0: DVec3, cos: f64) -> DVec3 {
    f0 + (1.0 - f0) * grazing(cos)
}

fn grazing(cos: f64) -> f64 {
    (1.0 - cos).clamp(0.0, 1.0).powi(5)
}

#[cfg(test)]
mod tests {
    use super::super::microfacet::tests::assert_drawn;
    use super::*;
    use crate::sampling::uniforms;

    fn surface(metallic: f64, roughness: f64, base: DVec3) -> MetallicRoughness {
        MetallicRoughness {
            diffuse: base * (1.0 - metallic),
            f0: DVec3::splat(0.04).lerp(base, metallic),
            dielectric_f0: 0.04,
            base_f90: (1.0 - roughness * roughness).powi(2).max(0.04),
            alpha: roughness * roughness,
            emission: DVec3::ZERO,
        }
    }

    fn direction(cos: f64, turn: f64) -> DVec3 {
        let sine = (1.0 - cos * cos).sqrt();
        DVec3::new(sine * turn.cos(), sine * turn.sin(), cos)
    }

    fn random(i: u32) -> [f64; 4] {
        uniforms(i, 3, 5, 7).map(f64::from)
    }

    #[test]
    fn light_is_the_same_both_ways() {
        for i in 0..1000 {
            let [a, b, turn, metallic] = random(i);
            let surface = surface(metallic, 0.4, DVec3::new(0.9, 0.5, 0.1));
            let wo = direction(0.02 + 0.98 * a, 0.3);
            let wi = direction(0.02 + 0.98 * b, 7.0 * turn);
            let there = surface.eval(wo, wi, DVec3::Z).0;
            let back = surface.eval(wi, wo, DVec3::Z).0;
            assert!((there - back).length() <= 1e-9 * there.length());
        }
    }

    #[test]
    fn directions_are_drawn_with_their_density() {
        let n = DVec3::new(0.3, -0.8, -0.4).normalize();
        let (t, _) = basis(n);
        for (metallic, roughness) in [(0.0, 0.4), (0.5, 0.7), (1.0, 1.0)] {
            for cos_o in [0.15, 0.8f64] {
                let surface = surface(metallic, roughness, DVec3::new(0.9, 0.5, 0.1));
                let wo = cos_o * n + (1.0 - cos_o * cos_o).sqrt() * t;
                let density = |wi| surface.eval(wo, wi, n).1;
                let sample = |u| surface.sample(wo, n, u);
                assert_drawn(n, density, sample, &format!("{surface:?} {cos_o}"));
            }
        }
    }

    /// White furnace: a white surface never reflects more than comes, and a smooth one all of it.
    #[test]
    fn white_surfaces_make_no_light() {
        for metallic in [0.0, 0.3, 1.0] {
            for roughness in [0.1, 0.3, 0.6, 1.0] {
                for cos_o in [0.02, 0.1, 0.3, 0.6, 1.0] {
                    let surface = surface(metallic, roughness, DVec3::ONE);
                    let wo = direction(cos_o, 0.3);
                    let draws = 20_000;
                    let weights =
                        (0..draws).map(|i| surface.sample(wo, DVec3::Z, random(i)).weight.x);
                    let albedo = weights.sum::<f64>() / f64::from(draws);
                    let what = format!("{metallic} {roughness} {cos_o}: {albedo}");
                    assert!(albedo < 1.01, "{what}");
                    let is_smooth = roughness < 0.2 && cos_o > 0.2;
                    let is_rough_white = metallic == 0.0 && roughness == 1.0;
                    let least = match (is_smooth, is_rough_white) {
                        (true, _) => 0.98,
                        (_, true) => 0.9,
                        _ => 0.1,
                    };
                    assert!(albedo > least, "{what}");
                }
            }
        }
    }
}
