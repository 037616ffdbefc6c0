//! The metallic-roughness material of glTF 2.0: a diffuse base or a metal under a rough specular
//! reflection.
//!
//! The specular lobe is GGX ([`super::microfacet`]) with Schlick's Fresnel term ("An Inexpensive BRDF
//! Model for Physically-based Rendering", CGF 13(3), 1994). Transmitted light is diffuse as under the
//! coat of [`crate::Material::SmoothPlastic`], attenuated in both directions, so that the BSDF is
//! reciprocal and conserves energy; it is divided by `1 − F_avg`, the mean transmittance into the base,
//! so that a smooth white surface reflects all light. Rough surfaces reflect less at grazing angles than
//! smooth ones, so that Schlick's term of the attenuation rises only to `(1 − α)²`: about the least with
//! which white surfaces create no light.
//!
//! # Layers
//! A sheen ([`crate::sheen`]) is added to the lobes below, which are scaled by one minus the larger of
//! its directional albedos for both directions (Khronos Group, `KHR_materials_sheen`); a sheen whose
//! albedo would exceed 1 is divided by it. A clear coat of index 1.5 lies over both: another rough
//! specular lobe, whose transmittances in both directions scale all lobes below. The diffuse base is
//! divided by the mean of the product of both transmittances, so that a white one reflects all light
//! under a smooth coat, too; interreflection between a metal and the coat is neglected.
//!
//! Part of the light in the base may be transmitted: see [`ThinWall`].
//!
//! A coat with normals of its own uses its own cosines for both directions. Light from a direction that
//! only one of the normals faces reaches that layer alone, and the geometric normal decides which side is
//! outside ([`super::triangle`]).

mod thin_wall;

use std::f64::consts::PI;

use glam::DVec3;

pub use self::thin_wall::ThinWall;
use super::basis::basis;
use super::bsdf::BsdfSample;
use super::ggx::{ggx, sample_visible, visibility};
use super::intersect::vector;
use super::microfacet::reflect;
use crate::compiled::MaterialData;
use crate::scene::validate::SHEEN_ROUGHNESS;
use crate::sheen::{interpolated, sheen, sheen_reflectances};

/// BSDF at one point of such a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MetallicRoughness {
    /// Albedo of the diffuse base.
    pub diffuse: DVec3,
    /// Specular reflectance at normal incidence (F0).
    pub f0: DVec3,
    /// Specular reflectance at grazing incidence (F90).
    pub f90: f64,
    /// Largest channel of the dielectric part's reflectance at normal incidence.
    pub dielectric_f0: f64,
    /// Reflectance at grazing incidence by which light into the base and out of it is attenuated.
    pub base_f90: f64,
    /// GGX width, above 0.
    pub alpha: f64,
    /// Radiance emitted to both sides.
    pub emission: DVec3,
    /// Strength of the clear coat; 0 without.
    pub clearcoat: f64,
    /// GGX width of the coat, above 0.
    pub clearcoat_alpha: f64,
    /// Unit normal of the coat on the side of `wo`, if it differs from the base's.
    pub clearcoat_n: Option<DVec3>,
    /// Sheen colour over 2π; 0 without sheen.
    pub sheen: DVec3,
    /// Width of the sheen distribution.
    pub sheen_roughness: f64,
    /// Largest channel of the sheen's directional albedo at six cosines: see [`sheen_reflectances`].
    pub sheen_reflected: [f64; 6],
    /// Transmission, if the base transmits light.
    pub wall: Option<ThinWall>,
}

/// Texture values, by which the parameters of a material are multiplied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureFactors {
    /// Factor of the base colour.
    pub base_color: DVec3,
    /// Factor of the roughness, the square root of α.
    pub roughness: f64,
    /// Factor of the metallic share.
    pub metallic: f64,
    /// Factor of the emission.
    pub emission: DVec3,
    /// Factor of the strength of the clear coat.
    pub clearcoat: f64,
    /// Factor of the coat's roughness.
    pub clearcoat_roughness: f64,
    /// Factor of the sheen's colour.
    pub sheen: DVec3,
    /// Factor of the sheen's roughness, the square root of its width.
    pub sheen_roughness: f64,
    /// Factor of the strength of the dielectric part's reflection.
    pub specular: f64,
    /// Factor of its colour at normal incidence.
    pub specular_color: DVec3,
    /// Factor of the transmission.
    pub transmission: f64,
}

impl TextureFactors {
    /// Factors without textures.
    pub const ONE: Self = Self {
        base_color: DVec3::ONE,
        roughness: 1.0,
        metallic: 1.0,
        emission: DVec3::ONE,
        clearcoat: 1.0,
        clearcoat_roughness: 1.0,
        sheen: DVec3::ONE,
        sheen_roughness: 1.0,
        specular: 1.0,
        specular_color: DVec3::ONE,
        transmission: 1.0,
    };
}

/// Least GGX width, to which smoother surfaces are raised.
pub const ALPHA_LEAST: f32 = crate::scene::validate::ALPHA_SMOOTH_MAX;
/// Reflectance of a clear coat, of index 1.5, at normal incidence.
pub const CLEARCOAT_F0: f32 = 0.04;

impl MetallicRoughness {
    /// BSDF of a material with texture factors.
    pub fn new(material: &MaterialData, factors: &TextureFactors) -> Self {
        let base = vector(material.albedo) * factors.base_color;
        let metallic = f64::from(material.metallic) * factors.metallic;
        let specular = f64::from(material.diffuse_scale) * factors.specular;
        let f0 = vector(material.eta) * factors.specular_color * factors.specular;
        // KHR_materials_specular: the coloured reflectance is at most the specular strength.
        let f0 = f0.min(DVec3::splat(specular));
        let dielectric_f0 = f0.max_element();
        let alpha = f64::from(material.alpha) * factors.roughness * factors.roughness;
        // glTF's material reuses fields of other kinds: see `MaterialData`.
        let [clearcoat, clearcoat_alpha, transmission] = material.stripe_albedo.map(f64::from);
        let transmission = transmission * factors.transmission;
        let dielectric = base * (1.0 - metallic);
        let wall = ThinWall {
            color: dielectric * transmission,
            f90: specular,
            is_smooth: alpha <= f64::from(ALPHA_LEAST),
        };
        let clearcoat_alpha = clearcoat_alpha * factors.clearcoat_roughness.powi(2);
        let sheen = vector(material.sheen) * factors.sheen;
        let width = f64::from(material.sheen_roughness) * factors.sheen_roughness.powi(2);
        let width = width.max(f64::from(*SHEEN_ROUGHNESS.start()));
        let strength = 2.0 * PI * sheen.max_element();
        Self {
            diffuse: dielectric * (1.0 - transmission),
            f0: f0.lerp(base, metallic),
            // Metals reflect all light at grazing incidence.
            f90: specular + (1.0 - specular) * metallic,
            dielectric_f0,
            base_f90: ((1.0 - alpha).powi(2) * specular).max(dielectric_f0),
            alpha: alpha.max(f64::from(ALPHA_LEAST)),
            emission: vector(material.k) * factors.emission,
            clearcoat: clearcoat * factors.clearcoat,
            clearcoat_alpha: clearcoat_alpha.max(f64::from(ALPHA_LEAST)),
            clearcoat_n: None,
            sheen,
            sheen_roughness: width,
            sheen_reflected: sheen_reflectances(width).map(|share| strength * share),
            wall: (wall.color != DVec3::ZERO).then_some(wall),
        }
    }

    /// `f` in sr⁻¹, to be multiplied by [`MetallicRoughness::cosine`], and the density per solid angle with
    /// which [`MetallicRoughness::sample`] draws `wi`; 0 for light straight through a smooth wall.
    pub fn eval(&self, wo: DVec3, wi: DVec3, n: DVec3) -> (DVec3, f64) {
        if self.is_passed(wi, n) {
            return self.eval_passed(wo, wi, n);
        }
        let (f, pdf) = self.eval_above(wo, wi, n);
        (f, (1.0 - self.passed_share(wo, n)) * pdf)
    }

    /// [`MetallicRoughness::eval`] without transmission.
    fn eval_above(&self, wo: DVec3, wi: DVec3, n: DVec3) -> (DVec3, f64) {
        let (f, pdf) = self.eval_below_coat(wo, wi, n);
        if self.clearcoat == 0.0 {
            return (f, pdf);
        }
        let coat_n = self.clearcoat_n.unwrap_or(n);
        let (cos_o, cos_i) = (wo.dot(coat_n), wi.dot(coat_n));
        let passed = (1.0 - self.coat_reflected(cos_o)) * (1.0 - self.coat_reflected(cos_i));
        let share = self.clearcoat_share(wo, n);
        let mut f = f * passed;
        if self.clearcoat_n.is_some() {
            f *= wi.dot(n).max(0.0) / self.cosine(wi, n).max(f64::MIN_POSITIVE);
        }
        if cos_o <= 0.0 || cos_i <= 0.0 {
            return (f, (1.0 - share) * pdf);
        }
        let (h, alpha) = ((wo + wi).normalize(), self.clearcoat_alpha);
        let seen = 0.25 * ggx(alpha, h.dot(coat_n)) * visibility(alpha, cos_o);
        let mut coat = self.coat_reflected(wo.dot(h)) * seen * visibility(alpha, cos_i);
        if self.clearcoat_n.is_some() {
            // `f` is multiplied by the larger cosine later, while this lobe is defined with its own.
            coat *= cos_i / self.cosine(wi, n);
        }
        (f + coat, share * seen + (1.0 - share) * pdf)
    }

    /// Cosine of the incident direction `wi`: to the base's normal `n`, or to the coat's own where it is
    /// larger. Negative on the other side of a wall.
    pub fn cosine(&self, wi: DVec3, n: DVec3) -> f64 {
        let cos_i = wi.dot(n);
        let coat_n = self.clearcoat_n.filter(|_| !self.is_passed(wi, n));
        coat_n.map_or(cos_i, |coat_n| cos_i.max(wi.dot(coat_n)))
    }

    /// [`MetallicRoughness::eval`] without the coat, for the cosine to `n`.
    fn eval_below_coat(&self, wo: DVec3, wi: DVec3, n: DVec3) -> (DVec3, f64) {
        let (cos_o, cos_i) = (wo.dot(n), wi.dot(n));
        if cos_o <= 0.0 || cos_i <= 0.0 {
            return (DVec3::ZERO, 0.0);
        }
        let h = (wo + wi).normalize();
        // Density of visible normals times the Jacobian of reflection, as in `Conductor::eval`.
        let seen = 0.25 * ggx(self.alpha, h.dot(n)) * visibility(self.alpha, cos_o);
        let reflected =
            schlick(self.f0, self.f90, wo.dot(h)) * (seen * visibility(self.alpha, cos_i));
        let passed = self.passed(cos_o) * self.passed(cos_i);
        let scattered = self.diffuse * (passed * self.diffuse_scale() / PI);
        let share = self.reflected_share(cos_o);
        let pdf = share * seen + (1.0 - share) * cos_i / PI;
        let mut f = reflected + scattered;
        if self.sheen != DVec3::ZERO {
            // The larger of both losses keeps the BSDF reciprocal, and the sum with the sheen at most 1.
            let reflected = self.sheen_reflected(cos_o).max(self.sheen_reflected(cos_i));
            f *= (1.0 - reflected).max(0.0);
            let sheen = sheen(self.sheen_roughness, cos_o, cos_i, h.dot(n));
            f += self.sheen * (sheen / reflected.max(1.0));
        }
        (f, pdf)
    }

    /// Draws a direction: `u[0]` chooses between transmission, coat, specular and diffuse lobe, `u[1]` and
    /// `u[2]` the direction.
    pub fn sample(&self, wo: DVec3, n: DVec3, u: [f64; 4]) -> BsdfSample {
        let Some(wall) = &self.wall else {
            return self.sample_above(wo, n, u);
        };
        let share = self.passed_share(wo, n);
        if u[0] < share {
            return self.sample_passed(wall, wo, n, u);
        }
        let [u0, u1, u2, u3] = u;
        let mut sample = self.sample_above(wo, n, [(u0 - share) / (1.0 - share), u1, u2, u3]);
        if sample.wi.dot(n) <= 0.0 {
            sample.weight = DVec3::ZERO;
        }
        sample
    }

    /// [`MetallicRoughness::sample`] without transmission.
    fn sample_above(&self, wo: DVec3, n: DVec3, u: [f64; 4]) -> BsdfSample {
        let coat = self.clearcoat_share(wo, n);
        let mut lobe_n = n;
        let wi = if u[0] < coat {
            lobe_n = self.clearcoat_n.unwrap_or(n);
            let h = sample_visible(self.clearcoat_alpha, wo, lobe_n, u[1], u[2]);
            reflect(wo, h)
        } else if (u[0] - coat) / (1.0 - coat) < self.reflected_share(wo.dot(n)) {
            reflect(wo, sample_visible(self.alpha, wo, n, u[1], u[2]))
        } else {
            let (radius, phi) = (u[1].sqrt(), 2.0 * PI * u[2]);
            let (t, b) = basis(n);
            let cos_i = (1.0 - u[1]).max(0.0).sqrt();
            radius * phi.cos() * t + radius * phi.sin() * b + cos_i * n
        };
        let (f, pdf) = self.eval(wo, wi, n);
        // A specular direction below its own lobe's normal has weight 0, even if the other normal faces it:
        // its lobe's density is 0 there.
        let weight = match pdf > 0.0 && wi.dot(lobe_n) > 0.0 {
            true => f * (self.cosine(wi, n) / pdf),
            false => DVec3::ZERO,
        };
        let pdf = Some(pdf);
        BsdfSample { wi, weight, pdf }
    }

    /// Approximate albedo, including transmittance.
    pub fn albedo(&self) -> DVec3 {
        let passed = self.wall.map_or(DVec3::ZERO, |wall| wall.color);
        (self.diffuse + self.f0 + passed).min(DVec3::ONE)
    }

    /// Transmittance straight through a smooth wall; 0 otherwise.
    pub fn straight(&self, wo: DVec3, n: DVec3) -> DVec3 {
        let wall = self.wall.as_ref().filter(|wall| wall.is_smooth);
        wall.map_or(DVec3::ZERO, |wall| self.straight_passed(wall, wo, n))
    }

    /// Fresnel transmittance into the base or out of it.
    fn passed(&self, cos: f64) -> f64 {
        1.0 - self.dielectric_f0 - (self.base_f90 - self.dielectric_f0) * grazing(cos)
    }

    /// Reciprocal of the cosine-weighted mean of [`Self::passed`] times the coat's transmittance: the mean
    /// of [`grazing`] over the hemisphere is 1/21, that of its square 1/66.
    fn diffuse_scale(&self) -> f64 {
        let (passed, rise) = (1.0 - self.dielectric_f0, self.base_f90 - self.dielectric_f0);
        let base = passed - rise / 21.0;
        let coat_f0 = f64::from(CLEARCOAT_F0);
        let (coat_passed, coat_rise) = (
            1.0 - self.clearcoat * coat_f0,
            self.clearcoat * (1.0 - coat_f0),
        );
        1.0 / (base * coat_passed - coat_rise * (passed / 21.0 - rise / 66.0))
    }

    /// Approximate directional albedo of the sheen at a cosine.
    fn sheen_reflected(&self, cos: f64) -> f64 {
        interpolated(&self.sheen_reflected, cos)
    }

    /// Share of light that the coat reflects at a cosine.
    fn coat_reflected(&self, cos: f64) -> f64 {
        let f0 = f64::from(CLEARCOAT_F0);
        self.clearcoat * (f0 + (1.0 - f0) * grazing(cos))
    }

    /// Probability with which [`MetallicRoughness::sample`] chooses the coat.
    fn clearcoat_share(&self, wo: DVec3, n: DVec3) -> f64 {
        let coat = self.coat_reflected(wo.dot(self.clearcoat_n.unwrap_or(n)));
        let [reflected, scattered] = self.weights(wo.dot(n));
        coat / (coat + (1.0 - coat) * (reflected + scattered) / 3.0).max(f64::MIN_POSITIVE)
    }

    /// Probability with which [`MetallicRoughness::sample`] chooses the specular lobe, if not the coat.
    fn reflected_share(&self, cos_o: f64) -> f64 {
        let [reflected, scattered] = self.weights(cos_o);
        match reflected + scattered > 0.0 {
            true => reflected / (reflected + scattered),
            false => 0.0,
        }
    }

    /// Approximate albedos of the specular lobe, and of base and sheen, summed over the channels.
    fn weights(&self, cos_o: f64) -> [f64; 2] {
        let reflected = schlick(self.f0, self.f90, cos_o).element_sum();
        let sheen = match self.sheen == DVec3::ZERO {
            true => 0.0,
            false => 3.0 * self.sheen_reflected(cos_o).min(1.0),
        };
        [
            reflected,
            self.passed(cos_o) * self.diffuse.element_sum() + sheen,
        ]
    }
}

/// Schlick's approximation of the Fresnel term.
fn schlick(f0: DVec3, f90: f64, cos: f64) -> DVec3 {
    f0 + (f90 - f0) * grazing(cos)
}

/// The fifth power (1 − cos)⁵ of Schlick's approximation.
fn grazing(cos: f64) -> f64 {
    (1.0 - cos).clamp(0.0, 1.0).powi(5)
}

#[cfg(test)]
mod tests {
    use super::super::microfacet::tests::assert_drawn;
    use super::*;
    use crate::sampling::uniforms;

    pub(super) fn surface(metallic: f64, roughness: f64, base: DVec3) -> MetallicRoughness {
        MetallicRoughness {
            diffuse: base * (1.0 - metallic),
            f0: DVec3::splat(0.04).lerp(base, metallic),
            f90: 1.0,
            dielectric_f0: 0.04,
            base_f90: (1.0 - roughness * roughness).powi(2).max(0.04),
            alpha: roughness * roughness,
            emission: DVec3::ZERO,
            clearcoat: 0.0,
            clearcoat_alpha: 0.01,
            clearcoat_n: None,
            sheen: DVec3::ZERO,
            sheen_roughness: 1.0,
            sheen_reflected: [0.0; 6],
            wall: None,
        }
    }

    /// A surface with a clear coat and a sheen.
    pub(super) fn layered(
        base: MetallicRoughness,
        coat: f64,
        sheen: f64,
        roughness: f64,
    ) -> MetallicRoughness {
        MetallicRoughness {
            clearcoat: coat,
            clearcoat_alpha: (roughness * roughness).max(1e-3),
            sheen: DVec3::splat(sheen / (2.0 * PI)),
            sheen_roughness: 0.3,
            sheen_reflected: sheen_reflectances(0.3).map(|share| sheen * share),
            ..base
        }
    }

    pub(super) fn direction(cos: f64, turn: f64) -> DVec3 {
        let sine = (1.0 - cos * cos).sqrt();
        DVec3::new(sine * turn.cos(), sine * turn.sin(), cos)
    }

    pub(super) fn random(i: u32) -> [f64; 4] {
        uniforms(i, 3, 5, 7).map(f64::from)
    }

    #[test]
    fn light_is_the_same_both_ways() {
        for i in 0..1000 {
            let [a, b, turn, metallic] = random(i);
            let surface = surface(metallic, 0.4, DVec3::new(0.9, 0.5, 0.1));
            let surface = layered(surface, f64::from(i % 3) * 0.5, f64::from(i % 2), 0.3);
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
                let surface = layered(surface, metallic, 1.0 - metallic, 0.5);
                let wo = cos_o * n + (1.0 - cos_o * cos_o).sqrt() * t;
                let density = |wi| surface.eval(wo, wi, n).1;
                let sample = |u| surface.sample(wo, n, u);
                assert_drawn(n, density, sample, &format!("{surface:?} {cos_o}"));
            }
        }
    }

    /// Mean weight of sampled directions.
    fn directional_albedo(surface: &MetallicRoughness, cos_o: f64) -> f64 {
        let wo = direction(cos_o, 0.3);
        let draws = 20_000;
        let weights = (0..draws).map(|i| surface.sample(wo, DVec3::Z, random(i)).weight.x);
        weights.sum::<f64>() / f64::from(draws)
    }

    /// White furnace of layers: a white base under a smooth coat reflects all light, and no layer creates
    /// any.
    #[test]
    fn coats_and_sheens_over_white_surfaces_make_no_light() {
        for metallic in [0.0, 0.5, 1.0] {
            for (coat, sheen) in [(1.0, 0.0), (0.5, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                for roughness in [0.1, 0.3, 1.0] {
                    for cos_o in [0.05, 0.3, 1.0] {
                        let base = surface(metallic, roughness, DVec3::ONE);
                        let surface = layered(base, coat, sheen, roughness);
                        let albedo = directional_albedo(&surface, cos_o);
                        let what =
                            format!("{metallic} {coat} {sheen} {roughness} {cos_o}: {albedo}");
                        assert!(albedo < 1.01, "{what}");
                        let is_smooth = roughness == 0.1 && metallic == 0.0 && sheen == 0.0;
                        let least = if is_smooth && cos_o > 0.2 { 0.9 } else { 0.05 };
                        assert!(albedo > least, "{what}");
                    }
                }
            }
        }
    }

    /// White furnace: at grazing angles a narrow sheen alone would reflect a third more light than arrives.
    #[test]
    fn narrow_sheens_make_no_light_at_grazing_angles() {
        for width in [0.1, 0.15, 0.3] {
            for cos_o in [0.003, 0.02, 0.1] {
                let mut surface = layered(surface(0.0, 1.0, DVec3::ONE), 0.0, 1.0, 0.5);
                surface.sheen_roughness = width;
                surface.sheen_reflected = sheen_reflectances(width);
                let albedo = directional_albedo(&surface, cos_o);
                let what = format!("{width} {cos_o}: {albedo}");
                assert!((0.75..1.01).contains(&albedo), "{what}");
            }
        }
    }

    /// Light reflected by a coat with a normal of its own and by the base below.
    #[test]
    fn directions_of_a_coat_with_its_own_normal_are_drawn_with_their_density() {
        let n = DVec3::new(0.3, -0.8, -0.4).normalize();
        let (t, b) = basis(n);
        for tilt in [0.3, 1.2f64] {
            let below = surface(0.3, 0.6, DVec3::new(0.9, 0.5, 0.1));
            let surface = MetallicRoughness {
                clearcoat_n: Some((tilt.cos() * n + tilt.sin() * b).normalize()),
                ..layered(below, 0.7, 0.0, 0.6)
            };
            // A coat of strength 1 transmits nothing at grazing angles, where samples would have no weight.
            let wo = (0.6 * n + 0.7 * t + 0.2 * b).normalize();
            let density = |wi| surface.eval(wo, wi, n).1;
            let sample = |u| surface.sample(wo, n, u);
            assert_drawn(n, density, sample, &format!("{surface:?}"));
        }
    }

    /// Closed form: a smooth coat over black reflects Schlick's term.
    #[test]
    fn a_coat_over_black_reflects_schlick_s_term() {
        for cos_o in [0.2, 0.5, 1.0f64] {
            let mut surface = layered(surface(0.0, 1.0, DVec3::ZERO), 0.8, 0.0, 0.0);
            (surface.f0, surface.f90) = (DVec3::ZERO, 0.0);
            let expected = 0.8 * (0.04 + 0.96 * (1.0 - cos_o).powi(5));
            let albedo = directional_albedo(&surface, cos_o);
            assert!(
                (albedo - expected).abs() < 0.01 * expected,
                "{albedo} {expected}"
            );
        }
    }

    /// White furnace: a white surface never reflects more light than arrives, and a smooth one all of it.
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
