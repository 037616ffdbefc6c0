//! Conservation laws, and reproducibility of bits.

use carom_mpm::{
    Ball, Bodies, GpuSimulation, Jelly, Material, Obstacle, Region, Simulation, Totals,
};
use glam::{DVec3, Vec3};

use crate::{gpu, materials, on_gpu, settings, step_gpu};

/// Two boxes of a material that meet off centre in free flight.
fn meeting(material: Material) -> Simulation {
    let mut simulation = Simulation::new(settings(Vec3::ZERO)).expect("valid");
    for (min, velocity) in [
        (Vec3::ZERO, Vec3::new(1.0, 0.3, 0.0)),
        (Vec3::new(0.05, 0.015, 0.015), Vec3::new(-0.2, 0.0, 0.1)),
    ] {
        let max = min + 0.03;
        let region = Region::Cuboid { min, max };
        simulation.fill(&region, material, velocity).expect("valid");
    }
    simulation
}

fn totals(simulation: &GpuSimulation) -> Totals {
    simulation.download().expect("read back").totals()
}

#[test]
fn mass_and_momenta_are_kept() {
    for material in materials() {
        let Some(gpu) = gpu() else { return };
        let start = meeting(material);
        let before = start.totals();
        let mut simulation = on_gpu(gpu, &start);
        let mut substeps = 0;
        while substeps < 200 {
            let report = simulation
                .step(0.02, &mut Bodies::default())
                .expect("stable");
            substeps += report.substeps;
        }
        let after = totals(&simulation);
        let momentum = after.momentum.distance(before.momentum) / before.momentum.length();
        let angular = after.angular_momentum.distance(before.angular_momentum)
            / before.angular_momentum.length();
        println!("{material:?}: {momentum:e} {angular:e} in {substeps}");
        assert_eq!(after.mass_kg, before.mass_kg, "{material:?}");
        assert!(momentum < 2e-5, "{material:?}: {momentum:e}");
        assert!(angular < 3e-5, "{material:?}: {angular:e}");
    }
}

#[test]
fn momentum_of_particles_and_a_ball_is_kept() {
    let Some(gpu) = gpu() else { return };
    let mut start = Simulation::new(settings(Vec3::ZERO)).expect("valid");
    let max = Vec3::splat(0.06);
    let region = Region::Cuboid {
        min: Vec3::ZERO,
        max,
    };
    let jelly = Material::Jelly(Jelly::default());
    start.fill(&region, jelly, Vec3::ZERO).expect("valid");
    let mut ball = Ball::new(DVec3::new(-0.035, 0.035, 0.03), 0.028_575, 0.17);
    ball.velocity = DVec3::new(3.0, -0.5, 0.2);
    ball.angular_velocity = DVec3::new(0.0, 40.0, -30.0);
    let first = ball.mass_kg * ball.velocity;
    let mut bodies = Bodies {
        balls: vec![ball],
        ..Bodies::default()
    };
    let mut simulation = on_gpu(gpu, &start);
    let mut impulse = DVec3::ZERO;
    for _ in 0..5 {
        step_gpu(&mut simulation, 0.01, &mut bodies);
        impulse += bodies.balls[0].impulse;
    }
    let ball = bodies.balls[0];
    let sum = totals(&simulation).momentum + ball.mass_kg * ball.velocity;
    println!("{sum} {first} {impulse}");
    assert!(
        sum.distance(first) < 2e-5 * first.length(),
        "{sum}, not {first}"
    );
    let gained = ball.mass_kg * ball.velocity - first;
    assert!(
        gained.distance(impulse) < 1e-9 && gained.length() > 0.1,
        "{gained}, {impulse}"
    );
}

#[test]
fn same_run_gives_the_same_bits() {
    let run = || {
        let mut start = meeting(Material::Sand(carom_mpm::Sand::default()));
        let jelly = Material::Jelly(Jelly::default());
        let region = Region::Ball {
            center: Vec3::new(0.1, 0.1, 0.0),
            radius_m: 0.03,
        };
        start.fill(&region, jelly, -Vec3::Y).expect("valid");
        let ball = Ball::new(DVec3::new(0.1, 0.03, 0.03), 0.03, 0.17);
        let mut bodies = Bodies {
            balls: vec![ball],
            obstacles: vec![Obstacle::plane(DVec3::splat(-0.01), DVec3::Z)],
        };
        let mut simulation = on_gpu(gpu()?, &start);
        for _ in 0..6 {
            step_gpu(&mut simulation, 0.01, &mut bodies);
        }
        Some((simulation.particles().expect("read back"), bodies))
    };
    let first = run();
    if let Some((_, bodies)) = &first {
        assert!(bodies.balls[0].velocity.length() > 1e-3, "the ball was hit");
    }
    assert!(run() == first);
}

#[test]
fn falling_particles_need_no_fixed_region() {
    let Some(gpu) = gpu() else { return };
    let mut start = Simulation::new(settings(Vec3::new(0.0, 0.0, -9.81))).expect("valid");
    let region = Region::Ball {
        center: Vec3::new(0.3, 0.2, 0.5),
        radius_m: 0.02,
    };
    let velocity = Vec3::new(2.0, -1.0, 3.0);
    let jelly = Material::Jelly(Jelly::default());
    start.fill(&region, jelly, velocity).expect("valid");
    let center = |simulation: &Simulation| {
        let sum: DVec3 = simulation.particles().map(|p| p.position.as_dvec3()).sum();
        sum / simulation.len() as f64
    };
    let exact = center(&start) + velocity.as_dvec3() * 0.25 + DVec3::new(0.0, 0.0, -9.81) / 32.0;
    let mut simulation = on_gpu(gpu, &start);
    for _ in 0..5 {
        step_gpu(&mut simulation, 0.05, &mut Bodies::default());
    }
    let center = center(&simulation.download().expect("read back"));
    // The error of the first-order scheme: half a substep times the speed of the fall.
    assert!(
        center.distance(exact) < 9.81 * 5e-4,
        "{center}, not {exact}"
    );
}
