//! Conservation of mass, momenta and energy, and bits that do not depend on threads.

use carom_mpm::{
    Bodies, Jelly, Material, Obstacle, Particle, Region, Sand, Simulation, Snow, Totals, Water,
};
use glam::{DVec3, Vec3};

use crate::{heavy, step, weightless};

/// A body of a material that flies, turns and deforms: two boxes that meet off centre.
fn meeting(material: Material) -> Simulation {
    let mut simulation = Simulation::new(weightless(0.01)).expect("valid");
    for (min, velocity) in [
        (Vec3::new(0.0, 0.0, 0.0), Vec3::new(1.0, 0.3, 0.0)),
        (Vec3::new(0.05, 0.015, 0.015), Vec3::new(-0.2, 0.0, 0.1)),
    ] {
        let region = Region::Cuboid {
            min,
            max: min + 0.04,
        };
        simulation.fill(&region, material, velocity).expect("valid");
    }
    simulation
}

fn relative(a: DVec3, b: DVec3) -> f64 {
    a.distance(b) / b.length()
}

fn check_momenta(material: Material) {
    let mut simulation = meeting(material);
    let before: Totals = simulation.totals();
    let mut substeps = 0;
    while substeps < 5000 {
        let report = simulation
            .step(0.05, &mut Bodies::default())
            .expect("stable");
        substeps += report.substeps;
    }
    let after = simulation.totals();
    let momentum = relative(after.momentum, before.momentum);
    let angular = relative(after.angular_momentum, before.angular_momentum);
    assert_eq!(after.mass_kg, before.mass_kg, "{material:?}");
    assert!(momentum < 2e-5, "{material:?}: {momentum:e}");
    assert!(angular < 3e-5, "{material:?}: {angular:e}");
}

#[test]
fn jelly_keeps_mass_and_momenta_over_5000_substeps() {
    check_momenta(Material::Jelly(Jelly::default()));
}

#[test]
fn water_keeps_mass_and_momenta_over_5000_substeps() {
    check_momenta(Material::Water(Water::default()));
}

#[test]
fn sand_keeps_mass_and_momenta_over_5000_substeps() {
    check_momenta(Material::Sand(Sand::default()));
}

#[test]
fn snow_keeps_mass_and_momenta_over_5000_substeps() {
    check_momenta(Material::Snow(Snow::default()));
}

#[test]
fn free_fall_is_a_parabola() {
    let mut simulation = Simulation::new(heavy(0.01)).expect("valid");
    let region = Region::Ball {
        center: Vec3::new(0.3, 0.2, 0.5),
        radius_m: 0.03,
    };
    let velocity = Vec3::new(2.0, -1.0, 3.0);
    let jelly = Material::Jelly(Jelly::default());
    simulation.fill(&region, jelly, velocity).expect("valid");
    let center = |simulation: &Simulation| {
        let sum: DVec3 = simulation.particles().map(|p| p.position.as_dvec3()).sum();
        sum / simulation.len() as f64
    };
    let start = center(&simulation);
    let fall = DVec3::new(0.0, 0.0, -9.81);
    for _ in 0..100 {
        step(&mut simulation, 0.01, &mut Bodies::default());
    }
    let exact = start + velocity.as_dvec3() + fall / 2.0;
    // The error of the first-order scheme: half a substep times the speed of the fall.
    assert!(center(&simulation).distance(exact) < 9.81 * 5e-4, "{exact}");
}

/// Kinetic and potential energy, in J.
fn energy(simulation: &Simulation) -> f64 {
    let height = |p: Particle| f64::from(p.mass_kg) * 9.81 * f64::from(p.position.z);
    simulation.totals().kinetic_energy_j + simulation.particles().map(height).sum::<f64>()
}

#[test]
fn energy_never_grows_in_a_closed_box() {
    let materials = [
        Material::Jelly(Jelly::default()),
        Material::Water(Water {
            viscosity_pa_s: 0.0,
            ..Water::default()
        }),
        Material::Sand(Sand::default()),
        Material::Snow(Snow::default()),
    ];
    for material in materials {
        let mut simulation = Simulation::new(heavy(0.01)).expect("valid");
        let region = Region::Ball {
            center: Vec3::new(0.1, 0.08, 0.12),
            radius_m: 0.04,
        };
        let velocity = Vec3::new(1.0, 0.5, 0.0);
        simulation.fill(&region, material, velocity).expect("valid");
        let obstacles = Obstacle::walls(DVec3::ZERO, DVec3::splat(0.2));
        let mut bodies = Bodies {
            obstacles,
            ..Bodies::default()
        };
        let first = energy(&simulation);
        for _ in 0..100 {
            step(&mut simulation, 0.01, &mut bodies);
            let last = energy(&simulation);
            assert!(last < 1.01 * first, "{material:?}: {last} J of {first} J");
        }
    }
}

#[test]
fn bits_do_not_depend_on_the_number_of_threads() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads").install(|| {
            let mut simulation = meeting(Material::Sand(Sand::default()));
            let jelly = Material::Jelly(Jelly::default());
            let region = Region::Ball {
                center: Vec3::new(0.1, 0.1, 0.0),
                radius_m: 0.03,
            };
            simulation.fill(&region, jelly, -Vec3::Y).expect("valid");
            let ball = carom_mpm::Ball::new(DVec3::new(0.1, 0.03, 0.0), 0.03, 0.17);
            let mut bodies = Bodies {
                balls: vec![ball],
                ..Bodies::default()
            };
            for _ in 0..20 {
                step(&mut simulation, 0.005, &mut bodies);
            }
            (simulation.particles().collect::<Vec<_>>(), bodies)
        })
    };
    let one = run(1);
    assert!(one.1.balls[0].velocity.length() > 1e-3, "the ball was hit");
    for threads in [2, 3, 5] {
        assert!(run(threads) == one, "{threads} threads");
    }
}
