//! Totals: mass, momenta and energy of all particles.

use glam::{DVec3, Vec3};

/// Sums over all particles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Totals {
    /// In kg.
    pub mass_kg: f64,
    /// In kg·m/s.
    pub momentum: DVec3,
    /// About the origin, with the particles' affine motion, in kg·m²/s.
    pub angular_momentum: DVec3,
    /// With the particles' affine motion, in J.
    pub kinetic_energy_j: f64,
}

impl Totals {
    /// Adds a particle. Its affine motion counts as that of mass spread by the kernel, whose second
    /// moment is a quarter of a cell's edge squared: Jiang et al. 2015, section 5.3.
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
