//! Agreement with the simulation on the CPU, from the same state.

use carom_mpm::{
    Ball, Bodies, Jelly, Material, Obstacle, Particle, Region, Sand, Simulation, Snow,
};
use glam::{DVec3, Vec3};

use crate::{gpu, materials, on_gpu, settings, step_gpu};

/// A ball of a material that flies into a corner of a box.
fn thrown(material: Material) -> (Simulation, Bodies) {
    let mut simulation = Simulation::new(settings(Vec3::new(0.0, 0.0, -9.81))).expect("valid");
    let region = Region::Ball {
        center: Vec3::new(0.06, 0.05, 0.045),
        radius_m: 0.035,
    };
    let velocity = Vec3::new(-1.0, 0.5, -2.0);
    simulation.fill(&region, material, velocity).expect("valid");
    let obstacles = Obstacle::walls(DVec3::ZERO, DVec3::splat(0.2));
    let bodies = Bodies {
        obstacles,
        ..Bodies::default()
    };
    (simulation, bodies)
}

fn sorted(simulation: &Simulation) -> Vec<Particle> {
    let mut particles: Vec<_> = simulation.particles().collect();
    particles.sort_unstable_by_key(|particle| particle.id);
    particles
}

/// Root mean squares of the distances of places in m and of velocities in m/s.
fn distances(a: &[Particle], b: &[Particle]) -> (f64, f64) {
    let mean = |of: fn(&Particle) -> Vec3| {
        let squares = a
            .iter()
            .zip(b)
            .map(|(a, b)| of(a).as_dvec3().distance_squared(of(b).as_dvec3()));
        (squares.sum::<f64>() / a.len() as f64).sqrt()
    };
    (mean(|p| p.position), mean(|p| p.velocity))
}

/// Runs both for a time in s, and returns the distances and the substeps of both.
fn compare(material: Material, duration_secs: f64) -> Option<((f64, f64), [u32; 2])> {
    let (mut cpu, bodies) = thrown(material);
    let mut gpu = on_gpu(gpu()?, &cpu);
    let on_cpu = cpu
        .step(duration_secs, &mut bodies.clone())
        .expect("stable");
    let on_gpu = gpu
        .step(duration_secs, &mut bodies.clone())
        .expect("stable");
    let distances = distances(&sorted(&cpu), &gpu.particles().expect("read back"));
    println!("{material:?}: {distances:?} {on_cpu:?} {on_gpu:?}");
    Some((distances, [on_cpu.substeps, on_gpu.substeps]))
}

/// Agreement over an impact, 100 to 200 substeps, with cells of 10 mm and speeds up to 3 m/s.
#[test]
fn places_and_velocities_agree_with_the_cpu() {
    for material in materials() {
        let Some(((place_m, velocity_m_s), substeps)) = compare(material, 0.04) else {
            return;
        };
        assert!(
            substeps[0].abs_diff(substeps[1]) <= 2 + substeps[0] / 20,
            "{substeps:?}"
        );
        assert!(substeps[1] > 60, "{substeps:?}");
        assert!(place_m < 1e-5, "{material:?}: {place_m:e} m apart");
        assert!(
            velocity_m_s < 5e-3,
            "{material:?}: {velocity_m_s:e} m/s apart"
        );
    }
}

/// Agreement for jelly on sand on snow. One coefficient of friction differs slightly, so that the GPU
/// computes means per node; the CPU computes them per block.
#[test]
fn mixed_materials_agree_with_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let mut cpu = Simulation::new(settings(Vec3::new(0.0, 0.0, -9.81))).expect("valid");
    for (layer, material) in [
        Material::Snow(Snow {
            friction: 0.500_01,
            ..Snow::default()
        }),
        Material::Sand(Sand::default()),
        Material::Jelly(Jelly::default()),
    ]
    .into_iter()
    .enumerate()
    {
        let min = Vec3::new(0.0, 0.0, 0.03 * layer as f32);
        let max = min + Vec3::new(0.05, 0.05, 0.03);
        let velocity = Vec3::new(0.5, 0.0, -0.5);
        cpu.fill(&Region::Cuboid { min, max }, material, velocity)
            .expect("valid");
    }
    let mut bodies = Bodies {
        obstacles: vec![Obstacle::plane(DVec3::ZERO, DVec3::Z)],
        ..Bodies::default()
    };
    let mut simulation = on_gpu(gpu, &cpu);
    step_gpu(&mut simulation, 0.03, &mut bodies);
    cpu.step(0.03, &mut bodies).expect("stable");
    let (place_m, velocity_m_s) =
        distances(&sorted(&cpu), &simulation.particles().expect("read back"));
    println!("{place_m:e} m, {velocity_m_s:e} m/s");
    assert!(place_m < 1e-5, "{place_m:e} m apart");
    assert!(velocity_m_s < 5e-3, "{velocity_m_s:e} m/s apart");
}

/// Agreement for a ball at 3 m/s through a strip of sand on slate, and a light one that falls onto it.
#[test]
fn balls_get_the_impulses_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    const RADIUS: f64 = 0.028_575;
    let mut cpu = Simulation::new(settings(Vec3::new(0.0, 0.0, -9.81))).expect("valid");
    let max = Vec3::new(0.08, 0.12, 0.02);
    let region = Region::Cuboid {
        min: Vec3::ZERO,
        max,
    };
    let sand = Material::Sand(Sand::default());
    cpu.fill(&region, sand, Vec3::ZERO).expect("valid");
    let mut fast = Ball::new(DVec3::new(-0.03, 0.06, RADIUS), RADIUS, 0.17);
    fast.velocity.x = 3.0;
    fast.angular_velocity.y = 3.0 / RADIUS;
    fast.acceleration.z = -9.81;
    fast.floor_m = RADIUS;
    let mut light = Ball::new(DVec3::new(0.05, 0.02, 0.05), 0.02, 0.01);
    light.velocity.z = -1.0;
    light.acceleration.z = -9.81;
    let start = Bodies {
        balls: vec![fast, light],
        obstacles: vec![Obstacle::plane(DVec3::ZERO, DVec3::Z)],
    };
    let mut simulation = on_gpu(gpu, &cpu);
    let (mut on_cpu, mut on_gpu) = (start.clone(), start.clone());
    for _ in 0..3 {
        cpu.step(0.01, &mut on_cpu).expect("stable");
        step_gpu(&mut simulation, 0.01, &mut on_gpu);
        for (a, b) in on_cpu.balls.iter().zip(&on_gpu.balls) {
            println!(
                "{:.5} {:.5} N s, {:.6} {:.6}",
                a.impulse, b.impulse, a.angular_impulse, b.angular_impulse
            );
        }
    }
    for (ball, start) in start.balls.iter().enumerate() {
        let change = |bodies: &Bodies| bodies.balls[ball].velocity - start.velocity;
        let spin = |bodies: &Bodies| bodies.balls[ball].angular_velocity - start.angular_velocity;
        let off = change(&on_gpu).distance(change(&on_cpu)) / change(&on_cpu).length();
        assert!(
            off < 0.02,
            "{} and {} m/s",
            change(&on_gpu),
            change(&on_cpu)
        );
        let off = spin(&on_gpu).distance(spin(&on_cpu)) / spin(&on_cpu).length();
        assert!(off < 0.05, "{} and {} rad/s", spin(&on_gpu), spin(&on_cpu));
        let apart = on_gpu.balls[ball]
            .position
            .distance(on_cpu.balls[ball].position);
        assert!(apart < 3e-4, "{apart} m");
    }
}
