//! Extremes: the stability limit, crowds and loners, light and heavy balls, rest, and bad input.

use carom_mpm::{
    Ball, Bodies, Error, Jelly, Material, Obstacle, Particle, Region, Sand, Settings, Simulation,
    Snow, Water,
};
use glam::{DVec3, Vec3};

fn materials() -> [Material; 4] {
    [
        Material::Jelly(Jelly::default()),
        Material::Water(Water::default()),
        Material::Sand(Sand::default()),
        Material::Snow(Snow::default()),
    ]
}

fn filled(settings: Settings, size: Vec3, material: Material) -> Simulation {
    let mut simulation = Simulation::new(settings).expect("valid");
    let region = Region::Cuboid {
        min: Vec3::ZERO,
        max: size,
    };
    simulation
        .fill(&region, material, Vec3::ZERO)
        .expect("valid");
    simulation
}

fn box_of(side: f64) -> Bodies {
    let obstacles = Obstacle::walls(DVec3::ZERO, DVec3::splat(side));
    Bodies {
        obstacles,
        ..Bodies::default()
    }
}

#[test]
fn every_material_is_stable_at_a_courant_number_of_one() {
    for material in materials() {
        let settings = Settings {
            courant: 1.0,
            rest_speed_m_s: 0.0,
            ..Settings::default()
        };
        let mut simulation = filled(settings, Vec3::new(0.06, 0.06, 0.1), material);
        let mut bodies = box_of(0.2);
        let height = 9.81 * 0.1;
        for _ in 0..50 {
            simulation.step(0.02, &mut bodies).expect("stable");
            let totals = simulation.totals();
            let energy = totals.kinetic_energy_j / totals.mass_kg;
            assert!(energy < height, "{material:?}: {energy} J/kg");
        }
    }
}

#[test]
fn one_particle_flies_alone() {
    for material in materials() {
        let settings = Settings {
            gravity: Vec3::ZERO,
            ..Settings::default()
        };
        let mut simulation = Simulation::new(settings).expect("valid");
        let velocity = Vec3::new(0.3, -0.2, 0.1);
        simulation
            .add(&[Vec3::splat(0.5)], material, 1e-6, velocity)
            .expect("valid");
        simulation
            .step(1.0, &mut Bodies::default())
            .expect("stable");
        let particle = simulation.particles().next().expect("a particle");
        let exact = Vec3::splat(0.5) + velocity;
        assert!(particle.position.distance(exact) < 1e-4, "{particle:?}");
        assert!(particle.velocity.distance(velocity) < 1e-5, "{particle:?}");
    }
}

#[test]
fn all_particles_may_be_in_one_cell() {
    for material in materials() {
        let mut simulation = Simulation::new(Settings::default()).expect("valid");
        let place = |i: u16| {
            Vec3::new(
                f32::from(i % 16),
                f32::from(i / 16 % 16),
                f32::from(i / 256),
            )
        };
        let places: Vec<_> = (0..4096).map(|i| (place(i) + 0.5) * 6e-4 + 0.05).collect();
        simulation
            .add(&places, material, 1.25e-7, Vec3::ZERO)
            .expect("valid");
        let mass = simulation.totals().mass_kg;
        simulation.step(0.3, &mut box_of(0.2)).expect("stable");
        assert_eq!(simulation.totals().mass_kg, mass);
        let fastest = simulation
            .particles()
            .map(|p| p.velocity.length())
            .fold(0.0, f32::max);
        assert!(fastest < 5.0, "{material:?}: {fastest} m/s");
    }
}

#[test]
fn fast_ball_goes_through_jelly_and_is_slowed() {
    let jelly = Material::Jelly(Jelly {
        young_pa: 2e4,
        ..Jelly::default()
    });
    let mut simulation = filled(Settings::default(), Vec3::splat(0.1), jelly);
    let mut ball = Ball::new(DVec3::new(-0.04, 0.05, 0.05), 0.028, 0.17);
    ball.velocity.x = 15.0;
    let mut bodies = Bodies {
        balls: vec![ball],
        ..box_of(1.0)
    };
    bodies.obstacles.remove(0);
    simulation.step(0.05, &mut bodies).expect("stable");
    let ball = bodies.balls[0];
    assert!((1.0..14.5).contains(&ball.velocity.length()), "{ball:?}");
    let totals = simulation.totals();
    let energy = totals.kinetic_energy_j + 0.085 * ball.velocity.length_squared();
    assert!(energy < 0.085 * 225.0 * 1.01 + totals.mass_kg, "{energy} J");
}

#[test]
fn a_million_particles_are_simulated() {
    let water = Material::Water(Water::default());
    let mut simulation = filled(Settings::default(), Vec3::splat(0.5), water);
    assert_eq!(simulation.len(), 1_000_000);
    let before = simulation.totals();
    let mut bodies = box_of(0.5);
    let report = simulation.step(1e-3, &mut bodies).expect("stable");
    let after = simulation.totals();
    assert!(report.substeps >= 2, "{report:?}");
    assert_eq!(after.mass_kg, before.mass_kg);
    // Free fall, except for the part that the pressure wave from the floor has reached.
    let fallen = after.momentum.z / after.mass_kg;
    assert!((-9.9e-3..-9e-3).contains(&fallen), "{fallen} m/s");
}

#[test]
fn balls_a_thousand_times_lighter_and_heavier_than_sand_stay_stable() {
    for factor in [1e-3, 1e3] {
        let sand = Material::Sand(Sand::default());
        let mut simulation = filled(Settings::default(), Vec3::new(0.1, 0.1, 0.05), sand);
        let mut ball = Ball::new(DVec3::new(0.05, 0.05, 0.085), 0.0286, 0.157 * factor);
        ball.velocity.z = -1.0;
        ball.acceleration.z = -9.81;
        let mut bodies = box_of(0.1);
        bodies.obstacles.pop();
        bodies.balls.push(ball);
        for _ in 0..30 {
            simulation.step(0.01, &mut bodies).expect("stable");
            let speed = bodies.balls[0].velocity.length();
            assert!(speed < 1.0 + 9.81 * 0.3, "{factor}: {speed} m/s");
        }
        let is_buried = bodies.balls[0].position.z < 0.06;
        assert_eq!(is_buried, factor > 1.0, "{:?}", bodies.balls[0]);
    }
}

#[test]
fn nothing_moves_without_gravity() {
    for material in materials() {
        let gravity = Vec3::ZERO;
        let settings = Settings {
            gravity,
            rest_speed_m_s: 0.0,
            ..Settings::default()
        };
        let mut simulation = filled(settings, Vec3::splat(0.04), material);
        let start = sorted(&simulation);
        simulation
            .step(0.5, &mut Bodies::default())
            .expect("stable");
        for (a, b) in start.iter().zip(sorted(&simulation)) {
            assert!(
                a.position.distance(b.position) < 1e-6,
                "{material:?}: {a:?} {b:?}"
            );
        }
    }
}

fn sorted(simulation: &Simulation) -> Vec<Particle> {
    let mut particles: Vec<_> = simulation.particles().collect();
    particles.sort_by_key(|particle| particle.id);
    particles
}

#[test]
fn sand_sleeps_an_hour_without_creep_and_wakes() {
    let sand = Material::Sand(Sand::default());
    let mut simulation = filled(Settings::default(), Vec3::new(0.08, 0.08, 0.04), sand);
    let mut bodies = box_of(0.2);
    for _ in 0..40 {
        simulation.step(0.1, &mut bodies).expect("stable");
    }
    assert!(simulation.is_asleep(), "{:?}", simulation.totals());
    let before: Vec<_> = simulation.particles().collect();
    let report = simulation.step(3600.0, &mut bodies).expect("asleep");
    assert_eq!(report.substeps, 0);
    assert!(
        before == simulation.particles().collect::<Vec<_>>(),
        "bits changed"
    );
    let mut ball = Ball::new(DVec3::new(0.04, 0.04, 0.08), 0.0286, 0.17);
    ball.velocity.z = -1.0;
    bodies.balls.push(ball);
    for _ in 0..10 {
        simulation.step(0.01, &mut bodies).expect("stable");
    }
    assert!(
        !simulation.is_asleep() && bodies.balls[0].velocity.z > -0.9,
        "{bodies:?}"
    );
}

/// An hour of sleep changes no bit.
#[test]
fn what_fills_a_box_creeps_awake_by_less_than_a_hundredth_of_a_cell_a_second() {
    let sand = Material::Sand(Sand::default());
    let jelly = Material::Jelly(Jelly {
        viscosity_pa_s: 5.0,
        ..Jelly::default()
    });
    for (material, size) in [
        (sand, Vec3::new(0.08, 0.08, 0.04)),
        (jelly, Vec3::splat(0.06)),
    ] {
        let settings = Settings {
            rest_speed_m_s: 0.0,
            ..Settings::default()
        };
        let mut simulation = filled(settings, size, material);
        let mut bodies = box_of(size.x.into());
        let mut wait = |simulation: &mut Simulation| {
            for _ in 0..10 {
                simulation.step(0.4, &mut bodies).expect("stable");
            }
        };
        wait(&mut simulation);
        let before = sorted(&simulation);
        wait(&mut simulation);
        let ways = before.iter().zip(sorted(&simulation));
        let farthest = ways.map(|(a, b)| a.position.distance(b.position));
        let farthest = farthest.fold(0.0, f32::max);
        println!("{material:?}: {farthest:e} m in 4 s");
        assert!(farthest < 4e-4, "{material:?}: {farthest:e} m");
    }
}

#[test]
fn inverted_elements_do_not_explode() {
    // A ball at 15 m/s turns soft jelly inside out.
    let jelly = Material::Jelly(Jelly {
        young_pa: 2e3,
        ..Jelly::default()
    });
    let settings = Settings {
        courant: 1.0,
        ..Settings::default()
    };
    let mut simulation = filled(settings, Vec3::splat(0.06), jelly);
    let mut ball = Ball::new(DVec3::new(0.03, 0.03, 0.09), 0.0286, 0.17);
    ball.velocity.z = -15.0;
    let mut bodies = box_of(0.12);
    bodies.obstacles.pop();
    bodies.balls.push(ball);
    let first = 0.085 * 225.0;
    for _ in 0..30 {
        simulation.step(0.01, &mut bodies).expect("stable");
        let totals = simulation.totals();
        let energy = totals.kinetic_energy_j + 0.085 * bodies.balls[0].velocity.length_squared();
        assert!(
            energy < 1.02 * first + totals.mass_kg,
            "{energy} J of {first}"
        );
    }
}

#[test]
fn input_that_is_no_number_is_refused_with_a_sentence() {
    let mut simulation = filled(
        Settings::default(),
        Vec3::splat(0.02),
        Material::Jelly(Jelly::default()),
    );
    let nan = Vec3::new(0.0, f32::NAN, 0.0);
    let jelly = Material::Jelly(Jelly::default());
    let soft = Material::Jelly(Jelly {
        young_pa: f32::NAN,
        ..Jelly::default()
    });
    let cube = Region::Cuboid {
        min: Vec3::ZERO,
        max: Vec3::ONE * 0.02,
    };
    let broken = Region::Cuboid {
        min: nan,
        max: Vec3::ONE,
    };
    let mut bodies = Bodies::default();
    let mut results = vec![
        simulation.fill(&cube, jelly, nan).map(drop),
        simulation.fill(&cube, soft, Vec3::ZERO).map(drop),
        simulation.fill(&broken, jelly, Vec3::ZERO).map(drop),
        simulation.add(&[nan], jelly, 1e-6, Vec3::ZERO),
        simulation.add(&[Vec3::ONE * 1e20], jelly, 1e-6, Vec3::ZERO),
        simulation.step(f64::NAN, &mut bodies).map(drop),
        simulation.step(-1.0, &mut bodies).map(drop),
    ];
    bodies.balls.push(Ball::new(DVec3::NAN, 0.03, 0.17));
    results.push(simulation.step(0.01, &mut bodies).map(drop));
    bodies.balls[0] = Ball::new(DVec3::ZERO, 0.03, -1.0);
    results.push(simulation.step(0.01, &mut bodies).map(drop));
    let courant = f32::NAN;
    let settings = Settings {
        courant,
        ..Settings::default()
    };
    results.push(Simulation::new(settings).map(drop));
    for (index, result) in results.into_iter().enumerate() {
        let error = result.expect_err("refused");
        assert!(!matches!(error, Error::Diverged { .. }), "{index}: {error}");
        assert!(error.to_string().split(' ').count() > 6, "{index}: {error}");
    }
    assert!(simulation.step(0.01, &mut Bodies::default()).is_ok());
}

#[test]
fn too_many_substeps_are_refused_before_any() {
    let settings = Settings {
        substeps_max: 10,
        ..Settings::default()
    };
    let jelly = Material::Jelly(Jelly::default());
    let mut simulation = filled(settings, Vec3::splat(0.04), jelly);
    let before: Vec<_> = simulation.particles().collect();
    let error = simulation
        .step(1.0, &mut Bodies::default())
        .expect_err("refused");
    assert!(matches!(error, Error::TooManySubsteps { .. }), "{error}");
    assert!(before == simulation.particles().collect::<Vec<_>>());
}
