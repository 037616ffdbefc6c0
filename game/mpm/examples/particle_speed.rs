//! CPU time of a particle over a substep, for each material: a cube that falls and spreads in a box.
//!
//! The argument is the cube's edge in cells, 16 unless told: 32,768 particles; 50 are a million.

use carom_mpm::{
    Bodies, Jelly, Material, Obstacle, Region, Sand, Settings, Simulation, Snow, Water,
};
use cpu_time::ProcessTime;
use glam::{DVec3, Vec3};

/// Particle-steps to time a material by.
const PARTICLE_STEPS: u64 = 25_000_000;

fn main() -> Result<(), carom_mpm::Error> {
    let edge: f32 = std::env::args()
        .nth(1)
        .and_then(|text| text.parse().ok())
        .unwrap_or(16.0);
    println!("material  particles  substeps  orderings  ns CPU a particle and substep");
    for (name, material) in [
        ("jelly", Material::Jelly(Jelly::default())),
        ("water", Material::Water(Water::default())),
        ("sand", Material::Sand(Sand::default())),
        ("snow", Material::Snow(Snow::default())),
    ] {
        let settings = Settings {
            rest_speed_m_s: 0.0,
            ..Settings::default()
        };
        let mut simulation = Simulation::new(settings)?;
        let width = edge * settings.cell_size_m;
        let region = Region::Cuboid {
            min: Vec3::ZERO,
            max: Vec3::splat(width),
        };
        let particles = simulation.fill(&region, material, Vec3::ZERO)?;
        let far = DVec3::new(2.0, 1.0, 2.0) * f64::from(width);
        let obstacles = Obstacle::walls(DVec3::ZERO, far);
        let mut bodies = Bodies {
            obstacles,
            ..Bodies::default()
        };
        simulation.step(0.02, &mut bodies)?;
        let start = ProcessTime::now();
        let (mut substeps, mut orderings) = (0, 0);
        while u64::from(substeps) * (particles as u64) < PARTICLE_STEPS {
            let report = simulation.step(0.01, &mut bodies)?;
            substeps += report.substeps;
            orderings += report.orderings;
        }
        let spent = start.elapsed().as_secs_f64();
        let each_ns = spent * 1e9 / particles as f64 / f64::from(substeps);
        println!("{name:8}  {particles:9}  {substeps:8}  {orderings:9}  {each_ns:.1}");
    }
    Ok(())
}
