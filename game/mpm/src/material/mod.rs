//! Materials: constitutive models, one in each file, and their common parts.

mod jelly;
mod sand;
mod snow;
mod water;

use fearless_simd::prelude::*;

pub use jelly::Jelly;
pub use sand::Sand;
pub use snow::Snow;
pub use water::Water;
#[cfg(feature = "gpu")]
pub(crate) use {
    sand::STRETCH_MIN,
    snow::PLASTIC_VOLUME,
    water::{EXPANSION_MAX, EXPANSION_MIN},
};

use crate::error::{Result, check_range};
use crate::lanes::{Lanes, Mat3x, dot, each};

/// Material of particles, with its parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Material {
    /// An elastic solid.
    Jelly(Jelly),
    /// A weakly compressible liquid.
    Water(Water),
    /// A dry granular material.
    Sand(Sand),
    /// Snow that hardens under compression and breaks.
    Snow(Snow),
}

/// Deformation of a packet of particles over a substep, the input of a constitutive model.
pub(crate) struct Strain<S: Simd> {
    /// Elastic part of the deformation gradient up to a rotation from the right, on which isotropic stress
    /// does not depend; before the substep, then after it.
    pub(crate) deformation: Mat3x<S>,
    /// State variable of the model; see each.
    pub(crate) state: Lanes<S>,
    /// Velocity gradient times the substep.
    pub(crate) increment: Mat3x<S>,
    /// Duration of the substep, in s.
    pub(crate) dt: f32,
}

/// Symmetric Kirchhoff stress `τ = J σ` in Pa, as xx, yy, zz, xy, xz, yz.
pub(crate) type Stress<S> = [Lanes<S>; 6];

impl Material {
    /// Density at rest, in kg/m³.
    pub fn density_kg_m3(&self) -> f32 {
        match self {
            Self::Jelly(jelly) => jelly.density_kg_m3,
            Self::Water(water) => water.density_kg_m3,
            Self::Sand(sand) => sand.density_kg_m3,
            Self::Snow(snow) => snow.density_kg_m3,
        }
    }

    /// Speed of sound at rest, in m/s, which bounds the substep: a cell over it at a Courant number of 1.
    pub fn sound_speed_m_s(&self) -> f32 {
        match self {
            Self::Jelly(jelly) => sound_speed(jelly.lame(), jelly.density_kg_m3),
            Self::Water(water) => water.sound_speed_m_s,
            Self::Sand(sand) => sound_speed(sand.lame(), sand.density_kg_m3),
            Self::Snow(snow) => sound_speed(snow.lame(), snow.density_kg_m3),
        }
    }

    /// Coefficient of Coulomb friction on balls and obstacles; 0 is frictionless.
    pub fn friction(&self) -> f32 {
        match self {
            Self::Jelly(jelly) => jelly.friction,
            Self::Water(water) => water.friction,
            Self::Sand(sand) => sand.friction,
            Self::Snow(snow) => snow.friction,
        }
    }

    pub(crate) fn validate(&self) -> Result<()> {
        check_range("density in kg/m³", self.density_kg_m3().into(), 1e-3, 1e5)?;
        check_range("coefficient of friction", self.friction().into(), 0.0, 10.0)?;
        match self {
            Self::Jelly(jelly) => jelly.validate(),
            Self::Water(water) => water.validate(),
            Self::Sand(sand) => sand.validate(),
            Self::Snow(snow) => snow.validate(),
        }
    }

    /// State variable of an undeformed particle.
    pub(crate) fn state_at_rest(&self) -> f32 {
        match self {
            Self::Jelly(_) | Self::Sand(_) => 0.0,
            Self::Water(_) | Self::Snow(_) => 1.0,
        }
    }

    /// Advances the deformation of a packet, and returns its stress and its speed of sound over that at
    /// rest, 1 or more.
    #[inline(always)]
    pub(crate) fn advance<S: Simd>(
        &self,
        simd: S,
        strain: &mut Strain<S>,
    ) -> (Stress<S>, Lanes<S>) {
        match self {
            Self::Jelly(jelly) => jelly.advance(simd, strain),
            Self::Water(water) => water.advance(simd, strain),
            Self::Sand(sand) => sand.advance(simd, strain),
            Self::Snow(snow) => snow.advance(simd, strain),
        }
    }
}

impl<S: Simd> Strain<S> {
    /// Trial deformation of the substep, `(I + dt ∇v) F`.
    #[inline(always)]
    fn trial(&self) -> Mat3x<S> {
        let moved = self.increment.mul(&self.deformation);
        Mat3x::from_fn(
            #[inline(always)]
            |i, j| self.deformation.0[i][j] + moved.0[i][j],
        )
    }
}

/// Lamé parameters λ and μ, in Pa.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lame {
    pub(crate) lambda: f32,
    pub(crate) mu: f32,
}

impl Lame {
    /// Converts Young's modulus in Pa and Poisson's ratio.
    fn new(young_pa: f32, poisson: f32) -> Self {
        Self {
            lambda: young_pa * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)),
            mu: young_pa / (2.0 * (1.0 + poisson)),
        }
    }
}

fn check_elasticity(young_pa: f32, poisson: f32) -> Result<()> {
    check_range("Young's modulus in Pa", young_pa.into(), 1.0, 1e12)?;
    check_range("Poisson's ratio", poisson.into(), 0.0, 0.49)
}

/// Speed of longitudinal waves, in m/s.
fn sound_speed(lame: Lame, density_kg_m3: f32) -> f32 {
    ((lame.lambda + 2.0 * lame.mu) / density_kg_m3).sqrt()
}

/// Kirchhoff stress of the fixed corotated model (Stomakhin et al. 2012, "Energetically consistent
/// invertible elasticity"): `τ = 2μ (F − R) Fᵀ + λ (J − 1) J I`, in principal values
/// `τᵢ = 2μ σᵢ (σᵢ − 1) + λ (J − 1) J` along the columns of U.
#[inline(always)]
fn fixed_corotated<S: Simd>(
    u: &Mat3x<S>,
    sigma: [Lanes<S>; 3],
    (lambda, mu): (Lanes<S>, Lanes<S>),
) -> Stress<S> {
    let j = sigma[0] * sigma[1] * sigma[2];
    let pressure = lambda * (j - 1.0) * j;
    let values = each(
        #[inline(always)]
        |i| (mu * 2.0 * sigma[i]).mul_add(sigma[i] - 1.0, pressure),
    );
    principal_stress(u, values)
}

/// Symmetric tensor `U diag(values) Uᵀ` of principal values along the columns of U.
#[inline(always)]
fn principal_stress<S: Simd>(u: &Mat3x<S>, values: [Lanes<S>; 3]) -> Stress<S> {
    let scaled = u.scale_columns(values);
    let [a, b, c] = scaled.0;
    let [x, y, z] = u.0;
    [
        dot(a, x),
        dot(b, y),
        dot(c, z),
        dot(a, y),
        dot(a, z),
        dot(b, z),
    ]
}
