//! rapier's soft bodies for comparison with the jelly: a cube of tetrahedra with as many particles,
//! stiffness and density.

use carom_mpm::{Jelly, Settings};
use carom_tracer::glam::DVec3;
use cpu_time::ProcessTime;
use rapier3d::prelude::{
    ColliderBuilder, PhysicsWorld, SoftBodyBuilder, SoftBodyCellModel, SoftBodyMaterial,
};

/// CPU time of a particle in ns.
pub(super) struct CpuCost {
    /// Per substep.
    pub(super) ns: f64,
    /// Per simulated second.
    pub(super) ns_simulated_sec: f64,
}

/// CPU time of a cube that falls onto a floor, `edge` cells of the material point method wide, with two
/// particles per cell along each axis. rapier makes 240 steps a second and solves elasticity as
/// constraints (corotational cells).
pub(super) fn time(edge: u16) -> CpuCost {
    let cell = f64::from(Settings::default().cell_size_m);
    let jelly = Jelly::default();
    let width = f64::from(edge) * cell;
    let along = 2 * usize::from(edge);
    let material = SoftBodyMaterial {
        young_modulus: jelly.young_pa.into(),
        poisson_ratio: jelly.poisson.into(),
        ..SoftBodyMaterial::default()
    };
    let mut world = PhysicsWorld {
        gravity: -9.81 * DVec3::Z,
        ..PhysicsWorld::default()
    };
    world.integration_parameters.dt = STEP_SECS;
    let floor = ColliderBuilder::cuboid(10.0 * width, 10.0 * width, width);
    world.insert_collider(floor.translation(-2.0 * width * DVec3::Z), None);
    let cube = SoftBodyBuilder::cuboid(DVec3::ZERO, DVec3::splat(width / 2.0), along, along, along);
    let mass = f64::from(jelly.density_kg_m3) * width.powi(3);
    let cube = cube.mass(mass).material(material);
    world.insert_soft_body(cube.cell_model(SoftBodyCellModel::Corotational));
    let particles = along.pow(3);
    for _ in 0..WARM_UP_STEPS {
        world.step();
    }
    let start = ProcessTime::now();
    let mut steps = 0_u32;
    while steps < STEPS_MIN || start.elapsed().as_secs_f64() < CPU_SECS_MIN {
        world.step();
        steps += 1;
    }
    let particle_ns = start.elapsed().as_secs_f64() * 1e9 / particles as f64;
    let ns = particle_ns / f64::from(steps);
    println!("rapier    {particles:9}  {steps:8}  {:>9}  {ns:.1}", "-");
    CpuCost {
        ns,
        ns_simulated_sec: ns / STEP_SECS,
    }
}

const STEP_SECS: f64 = 1.0 / 240.0;
const WARM_UP_STEPS: u32 = 5;
const STEPS_MIN: u32 = 10;
const CPU_SECS_MIN: f64 = 2.0;
