//! Slopes of sand.

use carom_mpm::{Bodies, Grip, Material, Obstacle, Region, Sand, Simulation};
use glam::{DVec3, Vec3};

use crate::{heavy, step};

const CELL: f32 = 0.005;
const BASE: f32 = 40.0 * CELL;

/// Half a heap of some slope beside a smooth wall, on bonded ground, two cells deep.
fn heap(sand: Sand, slope_deg: f32) -> (Simulation, Bodies) {
    let mut simulation = Simulation::new(heavy(CELL)).expect("valid");
    let slope = slope_deg.to_radians().tan();
    let max = Vec3::new(BASE, 2.0 * CELL, BASE * slope);
    let region = Region::Cuboid {
        min: Vec3::ZERO,
        max,
    };
    simulation
        .fill(&region, Material::Sand(sand), Vec3::ZERO)
        .expect("valid");
    simulation.retain(|p| p.position.z < slope * (BASE - p.position.x));
    let far = DVec3::new(4.0 * f64::from(BASE), f64::from(2.0 * CELL), 1.0);
    let mut obstacles = Obstacle::walls(DVec3::ZERO, far);
    obstacles[2].grip = Grip::Bonded;
    (
        simulation,
        Bodies {
            obstacles,
            ..Bodies::default()
        },
    )
}

/// Slope of the surface in degrees: a line through the highest grains of columns a cell wide, but
/// for the top, the toe and what lies beyond.
fn slope_deg(simulation: &Simulation) -> f64 {
    let mut tops = vec![0.0_f32; 1000];
    for particle in simulation.particles() {
        let top = &mut tops[(particle.position.x / CELL) as usize];
        *top = top.max(particle.position.z);
    }
    let peak = tops[0];
    let points: Vec<(f64, f64)> = tops
        .iter()
        .enumerate()
        .filter(|(_, top)| (0.2 * peak..0.8 * peak).contains(*top))
        .map(|(i, top)| (f64::from(CELL) * i as f64, f64::from(*top)))
        .collect();
    let count = points.len() as f64;
    let (mx, mz) = points
        .iter()
        .fold((0.0, 0.0), |m, p| (m.0 + p.0 / count, m.1 + p.1 / count));
    let covariance: f64 = points.iter().map(|p| (p.0 - mx) * (p.1 - mz)).sum();
    let variance: f64 = points.iter().map(|p| (p.0 - mx).powi(2)).sum();
    (-covariance / variance).atan().to_degrees()
}

/// Slope of a heap, and the mean displacement of its grains in cells, after 0.4 s.
fn settled(sand: Sand, slope: f32) -> (f64, f32) {
    let (mut simulation, mut bodies) = heap(sand, slope);
    let places = |simulation: &Simulation| {
        let mut particles: Vec<_> = simulation.particles().collect();
        particles.sort_by_key(|particle| particle.id);
        particles
    };
    let start = places(&simulation);
    step(&mut simulation, 0.4, &mut bodies);
    let end = places(&simulation);
    let moved = start
        .iter()
        .zip(&end)
        .map(|(a, b)| a.position.distance(b.position));
    let moved = moved.sum::<f32>() / start.len() as f32 / CELL;
    (slope_deg(&simulation), moved)
}

#[test]
fn heaps_stand_below_their_angle_of_friction_and_slide_above_it() {
    for angle in [25.0, 33.0] {
        let sand = Sand {
            friction_angle_deg: angle,
            friction: 0.0,
            ..Sand::default()
        };
        let (below, moved_below) = settled(sand, angle - 3.0);
        let (above, moved_above) = settled(sand, angle + 3.0);
        assert!(moved_below < 0.2, "{angle}°: moved {moved_below} cells");
        assert!((below - f64::from(angle)).abs() < 4.0, "{angle}°: {below}°");
        assert!(
            moved_above > 5.0 * moved_below,
            "{angle}°: moved {moved_above} cells"
        );
        assert!((above - f64::from(angle)).abs() < 3.0, "{angle}°: {above}°");
    }
}
