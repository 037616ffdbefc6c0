//! Metals and dielectrics, smooth and rough: evaluation, sampling and density.
//!
//! GGX microfacets with Smith's separable shadowing (Walter et al., "Microfacet Models for Refraction
//! through Rough Surfaces", EGSR 2007). `n` is on the side of `wo`; a smooth surface has no density and
//! evaluates to 0.

use glam::DVec3;

use super::bsdf::BsdfSample;
use super::ggx::{ggx, sample_visible, visibility};
use crate::fresnel::{fresnel_conductor, fresnel_dielectric};

/// A metal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conductor {
    /// Real part of the index of refraction.
    pub eta: DVec3,
    /// Imaginary part of the index of refraction.
    pub k: DVec3,
    /// GGX width; 0 for a mirror.
    pub alpha: f64,
}

/// The boundary of a dielectric.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dielectric {
    /// Index of refraction beyond the surface over that on the side of `wo`.
    pub eta: f64,
    /// GGX width; 0 for a smooth surface.
    pub alpha: f64,
}

/// BSDF value and density of a rough dielectric for one direction.
struct Facet {
    f: f64,
    pdf: f64,
}

impl Conductor {
    /// `f` in sr⁻¹, and the density per solid angle with which [`Conductor::sample`] draws `wi`.
    pub fn eval(&self, wo: DVec3, wi: DVec3, n: DVec3) -> (DVec3, f64) {
        let (cos_o, cos_i) = (wo.dot(n), wi.dot(n));
        if self.alpha == 0.0 || cos_o <= 0.0 || cos_i <= 0.0 {
            return (DVec3::ZERO, 0.0);
        }
        let h = (wo + wi).normalize();
        // Density of visible normals, G1 (wo·h) D / cos θo, times the Jacobian 1 / (4 wo·h) of reflection.
        let pdf = 0.25 * ggx(self.alpha, h.dot(n)) * visibility(self.alpha, cos_o);
        let reflectance = fresnel_conductor(wo.dot(h), self.eta, self.k);
        (reflectance * (pdf * visibility(self.alpha, cos_i)), pdf)
    }

    /// Draws a direction by `u[1]` and `u[2]`.
    pub fn sample(&self, wo: DVec3, n: DVec3, u: [f64; 4]) -> BsdfSample {
        if self.alpha == 0.0 {
            return BsdfSample {
                wi: reflect(wo, n),
                weight: fresnel_conductor(wo.dot(n), self.eta, self.k),
                pdf: None,
            };
        }
        let h = sample_visible(self.alpha, wo, n, u[1], u[2]);
        let wi = reflect(wo, h);
        let cos_i = wi.dot(n).max(0.0);
        let shadowing = visibility(self.alpha, cos_i) * cos_i;
        BsdfSample {
            wi,
            weight: fresnel_conductor(wo.dot(h), self.eta, self.k) * shadowing,
            pdf: Some(self.eval(wo, wi, n).1),
        }
    }
}

impl Dielectric {
    /// `f` in sr⁻¹ for radiance, and the density of `wi`, which may be on either side.
    pub fn eval(&self, wo: DVec3, wi: DVec3, n: DVec3) -> (DVec3, f64) {
        let (cos_o, cos_i) = (wo.dot(n), wi.dot(n));
        if self.alpha == 0.0 || cos_o <= 0.0 || cos_i == 0.0 {
            return (DVec3::ZERO, 0.0);
        }
        let Facet { f, pdf } = if cos_i > 0.0 {
            self.reflection(wo, wi, n)
        } else {
            self.refraction(wo, wi, n)
        };
        (DVec3::splat(f), pdf)
    }

    fn reflection(&self, wo: DVec3, wi: DVec3, n: DVec3) -> Facet {
        let h = (wo + wi).normalize();
        let seen = 0.25 * ggx(self.alpha, h.dot(n)) * visibility(self.alpha, wo.dot(n));
        let pdf = fresnel_dielectric(wo.dot(h), self.eta) * seen;
        Facet {
            f: pdf * visibility(self.alpha, wi.dot(n)),
            pdf,
        }
    }

    /// Walter et al. 2007, equations 16 and 21; radiance beyond the surface is lower by η².
    fn refraction(&self, wo: DVec3, wi: DVec3, n: DVec3) -> Facet {
        let h = (wo + self.eta * wi).normalize();
        // Into a denser body η·wi outweighs wo, and the sum points inwards.
        let h = if h.dot(n) < 0.0 { -h } else { h };
        let (o, i) = (wo.dot(h), -wi.dot(h));
        if o <= 0.0 || i <= 0.0 {
            return Facet { f: 0.0, pdf: 0.0 };
        }
        let seen = ggx(self.alpha, h.dot(n)) * visibility(self.alpha, wo.dot(n));
        let passed = 1.0 - fresnel_dielectric(o, self.eta);
        let eta2 = self.eta * self.eta;
        // Density of visible normals times the Jacobian of equation 17.
        let pdf = passed * seen * o * i * eta2 / (o - self.eta * i).powi(2);
        Facet {
            f: pdf * visibility(self.alpha, -wi.dot(n)) / eta2,
            pdf,
        }
    }

    /// Draws a direction: `u[0]` chooses between reflection and refraction by the Fresnel term,
    /// `u[1]` and `u[2]` the microfacet.
    pub fn sample(&self, wo: DVec3, n: DVec3, u: [f64; 4]) -> BsdfSample {
        let h = if self.alpha == 0.0 {
            n
        } else {
            sample_visible(self.alpha, wo, n, u[1], u[2])
        };
        let is_reflected = u[0] < fresnel_dielectric(wo.dot(h), self.eta);
        let wi = if is_reflected {
            reflect(wo, h)
        } else {
            refract(wo, h, self.eta)
        };
        // Radiance beyond the surface is lower by η².
        let passed = if is_reflected {
            1.0
        } else {
            1.0 / (self.eta * self.eta)
        };
        if self.alpha == 0.0 {
            return BsdfSample {
                wi,
                weight: DVec3::splat(passed),
                pdf: None,
            };
        }
        // A microfacet may send light to the wrong side of the macroscopic surface.
        let cos_i = if is_reflected { wi.dot(n) } else { -wi.dot(n) }.max(0.0);
        BsdfSample {
            wi,
            weight: DVec3::splat(passed * visibility(self.alpha, cos_i) * cos_i),
            pdf: Some(self.eval(wo, wi, n).1),
        }
    }
}

pub(super) fn reflect(wo: DVec3, h: DVec3) -> DVec3 {
    2.0 * wo.dot(h) * h - wo
}

/// Refracted direction by Snell's law; `h` is on the side of `wo`, which is not totally reflected.
fn refract(wo: DVec3, h: DVec3, eta: f64) -> DVec3 {
    let cos_o = wo.dot(h);
    // √(η² − sin² θ) / η, factored: η² − 1 would cancel for indices near 1.
    let cos_t = ((eta - 1.0) * (eta + 1.0) + cos_o * cos_o).max(0.0).sqrt() / eta;
    ((cos_o / eta - cos_t) * h - wo / eta).normalize()
}

#[cfg(test)]
pub(super) mod tests {
    use std::f64::consts::PI;

    use super::super::basis::basis;
    use super::*;
    use crate::sampling::uniforms;

    const ALPHAS: [f64; 4] = [0.03, 0.1, 0.4, 1.0];

    fn tilted() -> DVec3 {
        DVec3::new(0.3, -0.8, -0.4).normalize()
    }

    /// At `cos` to the normal and `turn` radians round it.
    fn direction(n: DVec3, cos: f64, turn: f64) -> DVec3 {
        let (t, b) = basis(n);
        let sine = (1.0 - cos * cos).sqrt();
        cos * n + sine * (turn.cos() * t + turn.sin() * b)
    }

    fn gold(alpha: f64) -> Conductor {
        Conductor {
            eta: DVec3::new(0.143, 0.375, 1.442),
            k: DVec3::new(3.983, 2.386, 1.603),
            alpha,
        }
    }

    fn random(i: u32) -> [f64; 4] {
        uniforms(i, 3, 5, 7).map(f64::from)
    }

    #[test]
    fn metal_and_glass_are_reciprocal_up_to_eta_squared() {
        let n = tilted();
        for i in 0..2000 {
            let [a, b, turn, side] = random(i);
            let (a, b) = (0.02 + 0.98 * a, 0.02 + 0.98 * b);
            let (wo, wi) = (direction(n, a, 0.3), direction(n, b, 7.0 * turn));
            let metal = gold(0.3);
            let (there, back) = (metal.eval(wo, wi, n).0, metal.eval(wi, wo, n).0);
            assert!((there - back).length() <= 1e-9 * there.length());

            let glass = |eta| Dielectric { eta, alpha: 0.3 };
            let (there, back) = if side < 0.5 {
                (glass(1.5).eval(wo, wi, n).0, glass(1.5).eval(wi, wo, n).0)
            } else {
                // f(wo → wi) / η_i² is the same both ways (Veach 1997, equation 5.14); from the
                // other side the normal is turned and the index inverted.
                let there = glass(1.5).eval(wo, -wi, n).0;
                (there, glass(1.0 / 1.5).eval(-wi, wo, -n).0 / 2.25)
            };
            assert!(
                (there - back).length() <= 1e-9 * there.length(),
                "{there} {back}"
            );
        }
    }

    /// Chi-square over cells of cosine and azimuth: drawn directions against the integral of the
    /// density, for both sides of the surface. 256 cells: the statistic has mean 255 and standard
    /// deviation 23; cells that expect less than five draws are merged.
    #[test]
    fn directions_are_drawn_with_their_density() {
        let n = tilted();
        for (index, alpha) in ALPHAS.into_iter().enumerate().skip(1) {
            for cos_o in [0.15, 0.8] {
                let wo = direction(n, cos_o, 0.4);
                for eta in [1.5, 1.0 / 1.5] {
                    let glass = Dielectric { eta, alpha };
                    let density = |wi| glass.eval(wo, wi, n).1;
                    let sample = |u| glass.sample(wo, n, u);
                    assert_drawn(n, density, sample, &format!("glass {eta} {alpha} {cos_o}"));
                }
                let metal = gold(alpha);
                let density = |wi| metal.eval(wo, wi, n).1;
                let sample = |u| metal.sample(wo, n, u);
                assert_drawn(n, density, sample, &format!("gold {index} {cos_o}"));
            }
        }
    }

    /// Cells of (cos θ, φ) over the sphere; directions of weight 0, reflected below
    /// the horizon or refracted above it, have no density.
    pub(in crate::scalar) fn assert_drawn(
        n: DVec3,
        density: impl Fn(DVec3) -> f64,
        sample: impl Fn([f64; 4]) -> BsdfSample,
        what: &str,
    ) {
        const CELLS: (usize, usize) = (16, 16);
        const STEPS: usize = 24;
        const DRAWS: u32 = 100_000;
        let (t, b) = basis(n);
        let mut drawn = [0.0; CELLS.0 * CELLS.1];
        for i in 0..DRAWS {
            let BsdfSample { wi, weight, .. } = sample(random(i));
            if weight == DVec3::ZERO {
                continue;
            }
            let z = 0.5 * (wi.dot(n) + 1.0) * CELLS.0 as f64;
            let phi = (wi.dot(b).atan2(wi.dot(t)) / (2.0 * PI)).rem_euclid(1.0) * CELLS.1 as f64;
            let cell = (z as usize).min(CELLS.0 - 1) * CELLS.1 + (phi as usize).min(CELLS.1 - 1);
            drawn[cell] += 1.0;
        }
        let mut expected = [0.0; CELLS.0 * CELLS.1];
        let area = 4.0 * PI / (CELLS.0 * CELLS.1 * STEPS * STEPS) as f64;
        for (i, expected) in expected.iter_mut().enumerate() {
            for step in 0..STEPS * STEPS {
                let place = |cell: usize, step: usize, cells: usize| {
                    (cell as f64 + (step as f64 + 0.5) / STEPS as f64) / cells as f64
                };
                let z = 2.0 * place(i / CELLS.1, step / STEPS, CELLS.0) - 1.0;
                let phi = 2.0 * PI * place(i % CELLS.1, step % STEPS, CELLS.1);
                *expected += density(direction(n, z, phi)) * area * f64::from(DRAWS);
            }
        }
        let (mut chi2, mut degrees) = (0.0, 0.0);
        let mut rest = (0.0, 0.0);
        for (drawn, expected) in drawn.into_iter().zip(expected) {
            if expected < 5.0 {
                rest = (rest.0 + drawn, rest.1 + expected);
                continue;
            }
            chi2 += (drawn - expected) * (drawn - expected) / expected;
            degrees += 1.0;
        }
        // The quadrature's own error, 1 % of a cell, adds to the statistic of so many draws.
        let slack: f64 = expected.iter().map(|e| 1e-4 * e).sum();
        assert!(
            chi2 < degrees + 6.0 * (2.0f64 * degrees).sqrt() + slack,
            "{what}: {chi2} {degrees}"
        );
        assert!(
            (rest.0 - rest.1).abs() < 6.0 * (rest.1 + 10.0).sqrt() + 1e-2 * rest.1,
            "{what}"
        );
    }

    #[test]
    fn weights_are_value_over_density() {
        let n = tilted();
        for alpha in ALPHAS {
            for eta in [1.5, 1.0 / 1.5] {
                let glass = Dielectric { eta, alpha };
                let wo = direction(n, 0.6, 1.0);
                let mut mean = 0.0;
                for i in 0..20_000 {
                    let sample = glass.sample(wo, n, random(i));
                    let (f, pdf) = glass.eval(wo, sample.wi, n);
                    let cos = sample.wi.dot(n);
                    let eta2 = if cos < 0.0 { eta * eta } else { 1.0 };
                    mean += sample.weight.x * eta2 / 20_000.0;
                    let ratio = f.x * cos.abs() / pdf;
                    let agrees = (ratio - sample.weight.x).abs() < 1e-6 * ratio.max(1.0);
                    assert!(
                        sample.weight == DVec3::ZERO || agrees,
                        "{alpha} {eta}: {ratio}"
                    );
                }
                assert!(
                    mean <= 1.0 + 1e-9 && mean > 1.0 - alpha,
                    "{alpha} {eta}: {mean}"
                );
            }
        }
    }

    #[test]
    fn a_smooth_surface_is_the_limit_of_rough_ones() {
        let n = tilted();
        let wo = direction(n, 0.7, 2.0);
        for i in 0..200 {
            let u = random(i);
            let smooth = [
                gold(0.0).sample(wo, n, u),
                Dielectric {
                    eta: 1.5,
                    alpha: 0.0,
                }
                .sample(wo, n, u),
            ];
            let rough = [
                gold(1e-5).sample(wo, n, u),
                Dielectric {
                    eta: 1.5,
                    alpha: 1e-5,
                }
                .sample(wo, n, u),
            ];
            for (smooth, rough) in smooth.into_iter().zip(rough) {
                assert!((smooth.wi - rough.wi).length() < 5e-3);
                assert!((smooth.weight - rough.weight).length() < 5e-3);
                assert_eq!(smooth.pdf, None);
            }
        }
    }

    #[test]
    fn snell_s_law_holds_and_an_index_of_1_bends_nothing() {
        let n = tilted();
        for cos in [0.05, 0.5, 1.0] {
            let wo = direction(n, cos, 0.2);
            for eta in [1.5, 1.0 / 1.5] {
                let sample = Dielectric { eta, alpha: 0.0 }.sample(wo, n, [0.999_999; 4]);
                if sample.wi.dot(n) > 0.0 {
                    assert!(eta < 1.0 && cos < 0.75, "total reflection from inside only");
                    continue;
                }
                let sine = |w: DVec3| w.cross(n).length();
                assert!((sine(wo) - eta * sine(sample.wi)).abs() < 1e-12);
                assert!((sample.weight.x * eta * eta - 1.0).abs() < 1e-12);
            }
            let through = Dielectric {
                eta: 1.0,
                alpha: 0.0,
            }
            .sample(wo, n, [0.0; 4]);
            assert!((through.wi + wo).length() < 1e-12 && through.weight == DVec3::ONE);
        }
    }
}
