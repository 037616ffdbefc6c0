//! Snow by elastoplasticity that hardens under compression and softens as it breaks.

use fearless_simd::prelude::*;

use super::{Lame, Strain, Stress, check_elasticity, fixed_corotated};
use crate::error::{Result, check_range};
use crate::lanes::{Lanes, each, exp};
use crate::svd::Stretches;

/// Snow of Stomakhin et al. 2013, "A material point method for snow simulation": stretches past
/// critical ones become plastic, and stiffness grows with `exp(ξ (1 − Jp))`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Snow {
    /// Density before compaction, in kg/m³; default 400.
    pub density_kg_m3: f32,
    /// Young's modulus before compaction, in Pa; default 1.4e5.
    pub young_pa: f32,
    /// Poisson's ratio, 0 to 0.49; default 0.2.
    pub poisson: f32,
    /// Critical compression θc, 0 to 0.5; default 0.025: chunky below, powdery above.
    pub compression_critical: f32,
    /// Critical stretch θs, 0 to 0.5; default 0.0075.
    pub stretch_critical: f32,
    /// Hardening ξ, 0 to 20; default 10: brittle above, ductile below.
    pub hardening: f32,
    /// Coefficient of Coulomb friction on balls and obstacles; default 0.3.
    pub friction: f32,
}

impl Default for Snow {
    fn default() -> Self {
        Self {
            density_kg_m3: 400.0,
            young_pa: 1.4e5,
            poisson: 0.2,
            compression_critical: 0.025,
            stretch_critical: 0.0075,
            hardening: 10.0,
            friction: 0.3,
        }
    }
}

/// Bounds of the plastic volume Jp: the lower one limits stiffening to a factor of e⁴ at ξ = 10.
pub(crate) const PLASTIC_VOLUME: [f32; 2] = [0.6, 4.0];

impl Snow {
    pub(super) fn validate(&self) -> Result<()> {
        check_elasticity(self.young_pa, self.poisson)?;
        check_range(
            "critical compression",
            self.compression_critical.into(),
            0.0,
            0.5,
        )?;
        check_range("critical stretch", self.stretch_critical.into(), 0.0, 0.5)?;
        check_range("hardening", self.hardening.into(), 0.0, 20.0)
    }

    pub(crate) fn lame(&self) -> Lame {
        Lame::new(self.young_pa, self.poisson)
    }

    /// Least and greatest elastic stretch.
    pub(crate) fn critical_stretches(&self) -> [f32; 2] {
        [1.0 - self.compression_critical, 1.0 + self.stretch_critical]
    }

    /// The state is Jp, the determinant of the plastic part of the deformation gradient.
    #[inline(always)]
    pub(super) fn advance<S: Simd>(
        &self,
        simd: S,
        strain: &mut Strain<S>,
    ) -> (Stress<S>, Lanes<S>) {
        let parts = Stretches::new(simd, &strain.trial());
        let [low, high] = self.critical_stretches();
        let sigma = each(
            #[inline(always)]
            |i| parts.sigma[i].max(low).min(high),
        );
        let product = |s: [Lanes<S>; 3]| s[0] * s[1] * s[2];
        // The total volume, elastic times plastic, is preserved: what the clamp removes from the elastic
        // part goes into the plastic one.
        let plastic = strain.state * product(parts.sigma) / product(sigma);
        strain.state = plastic.max(PLASTIC_VOLUME[0]).min(PLASTIC_VOLUME[1]);
        strain.deformation = parts.u.scale_columns(sigma);
        let hardness = exp((Lanes::splat(simd, 1.0) - strain.state) * self.hardening);
        let Lame { lambda, mu } = self.lame();
        let stress = fixed_corotated(&parts.u, sigma, (hardness * lambda, hardness * mu));
        // The speed of sound is proportional to the square root of the stiffness.
        (stress, hardness.sqrt().max(1.0))
    }
}
