//! Laws of the simulation: conservation, elasticity, liquids, grains, and balls among them.

mod balls;
mod conservation;
mod dust;
mod elastic;
mod grains;
mod marbles;
mod water;

use carom_mpm::{Bodies, Material, Region, Settings, Simulation};
use glam::Vec3;

/// Settings without gravity and sleep.
fn weightless(cell_size_m: f32) -> Settings {
    Settings {
        cell_size_m,
        gravity: Vec3::ZERO,
        rest_speed_m_s: 0.0,
        ..Settings::default()
    }
}

/// Settings with gravity that never sleep.
fn heavy(cell_size_m: f32) -> Settings {
    Settings {
        cell_size_m,
        rest_speed_m_s: 0.0,
        ..Settings::default()
    }
}

/// A box of a material at rest.
fn cuboid(settings: Settings, min: Vec3, max: Vec3, material: Material) -> Simulation {
    let mut simulation = Simulation::new(settings).expect("valid settings");
    let region = Region::Cuboid { min, max };
    simulation
        .fill(&region, material, Vec3::ZERO)
        .expect("a valid region");
    simulation
}

fn step(simulation: &mut Simulation, duration_secs: f64, bodies: &mut Bodies) {
    simulation
        .step(duration_secs, bodies)
        .expect("a stable step");
}
