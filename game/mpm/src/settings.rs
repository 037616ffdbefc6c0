//! Settings of a simulation.

use glam::Vec3;

use crate::error::{Result, check_finite, check_range};

/// Settings of a simulation, fixed at its construction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Edge of a grid cell, in m, 1e-5 to 10; default 0.01. Half of it costs 16 times the time:
    /// 8 times the particles and twice the substeps.
    pub cell_size_m: f32,
    /// Particles along the edge of a cell that `fill` places, 1 to 4; default 2, which is 8 a cell. Fewer
    /// leave holes when the material stretches to twice its length; 3 take 3.4 times as long.
    pub particles_per_edge: u32,
    /// Acceleration of gravity, in m/s²; default 9.81 down.
    pub gravity: Vec3,
    /// Courant number: longest substep in units of cell size over speed of sound, 0.001 to 1; default 0.5.
    /// Stable up to 1.0 (1.7 is not); time grows in inverse proportion.
    pub courant: f32,
    /// Speed below which particles count as resting, in m/s; default 0.002. When all have rested for
    /// [`REST_SECS`] they sleep: steps cost nothing and change no bit. With 0 they never sleep.
    pub rest_speed_m_s: f32,
    /// Largest number of substeps of one step; default 10,000.
    pub substeps_max: u32,
}

/// Time for which every particle must be slower than [`Settings::rest_speed_m_s`] before all sleep, in s:
/// longer than sloshing or bouncing material is slow at a turning point.
pub const REST_SECS: f64 = 0.25;

/// Largest number of particles of one simulation: a particle's id fits 32 bits with room.
pub const PARTICLES_MAX: usize = 1 << 27;

impl Default for Settings {
    fn default() -> Self {
        Self {
            cell_size_m: 0.01,
            particles_per_edge: 2,
            gravity: Vec3::new(0.0, 0.0, -9.81),
            courant: 0.5,
            rest_speed_m_s: 0.002,
            substeps_max: 10_000,
        }
    }
}

impl Settings {
    pub(crate) fn validate(&self) -> Result<()> {
        check_range("cell size in m", self.cell_size_m.into(), 1e-5, 10.0)?;
        check_range(
            "number of particles along a cell's edge",
            self.particles_per_edge.into(),
            1.0,
            4.0,
        )?;
        check_finite("acceleration of free fall", self.gravity)?;
        check_range("Courant number", self.courant.into(), 1e-3, 1.0)?;
        check_range("speed of rest in m/s", self.rest_speed_m_s.into(), 0.0, 1e3)?;
        check_range("most substeps", self.substeps_max.into(), 1.0, 1e9)
    }

    /// Distance between neighbouring particles that `fill` places, in m.
    pub(crate) fn spacing_m(&self) -> f32 {
        self.cell_size_m / self.particles_per_edge as f32
    }
}
