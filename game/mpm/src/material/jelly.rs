//! Elastic jelly by the fixed corotated model.

use fearless_simd::prelude::*;

use super::{Lame, Strain, Stress, check_elasticity, fixed_corotated};
use crate::error::{Result, check_range};
use crate::lanes::{Lanes, Mat3x};
use crate::svd::Stretches;

/// An elastic solid: fixed corotated elasticity (Stomakhin et al. 2012), whose stress is finite for
/// flat and inverted elements, with Kelvin–Voigt viscosity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jelly {
    /// Density at rest, in kg/m³; default 1,000.
    pub density_kg_m3: f32,
    /// Young's modulus, in Pa; default 1e5. Substeps are inversely proportional to its square root.
    pub young_pa: f32,
    /// Poisson's ratio, 0 to 0.49; default 0.3. Near the upper end substeps become short.
    pub poisson: f32,
    /// Viscosity, which damps vibrations, in Pa·s; default 0, with the numerical damping of the transfers
    /// only.
    pub viscosity_pa_s: f32,
    /// Coefficient of Coulomb friction on balls and obstacles; default 0.5.
    pub friction: f32,
}

impl Default for Jelly {
    fn default() -> Self {
        Self {
            density_kg_m3: 1000.0,
            young_pa: 1e5,
            poisson: 0.3,
            viscosity_pa_s: 0.0,
            friction: 0.5,
        }
    }
}

impl Jelly {
    pub(super) fn validate(&self) -> Result<()> {
        check_elasticity(self.young_pa, self.poisson)?;
        check_range("viscosity in Pa·s", self.viscosity_pa_s.into(), 0.0, 1e6)
    }

    pub(crate) fn lame(&self) -> Lame {
        Lame::new(self.young_pa, self.poisson)
    }

    #[inline(always)]
    pub(super) fn advance<S: Simd>(
        &self,
        simd: S,
        strain: &mut Strain<S>,
    ) -> (Stress<S>, Lanes<S>) {
        let parts = Stretches::new(simd, &strain.trial());
        strain.deformation = parts.deformation;
        let sigma = parts.signed_sigma();
        let lame = self.lame();
        let lame = (Lanes::splat(simd, lame.lambda), Lanes::splat(simd, lame.mu));
        let mut stress = fixed_corotated(&parts.u, sigma, lame);
        add_viscosity(
            &mut stress,
            &strain.increment,
            self.viscosity_pa_s / strain.dt,
        );
        let [a, b, c] = parts.sigma;
        // The wave speed along principal axis i is √((2μ σᵢ² + λ J²)/ρ₀): at most max(σᵢ, J) times that at
        // rest.
        (stress, a.max(b).max(c).max(a * b * c).max(1.0))
    }
}

/// Adds the viscous stress `2 η D` with D the symmetric part of the velocity gradient, which is given times
/// the substep, as the viscosity is given over it.
#[inline(always)]
pub(super) fn add_viscosity<S: Simd>(
    stress: &mut Stress<S>,
    increment: &Mat3x<S>,
    viscosity_over_dt: f32,
) {
    if viscosity_over_dt == 0.0 {
        return;
    }
    let pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
    for (entry, (i, j)) in stress.iter_mut().zip(pairs) {
        *entry += (increment.0[i][j] + increment.0[j][i]) * viscosity_over_dt;
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::material::Material;
    use crate::{Bodies, Region, Settings, Simulation};

    #[test]
    fn inverted_elements_stay_bounded() {
        let gravity = Vec3::ZERO;
        let settings = Settings {
            gravity,
            rest_speed_m_s: 0.0,
            ..Settings::default()
        };
        let mut simulation = Simulation::new(settings).expect("valid");
        let region = Region::Cuboid {
            min: Vec3::ZERO,
            max: Vec3::splat(0.06),
        };
        let jelly = Jelly {
            viscosity_pa_s: 2.0,
            ..Jelly::default()
        };
        simulation
            .fill(&region, Material::Jelly(jelly), Vec3::ZERO)
            .expect("valid");
        let packets = |simulation: &mut Simulation, call: &mut dyn FnMut(&mut [f32], usize)| {
            for block in &mut simulation.storage_mut().blocks {
                for packet in &mut block.packets {
                    for lane in 0..packet.len {
                        let mut entries = packet.deformation.map(|entry| entry[lane]);
                        call(&mut entries, packet.id[lane] as usize);
                        for (entry, value) in packet.deformation.iter_mut().zip(entries) {
                            entry[lane] = value;
                        }
                    }
                }
            }
        };
        packets(&mut simulation, &mut |entries, id| {
            if id % 5 == 0 {
                entries[4 * (id % 3)] = -0.3;
            }
        });
        for _ in 0..50 {
            simulation
                .step(0.01, &mut Bodies::default())
                .expect("stable");
        }
        let mut largest = 0.0_f32;
        packets(&mut simulation, &mut |entries, _| {
            largest = entries
                .iter()
                .fold(largest, |max, entry| max.max(entry.abs()));
        });
        assert!(largest < 1.5, "{largest}");
        let speeds = simulation.particles().map(|p| p.velocity.length());
        let fastest = speeds.fold(0.0, f32::max);
        assert!(fastest < 0.05, "{fastest} m/s");
    }
}
