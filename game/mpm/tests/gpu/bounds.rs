//! Errors for requests beyond the limits.

use carom_mpm::{Ball, Bodies, Error, GPU_BALLS_MAX, GpuSimulation, Material, Simulation, Water};
use glam::{DVec3, Vec3};

use crate::{gpu, on_gpu, settings};

/// One particle of water.
fn lone(place: Vec3) -> Simulation {
    let mut simulation = Simulation::new(settings(Vec3::ZERO)).expect("valid");
    let water = Material::Water(Water::default());
    simulation
        .add(&[place], water, 1e-6, Vec3::ZERO)
        .expect("valid");
    simulation
}

#[test]
fn numbers_that_are_not_finite_are_refused() {
    let Some(gpu) = gpu() else { return };
    let mut simulation = on_gpu(gpu, &lone(Vec3::ZERO));
    let mut ball = Ball::new(DVec3::ZERO, 0.03, 0.17);
    ball.velocity.y = f64::NAN;
    let mut bodies = Bodies {
        balls: vec![ball],
        ..Bodies::default()
    };
    let refused = simulation.step(0.01, &mut bodies).expect_err("a NaN");
    assert!(matches!(refused, Error::NotFinite { .. }), "{refused}");
    let refused = simulation
        .step(f64::NAN, &mut Bodies::default())
        .expect_err("a NaN");
    assert!(matches!(refused, Error::OutOfRange { .. }), "{refused}");
    simulation
        .step(0.01, &mut Bodies::default())
        .expect("nothing was done");
}

#[test]
fn too_much_is_refused_with_the_limit() {
    let Some(gpu) = gpu() else { return };
    let mut bodies = Bodies {
        balls: vec![Ball::new(DVec3::ZERO, 0.03, 0.17); GPU_BALLS_MAX + 1],
        ..Bodies::default()
    };
    let mut simulation = on_gpu(gpu, &lone(Vec3::ZERO));
    let refused = simulation.step(0.01, &mut bodies).expect_err("too many");
    assert!(refused.to_string().contains("balls is 33"), "{refused}");
    // Two particles so far apart that no grid holds the box around them.
    let mut wide = lone(Vec3::ZERO);
    let water = Material::Water(Water::default());
    wide.add(&[Vec3::splat(1000.0)], water, 1e-6, Vec3::ZERO)
        .expect("valid");
    let refused = GpuSimulation::new(gpu, wide).err().expect("too wide");
    assert!(
        refused.to_string().contains("blocks of 4x4x4 cells"),
        "{refused}"
    );
    let empty = Simulation::new(settings(Vec3::ZERO)).expect("valid");
    let refused = GpuSimulation::new(gpu, empty).err().expect("empty");
    assert!(
        refused.to_string().contains("number of particles is 0"),
        "{refused}"
    );
}

#[test]
fn too_many_substeps_are_refused() {
    let Some(gpu) = gpu() else { return };
    let mut start = Simulation::new(carom_mpm::Settings {
        substeps_max: 10,
        ..settings(Vec3::ZERO)
    })
    .expect("valid");
    let water = Material::Water(Water::default());
    start
        .add(&[Vec3::ZERO], water, 1e-6, Vec3::ZERO)
        .expect("valid");
    let refused = on_gpu(gpu, &start)
        .step(1.0, &mut Bodies::default())
        .expect_err("too many");
    assert!(
        matches!(refused, Error::TooManySubsteps { .. }),
        "{refused}"
    );
}

#[test]
fn particles_of_one_cell_fly_apart() {
    let Some(gpu) = gpu() else { return };
    let mut start = Simulation::new(settings(Vec3::ZERO)).expect("valid");
    let places: Vec<_> = (0..400)
        .map(|i| Vec3::new((i % 8) as f32, (i / 8 % 8) as f32, (i / 64) as f32) * 1e-3)
        .collect();
    let water = Material::Water(Water::default());
    start
        .add(&places, water, 1e-6 / 8.0, Vec3::ZERO)
        .expect("valid");
    let mut simulation = on_gpu(gpu, &start);
    for _ in 0..5 {
        simulation
            .step(0.01, &mut Bodies::default())
            .expect("stable");
    }
    let before = start.totals();
    assert_eq!(
        simulation.download().expect("read back").totals().mass_kg,
        before.mass_kg
    );
}
