//! Balls among particles.

use std::f64::consts::PI;

use carom_mpm::{Ball, Bodies, Jelly, Material, Obstacle, Sand, Water};
use glam::{DVec3, Vec3};

use crate::{cuboid, heavy, step, weightless};

const RADIUS: f64 = 0.028_575;

#[test]
fn momentum_of_particles_and_balls_is_kept() {
    for material in [
        Material::Jelly(Jelly::default()),
        Material::Sand(Sand::default()),
    ] {
        let max = Vec3::new(0.1, 0.08, 0.08);
        let mut simulation = cuboid(weightless(0.01), Vec3::ZERO, max, material);
        let mut ball = Ball::new(DVec3::new(-0.035, 0.05, 0.03), RADIUS, 0.17);
        ball.velocity = DVec3::new(3.0, -0.5, 0.2);
        ball.angular_velocity = DVec3::new(0.0, 40.0, -30.0);
        let first = ball.mass_kg * ball.velocity;
        let spin = |ball: &Ball| {
            ball.moment_of_inertia() * ball.angular_velocity
                + ball.mass_kg * ball.position.cross(ball.velocity)
        };
        let first_spin = spin(&ball);
        let mut bodies = Bodies {
            balls: vec![ball],
            ..Bodies::default()
        };
        let mut impulse = DVec3::ZERO;
        for _ in 0..20 {
            step(&mut simulation, 0.01, &mut bodies);
            impulse += bodies.balls[0].impulse;
        }
        let ball = bodies.balls[0];
        let totals = simulation.totals();
        let sum = totals.momentum + ball.mass_kg * ball.velocity;
        let spins = totals.angular_momentum + spin(&ball);
        assert!(
            sum.distance(first) < 2e-5 * first.length(),
            "{sum}, not {first}"
        );
        assert!(
            spins.distance(first_spin) < 2e-5 * first_spin.length(),
            "{spins}, not {first_spin}"
        );
        let gained = ball.mass_kg * ball.velocity - first;
        assert!(
            gained.distance(impulse) < 1e-9 && gained.length() > 0.1,
            "{gained}, {impulse}"
        );
    }
}

/// Draughts, in radii, of a ball of half the density of water that is released with its centre at a height
/// above the water level in radii: five samples over half a second, after 1.6 s.
fn draughts(cell: f32, [side, depth]: [f64; 2], height: f64) -> [f64; 5] {
    let water = Water {
        viscosity_pa_s: 1.0,
        sound_speed_m_s: 10.0,
        ..Water::default()
    };
    let max = DVec3::new(side, side, depth).as_vec3();
    let mut simulation = cuboid(heavy(cell), Vec3::ZERO, max, Material::Water(water));
    let ball_m3 = 4.0 / 3.0 * PI * RADIUS.powi(3);
    let center = DVec3::new(side / 2.0, side / 2.0, depth + height * RADIUS);
    let mut ball = Ball::new(center, RADIUS, 500.0 * ball_m3);
    ball.acceleration.z = -9.81;
    simulation.retain(|p| p.position.as_dvec3().distance(center) > RADIUS);
    let water_m3: f64 = simulation.particles().map(|p| f64::from(p.volume_m3)).sum();
    let obstacles = Obstacle::walls(DVec3::ZERO, DVec3::new(side, side, 1.0));
    let mut bodies = Bodies {
        balls: vec![ball],
        obstacles,
    };
    step(&mut simulation, 1.6, &mut bodies);
    let level = (water_m3 + ball_m3 / 2.0) / (side * side);
    [(); 5].map(|()| {
        step(&mut simulation, 0.1, &mut bodies);
        (level - bodies.balls[0].position.z + RADIUS) / RADIUS
    })
}

/// On average over its oscillation, the ball is half below the common level of water and ball, whatever its
/// initial height, in cells of a fifth and of a third of its radius.
#[test]
fn light_ball_floats_at_the_depth_of_archimedes() {
    for (cell, size, height) in [
        (0.006, [0.096, 0.06], 0.0),
        (0.01, [0.15, 0.08], 0.3),
        (0.01, [0.15, 0.08], -0.3),
    ] {
        let found = draughts(cell, size, height);
        let draught = found.iter().sum::<f64>() / 5.0;
        println!("{cell} m, from {height}: {draught} radii");
        assert!((draught - 1.0).abs() < 0.05, "{cell} m: {found:?} radii");
    }
}

/// Gaps between balls that rest on a material of a depth and the nearest eight particles below them, in m.
fn gaps_at_rest(material: Material, depth: f64, cell: f64) -> Vec<f64> {
    let side = 0.12;
    let max = DVec3::new(side, side, depth).as_vec3();
    let mut simulation = cuboid(heavy(cell as f32), Vec3::ZERO, max, material);
    let center = DVec3::new(side / 2.0, side / 2.0, depth + RADIUS + 0.01);
    let mut ball = Ball::new(center, RADIUS, 0.17);
    ball.acceleration.z = -9.81;
    ball.floor_m = RADIUS;
    let mut bodies = Bodies {
        balls: vec![ball],
        obstacles: Obstacle::walls(DVec3::ZERO, DVec3::new(side, side, 1.0)),
    };
    step(&mut simulation, 0.7, &mut bodies);
    let ball = bodies.balls[0];
    let arms = simulation.particles().map(|particle| {
        let extent = 0.5 * f64::from(particle.volume_m3).cbrt();
        (particle.position.as_dvec3() - ball.position, extent)
    });
    let under = arms.filter(|(arm, _)| arm.z < -0.8 * arm.length());
    let mut gaps: Vec<f64> = under
        .map(|(arm, extent)| arm.length() - RADIUS - extent)
        .collect();
    gaps.sort_by(f64::total_cmp);
    gaps.truncate(8);
    gaps
}

#[test]
fn balls_at_rest_touch_what_carries_them_however_coarse() {
    let jelly = Material::Jelly(Jelly {
        young_pa: 8e4,
        viscosity_pa_s: 20.0,
        ..Jelly::default()
    });
    let sand = Material::Sand(Sand {
        young_pa: 8e4,
        ..Sand::default()
    });
    for (material, depth) in [(jelly, 0.045), (sand, 0.045), (sand, 0.015)] {
        for cell in [0.015, 0.0125, 0.01] {
            let gaps = gaps_at_rest(material, depth, cell);
            let mean = gaps.iter().sum::<f64>() / gaps.len() as f64;
            println!("{depth} m, {cell} m: {mean} m, {gaps:?}");
            assert!(
                mean.abs() < 0.001,
                "{material:?}, {depth} m, {cell} m: {mean} m"
            );
            assert!(gaps[0] > -0.15 * cell, "{material:?}: {gaps:?} m");
        }
    }
}

/// Kinetic energy, in J.
fn energy(ball: &Ball) -> f64 {
    let spin = ball.moment_of_inertia() * ball.angular_velocity.length_squared();
    0.5 * (ball.mass_kg * ball.velocity.length_squared() + spin)
}

/// Energy that a ball of 3 m/s loses in a strip of sand of a depth, and the work of the sand's
/// impulses on it, in J.
fn lost_in_sand(depth: f32) -> (f64, f64) {
    let max = Vec3::new(0.05, 0.12, depth);
    let sand = Material::Sand(Sand::default());
    let mut simulation = cuboid(heavy(0.005), Vec3::ZERO, max, sand);
    let mut ball = Ball::new(DVec3::new(-0.03, 0.06, RADIUS), RADIUS, 0.17);
    ball.velocity.x = 3.0;
    let first = energy(&ball);
    let obstacles = vec![Obstacle::plane(DVec3::ZERO, DVec3::Z)];
    let mut bodies = Bodies {
        balls: vec![ball],
        obstacles,
    };
    let mut work = 0.0;
    for _ in 0..50 {
        let before = bodies.balls[0];
        step(&mut simulation, 0.001, &mut bodies);
        let ball = &mut bodies.balls[0];
        // The ball may move along its direction only: the slate carries it.
        ball.velocity.y = 0.0;
        ball.velocity.z = 0.0;
        ball.position.z = RADIUS;
        work += ball.impulse.x * (before.velocity.x + ball.velocity.x) / 2.0;
        let spin = (before.angular_velocity + ball.angular_velocity) / 2.0;
        work += ball.angular_impulse.dot(spin);
    }
    (first - energy(&bodies.balls[0]), -work)
}

#[test]
fn ball_through_sand_loses_the_work_of_its_depth() {
    let losses = [0.005, 0.01, 0.02].map(lost_in_sand);
    for (lost, work) in losses {
        assert!((lost - work).abs() < 1e-6, "{losses:?}");
    }
    // Sand carried along grows with the section of the ball that is under it, as depth to the power
    // of 3/2 at most: a ball that has slowed loses less.
    for pair in losses.windows(2) {
        let ratio = pair[1].0 / pair[0].0;
        assert!((1.2..2.9).contains(&ratio), "{losses:?}");
    }
}
