//! Weakly compressible water by Tait's equation of state.

use fearless_simd::prelude::*;

use super::jelly::add_viscosity;
use super::{Strain, Stress};
use crate::error::{Result, check_range};
use crate::lanes::Lanes;

/// A liquid with `p = ρ₀c²/γ (J^−γ − 1)`, γ = 7 (Tait 1888; Monaghan 1994, "Simulating free
/// surface flows with SPH"), J the volume over that at rest. It carries no tension.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Water {
    /// Density at rest, in kg/m³; default 1,000.
    pub density_kg_m3: f32,
    /// Numerical speed of sound, in m/s; default 20. Ten times the fastest flow keeps the density
    /// within 1 %; substeps are inversely proportional to it.
    pub sound_speed_m_s: f32,
    /// Dynamic viscosity, in Pa·s; default 0.001.
    pub viscosity_pa_s: f32,
    /// Coefficient of Coulomb friction on balls and obstacles; default 0, frictionless.
    pub friction: f32,
}

impl Default for Water {
    fn default() -> Self {
        Self {
            density_kg_m3: 1000.0,
            sound_speed_m_s: 20.0,
            viscosity_pa_s: 1e-3,
            friction: 0.0,
        }
    }
}

/// Largest volume over that at rest. The bound limits the expansion that spray accumulates, so that it
/// resists compression soon after it gathers again.
pub(crate) const EXPANSION_MAX: f32 = 1.1;

/// Least volume over that at rest, which prevents overflow of its powers.
pub(crate) const EXPANSION_MIN: f32 = 0.2;

impl Water {
    pub(super) fn validate(&self) -> Result<()> {
        check_range(
            "speed of sound in m/s",
            self.sound_speed_m_s.into(),
            1e-3,
            1e4,
        )?;
        check_range("viscosity in Pa·s", self.viscosity_pa_s.into(), 0.0, 1e6)
    }

    /// Factor of the equation of state, `ρ₀c²/γ`, in Pa.
    pub(crate) fn stiffness_pa(&self) -> f32 {
        self.density_kg_m3 * self.sound_speed_m_s * self.sound_speed_m_s / 7.0
    }

    /// The state is J.
    #[inline(always)]
    pub(super) fn advance<S: Simd>(
        &self,
        simd: S,
        strain: &mut Strain<S>,
    ) -> (Stress<S>, Lanes<S>) {
        // dJ/dt = J ∇·v; the deviatoric part of the deformation, which grows without bound in a flow, is
        // not stored.
        let j = strain.state.mul_add(strain.increment.trace(), strain.state);
        let j = j.max(EXPANSION_MIN).min(EXPANSION_MAX);
        strain.state = j;
        let (pressure, cube) = self.pressure(j);
        let kirchhoff = -(pressure * j);
        let zero = Lanes::splat(simd, 0.0);
        let mut stress = [kirchhoff, kirchhoff, kirchhoff, zero, zero, zero];
        add_viscosity(
            &mut stress,
            &strain.increment,
            self.viscosity_pa_s / strain.dt,
        );
        // c² = dp/dρ is proportional to J⁻⁶, so the speed of sound to J⁻³.
        (stress, cube.max(1.0))
    }

    /// Pressure in Pa, without tension, and J⁻³.
    #[inline(always)]
    fn pressure<S: Simd>(&self, j: Lanes<S>) -> (Lanes<S>, Lanes<S>) {
        let one = Lanes::splat(j.simd, 1.0);
        let inverse = one / j;
        let cube = inverse * inverse * inverse;
        let pressure = (cube * cube).mul_add(inverse, -one) * self.stiffness_pa();
        (pressure.max(0.0), cube)
    }
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};
    use glam::{DVec3, Vec3};

    use super::*;
    use crate::lanes::LANES;
    use crate::material::Material;
    use crate::packet::Packet;
    use crate::{Bodies, Obstacle, Region, Settings, Simulation};

    #[inline(always)]
    fn pressures<S: Simd>(simd: S, water: &Water, packet: &Packet) -> [f32; LANES] {
        let (pressure, _) = water.pressure(Lanes::load_array_ref(simd, &packet.state));
        pressure.into()
    }

    #[test]
    fn pressure_of_a_column_is_its_weight_above() {
        let cell = 0.01;
        let water = Water {
            viscosity_pa_s: 0.5,
            ..Water::default()
        };
        let settings = Settings {
            cell_size_m: cell,
            rest_speed_m_s: 0.0,
            ..Settings::default()
        };
        let mut simulation = Simulation::new(settings).expect("valid");
        let max = Vec3::new(4.0 * cell, 4.0 * cell, 20.0 * cell);
        let region = Region::Cuboid {
            min: Vec3::ZERO,
            max,
        };
        simulation
            .fill(&region, Material::Water(water), Vec3::ZERO)
            .expect("valid");
        let far = DVec3::new(max.x.into(), max.y.into(), 1.0);
        let obstacles = Obstacle::walls(DVec3::ZERO, far);
        let mut bodies = Bodies {
            obstacles,
            ..Bodies::default()
        };
        simulation.step(0.6, &mut bodies).expect("stable");
        // Pressure and height of layers four cells deep, as means over particles and a vibration.
        let mut layers = [(0.0_f64, 0.0_f64, 0.0_f64); 5];
        for _ in 0..40 {
            simulation.step(0.01, &mut bodies).expect("stable");
            let storage = simulation.storage();
            for block in &storage.blocks {
                for packet in &block.packets {
                    let p = dispatch!(Level::new(), simd => pressures(simd, &water, packet));
                    for (lane, p) in p.iter().enumerate().take(packet.len) {
                        let z = storage
                            .position_m(block.coordinate, packet.position[lane])
                            .z;
                        let layer = &mut layers[((z / 0.04) as usize).min(4)];
                        *layer = (layer.0 + f64::from(*p), layer.1 + z, layer.2 + 1.0);
                    }
                }
            }
        }
        for (pressure, height, count) in layers {
            let exact = 1000.0 * 9.81 * (0.2 - height / count);
            let error = pressure / count - exact;
            assert!(
                error.abs() < 0.03 * 1000.0 * 9.81 * 0.2,
                "{exact} Pa: off by {error} Pa"
            );
        }
    }
}
