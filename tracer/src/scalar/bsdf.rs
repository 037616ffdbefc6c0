//! Diffuse surfaces, bare or under a coat: evaluation, sampling and density.
//!
//! `wo` and `wi` both point away from the surface, to the viewer and to the light; cosines are to the
//! normal on the side of `wo`.

use std::f64::consts::PI;

use glam::DVec3;

use super::basis::basis;
use super::ggx::{sample_visible, visibility};
use super::intersect::{Hit, vector};
use crate::CompiledScene;
use crate::compiled::{
    MaterialData, PATTERN_BRICKS, PATTERN_CLOTH, PATTERN_CUE, PATTERN_NUMBER, PATTERN_PLANKS,
    PATTERN_PRINT, PATTERN_SCOREBOARD, PATTERN_WOOD, Primitive,
};
use crate::fresnel::fresnel_dielectric;
use crate::sheen::sheen;
use crate::texture::{bricks, cloth, cue, in_circle, numbered, print, scoreboard, wood};

/// BSDF at one point of a surface: a specular coat of reflectance `F(cos wo)` over
/// `f = albedo/π · (1−F(cos wo))(1−F(cos wi)) · diffuse_scale`, with `F = 0` without a coat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bsdf {
    /// Albedo of the base.
    pub albedo: DVec3,
    /// Index of refraction of the coat; 0 for none.
    pub ior: f64,
    /// GGX width of the coat; 0 if it is smooth.
    pub coat_alpha: f64,
    /// The mirror of a rough coat's sampled microfacet: [`Bsdf::with_facet`].
    pub facet: Option<CoatFacet>,
    /// Energy compensation of the base for internal reflection: `1 / (η²(1 − F_dr,int))`; 1 without a
    /// coat.
    pub diffuse_scale: f64,
    /// Sheen colour of a cloth over 2π; 0 for none.
    pub sheen: DVec3,
    /// Width of the sheen distribution.
    pub sheen_roughness: f64,
}

/// Reflection by one microfacet of a rough coat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoatFacet {
    /// Unit direction of the reflection.
    pub wi: DVec3,
    /// `F(wo·h) G1(wi)`, whose mean over the facets visible from `wo` is the coat's albedo.
    pub reflectance: f64,
}

/// A direction sampled from a BSDF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// Unit direction to the light.
    pub wi: DVec3,
    /// `f · |cos wi| / pdf`; 0 if the path ends.
    pub weight: DVec3,
    /// Density of `wi` per solid angle, for MIS of light found along it; `None` if next-event estimation
    /// cannot find that light, 0 if it has added it already: the mirror of a coat. ([`crate::reference`]
    /// has no next-event estimation for coats, and treats 0 as `None`.)
    pub pdf: Option<f64>,
}

/// Distance from the narrow end of a truncated cone along its axis, if its side was hit, metres.
fn from_tip_m(scene: &CompiledScene, hit: &Hit) -> Option<f64> {
    let Primitive::CsgFace(face) = hit.primitive else {
        return None;
    };
    let (axis, end) = scene.cone_axis(face)?;
    Some(hit.point.dot(axis) - end)
}

impl Bsdf {
    /// BSDF at a hit, for a footprint of `footprint_m` metres. An area light reflects nothing.
    pub fn from_hit(scene: &CompiledScene, hit: &Hit, footprint_m: f64) -> Self {
        let Some(material) = scene.material_of(hit.primitive) else {
            return Self::black();
        };
        let pattern = match material.pattern {
            PATTERN_WOOD | PATTERN_PLANKS => Some(wood(material, hit.point, footprint_m)),
            PATTERN_CLOTH => Some(cloth(material, hit.point, footprint_m)),
            PATTERN_BRICKS => Some(bricks(material, hit.point)),
            PATTERN_SCOREBOARD => Some(scoreboard(material, hit.point)),
            PATTERN_PRINT => Some(print(material, hit.point)),
            PATTERN_CUE => Some(from_tip_m(scene, hit).map_or_else(
                || vector(material.stripe_albedo),
                |from_tip_m| cue(material, from_tip_m),
            )),
            _ => None,
        };
        if let Some(albedo) = pattern {
            return Self {
                albedo,
                ..Self::new(material, false)
            };
        }
        let Primitive::Sphere(i) = hit.primitive else {
            return Self::new(material, false);
        };
        let sphere = &scene.spheres[i as usize];
        let up = vector(sphere.stripe_axis);
        let in_stripe = hit.n.dot(up).abs() < f64::from(material.stripe_half_width);
        let mut bsdf = Self::new(material, in_stripe);
        if material.pattern == PATTERN_NUMBER {
            let axis = vector(sphere.number_axis);
            bsdf.albedo = numbered(material.number, hit.n, axis, up, bsdf.albedo);
        }
        bsdf
    }

    /// BSDF of the disc with a number on a metal or dielectric ball, if the disc was hit from outside.
    pub(super) fn of_number_disc(
        scene: &CompiledScene,
        material: &MaterialData,
        hit: &Hit,
        wo: DVec3,
    ) -> Option<Self> {
        let disc = &scene.materials[material.number_disc()? as usize];
        let Primitive::Sphere(i) = hit.primitive else {
            return None;
        };
        let sphere = &scene.spheres[i as usize];
        let (axis, up) = (vector(sphere.number_axis), vector(sphere.stripe_axis));
        let [x, y] = in_circle(hit.n, axis, up);
        if x * x + y * y >= 1.0 || wo.dot(hit.n) < 0.0 {
            return None;
        }
        let base = Self::new(disc, false);
        Some(Self {
            albedo: numbered(disc.number, hit.n, axis, up, base.albedo),
            ..base
        })
    }

    /// BSDF of a material without texture, inside or outside its stripe.
    pub fn new(material: &MaterialData, in_stripe: bool) -> Self {
        let albedo = if in_stripe {
            material.stripe_albedo
        } else {
            material.albedo
        };
        Self {
            albedo: vector(albedo),
            ior: f64::from(material.ior),
            coat_alpha: f64::from(material.alpha),
            facet: None,
            diffuse_scale: f64::from(material.diffuse_scale),
            sheen: vector(material.sheen),
            sheen_roughness: f64::from(material.sheen_roughness),
        }
    }

    fn black() -> Self {
        Self {
            albedo: DVec3::ZERO,
            ior: 0.0,
            coat_alpha: 0.0,
            facet: None,
            diffuse_scale: 1.0,
            sheen: DVec3::ZERO,
            sheen_roughness: 1.0,
        }
    }

    /// Whether its coat is rough. Before [`Bsdf::with_facet`] it reflects like a smooth one.
    pub fn is_rough(&self) -> bool {
        self.ior > 0.0 && self.coat_alpha > 0.0
    }

    /// The surface with its coat replaced by the mirror of one microfacet, drawn among those visible from
    /// `wo` ([`sample_visible`]). The expectation over `u` is the rough coat: each facet passes on to the
    /// base what it does not reflect. A reflected direction below the surface is shadowed.
    #[must_use]
    pub fn with_facet(self, wo: DVec3, n: DVec3, [u1, u2]: [f64; 2]) -> Self {
        let h = sample_visible(self.coat_alpha, wo, n, u1, u2);
        let cos_h = wo.dot(h);
        let wi = 2.0 * cos_h * h - wo;
        let cos_i = wi.dot(n).max(0.0);
        // Value over density of a visible-normal sample is F · G1(wi).
        let shadowing = visibility(self.coat_alpha, cos_i) * cos_i;
        Self {
            facet: Some(CoatFacet {
                wi,
                reflectance: self.fresnel(cos_h) * shadowing,
            }),
            ..self
        }
    }

    /// Direction of the coat's mirror reflection.
    pub fn mirrored(&self, wo: DVec3, n: DVec3) -> DVec3 {
        self.facet
            .map_or_else(|| 2.0 * wo.dot(n) * n - wo, |facet| facet.wi)
    }

    /// Share of light that the coat reflects.
    pub fn reflected(&self, cos_o: f64) -> f64 {
        self.facet
            .map_or_else(|| self.fresnel(cos_o), |facet| facet.reflectance)
    }

    /// Fresnel reflectance of the coat at a cosine to the facet's normal.
    fn fresnel(&self, cos: f64) -> f64 {
        if self.ior == 0.0 {
            return 0.0;
        }
        fresnel_dielectric(cos, self.ior)
    }

    /// Probability with which [`Bsdf::sample`] chooses the mirror: its share of the total albedo.
    pub fn probability_mirror(&self, cos_o: f64) -> f64 {
        let mirror = self.reflected(cos_o);
        if mirror == 0.0 {
            return 0.0;
        }
        mirror / (mirror + (1.0 - mirror) * self.albedo.element_sum() / 3.0)
    }

    /// Diffuse lobe `f`, sr⁻¹; 0 below the surface.
    pub fn eval(&self, cos_o: f64, cos_i: f64) -> DVec3 {
        if cos_o <= 0.0 || cos_i <= 0.0 {
            return DVec3::ZERO;
        }
        // Fresnel transmittance on entry and on exit; `diffuse_scale` accounts for internal reflection.
        let coat = (1.0 - self.reflected(cos_o)) * (1.0 - self.fresnel(cos_i));
        self.albedo * (coat * self.diffuse_scale / PI)
    }

    /// Sheen lobe `f`, sr⁻¹; 0 below the surface.
    pub fn sheen(&self, wo: DVec3, wi: DVec3, n: DVec3) -> DVec3 {
        let (cos_o, cos_i) = (wo.dot(n), wi.dot(n));
        if self.sheen == DVec3::ZERO || cos_o <= 0.0 || cos_i <= 0.0 {
            return DVec3::ZERO;
        }
        let cos_h = (wo + wi).normalize().dot(n);
        self.sheen * sheen(self.sheen_roughness, cos_o, cos_i, cos_h)
    }

    /// Density per solid angle with which [`Bsdf::sample`] draws a direction of cosine `cos_i`
    /// from the diffuse lobe.
    pub fn pdf(&self, cos_o: f64, cos_i: f64) -> f64 {
        (1.0 - self.probability_mirror(cos_o)) * cos_i.max(0.0) / PI
    }

    /// Draws a direction: `u[1]` chooses the lobe and, rescaled to [0, 1), the direction's
    /// cosine; `u[2]` its azimuth. `n` is on the side of `wo`.
    pub fn sample(&self, wo: DVec3, n: DVec3, u: [f64; 4]) -> BsdfSample {
        let cos_o = wo.dot(n);
        let probability_mirror = self.probability_mirror(cos_o);
        if u[1] < probability_mirror {
            return BsdfSample {
                wi: self.mirrored(wo, n),
                weight: DVec3::splat(self.reflected(cos_o) / probability_mirror),
                pdf: Some(0.0),
            };
        }
        // Malley's method with the rescaled number: cosine-weighted directions.
        let u1 = (u[1] - probability_mirror) / (1.0 - probability_mirror);
        let (radius, phi) = (u1.sqrt(), 2.0 * PI * u[2]);
        let cos_i = (1.0 - u1).max(0.0).sqrt();
        let (t, b) = basis(n);
        let pdf = self.pdf(cos_o, cos_i);
        let wi = radius * phi.cos() * t + radius * phi.sin() * b + cos_i * n;
        let f = self.eval(cos_o, cos_i) + self.sheen(wo, wi, n);
        BsdfSample {
            wi,
            // f · cos over the density (1 − p) · cos / π.
            weight: f * (PI / (1.0 - probability_mirror)),
            pdf: Some(pdf),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::ggx::ggx;
    use super::*;
    use crate::fresnel::internal_diffuse_reflectance;
    use crate::sampling::uniforms;

    fn plastic(albedo: f64, ior: f64) -> Bsdf {
        Bsdf {
            albedo: DVec3::new(albedo, 0.5 * albedo, 0.1),
            ior,
            diffuse_scale: 1.0 / (ior * ior * (1.0 - internal_diffuse_reflectance(ior))),
            ..Bsdf::black()
        }
    }

    fn diffuse(albedo: f64) -> Bsdf {
        Bsdf {
            ior: 0.0,
            diffuse_scale: 1.0,
            ..plastic(albedo, 1.5)
        }
    }

    fn all() -> [Bsdf; 5] {
        [
            diffuse(0.8),
            plastic(0.8, 1.5),
            plastic(0.0, 1.5),
            plastic(1.0, 2.5),
            plastic(0.3, 1.0),
        ]
    }

    /// Midpoints of the cosine.
    fn cosines() -> impl Iterator<Item = f64> {
        (0..1000).map(|i| (f64::from(i) + 0.5) / 1000.0)
    }

    fn samples() -> impl Iterator<Item = [f64; 4]> {
        (0..200_000).map(|i| uniforms(i, 0, 0, 7).map(f64::from))
    }

    /// Direction at `cos` to a tilted normal.
    fn wo_at(cos: f64, n: DVec3) -> DVec3 {
        let (t, _) = basis(n);
        cos * n + (1.0 - cos * cos).sqrt() * t
    }

    fn tilted() -> DVec3 {
        DVec3::new(0.3, -0.8, -0.4).normalize()
    }

    #[test]
    fn light_goes_both_ways_alike() {
        for bsdf in all() {
            for (a, b) in [(0.1, 0.9), (1.0, 0.01), (0.5, 0.6)] {
                assert!((bsdf.eval(a, b) - bsdf.eval(b, a)).length() < 1e-15);
            }
            assert_eq!(bsdf.eval(0.5, -0.1), DVec3::ZERO);
        }
    }

    #[test]
    fn the_density_integrates_to_the_lobe_s_probability() {
        for bsdf in all() {
            for cos_o in [0.05, 0.5, 1.0] {
                let density = cosines().map(|cos_i| bsdf.pdf(cos_o, cos_i)).sum::<f64>();
                let integral = density * 2.0 * PI / 1000.0;
                let expected = 1.0 - bsdf.probability_mirror(cos_o);
                assert!((integral - expected).abs() < 1e-6, "{integral} {expected}");
            }
        }
    }

    /// Moments of drawn directions against integrals of the density: 200,000 draws of values in
    /// [−1, 1] have a standard error below 2.3e-3.
    #[test]
    fn directions_are_drawn_with_their_density() {
        let n = tilted();
        let (t, b) = basis(n);
        for bsdf in all() {
            for cos_o in [0.1, 0.7] {
                let wo = wo_at(cos_o, n);
                let mut moments = [0.0; 5];
                for u in samples() {
                    let BsdfSample { wi, pdf, .. } = bsdf.sample(wo, n, u);
                    let Some(pdf) = pdf.filter(|pdf| *pdf > 0.0) else {
                        continue;
                    };
                    assert!((pdf - bsdf.pdf(cos_o, wi.dot(n))).abs() < 1e-12);
                    let values = [1.0, wi.dot(n), wi.dot(n).powi(2), wi.dot(t), wi.dot(b)];
                    moments
                        .iter_mut()
                        .zip(values)
                        .for_each(|(m, v)| *m += v / 200_000.0);
                }
                let lobe = 1.0 - bsdf.probability_mirror(cos_o);
                let expected = [lobe, lobe * 2.0 / 3.0, lobe * 0.5, 0.0, 0.0];
                for (moment, expected) in moments.into_iter().zip(expected) {
                    assert!((moment - expected).abs() < 5e-3, "{moments:?} {expected:?}");
                }
            }
        }
    }

    /// Drawn weights average to the directional albedo, `F + ∫ f cos dω`.
    #[test]
    fn weights_average_to_the_albedo() {
        let n = tilted();
        for bsdf in all() {
            for cos_o in [0.1, 0.7] {
                let wo = wo_at(cos_o, n);
                let drawn = samples()
                    .map(|u| bsdf.sample(wo, n, u).weight)
                    .sum::<DVec3>()
                    / 2e5;
                let diffuse = cosines()
                    .map(|cos_i| bsdf.eval(cos_o, cos_i) * cos_i)
                    .sum::<DVec3>();
                let albedo = DVec3::splat(bsdf.fresnel(cos_o)) + diffuse * (2.0 * PI / 1000.0);
                assert!(
                    (drawn - albedo).length() < 6e-3,
                    "{bsdf:?} {cos_o}: {drawn} {albedo}"
                );
                assert!(albedo.max_element() < 1.0 + 1e-3);
            }
        }
    }

    /// Mean of `reflectance(wi) of` over the facets of a coat, and over GGX-distributed directions.
    fn facet_means(bsdf: Bsdf, cos_o: f64, of: fn(DVec3) -> f64) -> [f64; 2] {
        let (n, wo) = (DVec3::Z, wo_at(cos_o, DVec3::Z));
        let drawn = samples().map(|[u, v, ..]| {
            let facet = bsdf.with_facet(wo, n, [u, v]).facet.unwrap();
            facet.reflectance * of(facet.wi)
        });
        let steps = 600;
        let at = |step: i32| (f64::from(step) + 0.5) / f64::from(steps);
        let directions =
            (0..steps).flat_map(|i| (0..steps).map(move |j| (at(i), 2.0 * PI * at(j))));
        let reflected = directions.map(|(cos_i, phi)| {
            let sine = (1.0 - cos_i * cos_i).sqrt();
            let wi = DVec3::new(sine * phi.cos(), sine * phi.sin(), cos_i);
            let h = (wo + wi).normalize();
            let alpha = bsdf.coat_alpha;
            let shadowing = visibility(alpha, cos_o) * visibility(alpha, cos_i);
            bsdf.fresnel(wo.dot(h)) * ggx(alpha, h.z) * shadowing * 0.25 * cos_i * of(wi)
        });
        let cell = 2.0 * PI / f64::from(steps * steps);
        [drawn.sum::<f64>() / 2e5, reflected.sum::<f64>() * cell]
    }

    #[test]
    fn facets_of_a_rough_coat_reflect_as_ggx_on_the_whole() {
        for coat_alpha in [0.16, 0.5, 1.0] {
            let bsdf = Bsdf {
                coat_alpha,
                ..plastic(0.5, 1.5)
            };
            for cos_o in [0.15, 0.5, 1.0] {
                for of in [|_| 1.0, |wi: DVec3| wi.z, |wi: DVec3| wi.x * wi.x] {
                    let [drawn, integral] = facet_means(bsdf, cos_o, of);
                    let off = (drawn - integral).abs();
                    assert!(
                        off < 0.01 * integral + 2e-4,
                        "α {coat_alpha} at {cos_o}: {drawn} {integral}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_mirror_reflects() {
        let n = tilted();
        let wo = wo_at(0.3, n);
        let sample = plastic(0.0, 1.5).sample(wo, n, [0.0; 4]);
        assert_eq!(sample.pdf, Some(0.0));
        assert!((sample.wi.dot(n) - 0.3).abs() < 1e-12);
        assert!((sample.wi + wo - 0.6 * n).length() < 1e-12);
    }
}
