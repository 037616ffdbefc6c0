//! Total mass, momenta and energy of all particles.

use glam::{DVec3, Vec3};

/// Conserved quantities, summed over all particles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Totals {
    /// Mass, in kg.
    pub mass_kg: f64,
    /// Momentum, in kg·m/s.
    pub momentum: DVec3,
    /// Angular momentum about the origin, with that of the particles' affine motion, in kg·m²/s.
    pub angular_momentum: DVec3,
    /// Kinetic energy, with that of the particles' affine motion, in J.
    pub kinetic_energy_j: f64,
}

impl Totals {
    /// Adds a particle. Its affine motion, columns in m/s a cell, counts as that of mass distributed by the
    /// kernel, whose second moment is a quarter of a cell's edge squared: Jiang et al. 2015, section 5.3.
    pub(crate) fn add(
        &mut self,
        mass_kg: f32,
        position: DVec3,
        velocity: Vec3,
        affine: [DVec3; 3],
        cell_size_m: f64,
    ) {
        let mass_kg = f64::from(mass_kg);
        let velocity = velocity.as_dvec3();
        let [x, y, z] = affine;
        let turn = DVec3::new(y.z - z.y, z.x - x.z, x.y - y.x);
        let square = x.length_squared() + y.length_squared() + z.length_squared();
        self.mass_kg += mass_kg;
        self.momentum += mass_kg * velocity;
        self.angular_momentum += mass_kg * (position.cross(velocity) + turn * (cell_size_m / 4.0));
        self.kinetic_energy_j += 0.5 * mass_kg * (velocity.length_squared() + square / 4.0);
    }
}
