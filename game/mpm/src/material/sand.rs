//! Dry sand by Drucker–Prager plasticity with volume correction.

use fearless_simd::prelude::*;

use super::{Lame, Strain, Stress, check_elasticity, principal_stress};
use crate::error::{Result, check_range};
use crate::lanes::{Lanes, dot, each, exp, ln};
use crate::svd::Stretches;

/// Cohesionless granular material: St. Venant–Kirchhoff elasticity of logarithmic strains with the
/// Drucker–Prager yield of Klár et al. 2016, "Drucker-Prager elastoplasticity for sand
/// animation", and the volume correction of Tampubolon et al. 2017, "Multi-species simulation of
/// porous sand and water mixtures", section 4.3.4.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sand {
    /// Bulk density at rest, in kg/m³; default 1,600.
    pub density_kg_m3: f32,
    /// Young's modulus, in Pa; default 5e5, softer than quartz for longer substeps.
    pub young_pa: f32,
    /// Poisson's ratio, 0 to 0.49; default 0.3.
    pub poisson: f32,
    /// Angle of internal friction, the slope of a heap, in degrees, 0 to 60; default 33.
    pub friction_angle_deg: f32,
    /// Coefficient of Coulomb friction on balls and obstacles; default 0.5.
    pub friction: f32,
}

impl Default for Sand {
    fn default() -> Self {
        Self {
            density_kg_m3: 1600.0,
            young_pa: 5e5,
            poisson: 0.3,
            friction_angle_deg: 33.0,
            friction: 0.5,
        }
    }
}

/// Least principal stretch, which keeps logarithms finite.
pub(crate) const STRETCH_MIN: f32 = 0.05;

impl Sand {
    pub(super) fn validate(&self) -> Result<()> {
        check_elasticity(self.young_pa, self.poisson)?;
        let angle_deg = self.friction_angle_deg.into();
        check_range("angle of friction in degrees", angle_deg, 0.0, 60.0)
    }

    pub(crate) fn lame(&self) -> Lame {
        Lame::new(self.young_pa, self.poisson)
    }

    /// Slope α of the yield surface. It touches that of Mohr and Coulomb in plane strain at constant
    /// volume, the state of sand that flows down a slope. Klár et al. fit triaxial compression instead:
    /// slopes then stand at 50° for a friction angle of 33°.
    fn yield_slope(&self) -> f32 {
        std::f32::consts::SQRT_2 / 3.0 * self.friction_angle_deg.to_radians().sin()
    }

    /// Norm of the deviator of the logarithmic strains over their negative trace on the yield surface.
    pub(crate) fn yield_factor(&self) -> f32 {
        let Lame { lambda, mu } = self.lame();
        (3.0 * lambda + 2.0 * mu) / (2.0 * mu) * self.yield_slope()
    }

    /// The state is the logarithm of the volume gained in tension, which later compression must undo first.
    #[inline(always)]
    pub(super) fn advance<S: Simd>(
        &self,
        simd: S,
        strain: &mut Strain<S>,
    ) -> (Stress<S>, Lanes<S>) {
        let lame = self.lame();
        let parts = Stretches::new(simd, &strain.trial());
        let logarithms = each(
            #[inline(always)]
            |i| ln(parts.sigma[i].max(STRETCH_MIN)),
        );
        let returned = self.return_map(simd, logarithms, strain.state);
        let volume = |e: [Lanes<S>; 3]| e[0] + e[1] + e[2];
        strain.state = strain.state + volume(logarithms) - volume(returned);
        strain.deformation = parts.u.scale_columns(each(
            #[inline(always)]
            |i| exp(returned[i]),
        ));
        let pressure = volume(returned) * lame.lambda;
        let values = each(
            #[inline(always)]
            |i| (returned[i] * (2.0 * lame.mu)) + pressure,
        );
        let stress = principal_stress(&parts.u, values);
        (stress, Lanes::splat(simd, 1.0))
    }

    /// Projects logarithmic strains, corrected by the volume gained, onto the yield surface: Klár et al.,
    /// section 7.3.
    #[inline(always)]
    fn return_map<S: Simd>(
        &self,
        simd: S,
        logarithms: [Lanes<S>; 3],
        gained: Lanes<S>,
    ) -> [Lanes<S>; 3] {
        let corrected = each(
            #[inline(always)]
            |i| gained * (1.0 / 3.0) + logarithms[i],
        );
        let trace = corrected[0] + corrected[1] + corrected[2];
        let deviator = each(
            #[inline(always)]
            |i| corrected[i] - trace * (1.0 / 3.0),
        );
        let length = dot(deviator, deviator).sqrt();
        let excess = trace.mul_add(Lanes::splat(simd, self.yield_factor()), length);
        let is_elastic = excess.simd_le(0.0);
        // Expansion is projected to the cone's tip: without cohesion there is no tension.
        let is_apart = trace.simd_ge(0.0);
        let ratio = excess / length.max(f32::MIN_POSITIVE);
        let zero = Lanes::splat(simd, 0.0);
        each(
            #[inline(always)]
            |i| {
                let on_surface = corrected[i] - ratio * deviator[i];
                let yielded = is_elastic.select(corrected[i], on_surface);
                is_apart.select(zero, yielded)
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};

    use super::*;
    use crate::lanes::LANES;

    #[inline(always)]
    fn returned<S: Simd>(simd: S, sand: &Sand, strains: [[f32; LANES]; 3]) -> [[f32; LANES]; 3] {
        let strains = strains.map(|e| Lanes::load_array(simd, e));
        let zero = Lanes::splat(simd, 0.0);
        sand.return_map(simd, strains, zero).map(Into::into)
    }

    #[test]
    fn returned_strains_lie_on_or_inside_the_yield_surface() {
        let sand = Sand::default();
        let Lame { lambda, mu } = sand.lame();
        for step in 0..200 {
            let angle = step as f32 * 0.1;
            let strains: [[f32; LANES]; 3] = std::array::from_fn(|axis| {
                std::array::from_fn(|lane| {
                    0.01 * (angle * (axis + 1) as f32).sin() - 0.002 * lane as f32 + 0.01
                })
            });
            let out = dispatch!(Level::new(), simd => returned(simd, &sand, strains));
            let [first, second, third] = out;
            for (a, (b, c)) in first.into_iter().zip(second.into_iter().zip(third)) {
                let e = [a, b, c];
                let trace: f32 = e.iter().sum();
                let deviator = e.map(|e| e - trace / 3.0);
                let shear = 2.0 * mu * deviator.iter().map(|d| d * d).sum::<f32>().sqrt();
                let pressure = -(3.0 * lambda + 2.0 * mu) * trace;
                let excess = shear - sand.yield_slope() * pressure;
                assert!(excess < 1e-3 * mu * 0.01, "{e:?} is outside by {excess} Pa");
            }
        }
    }
}
