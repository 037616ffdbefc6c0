//! Water in motion.

use carom_mpm::{Bodies, Material, Obstacle, Water};
use glam::{DVec3, Vec3};

use crate::{cuboid, heavy, step};

/// The front of a collapsing column twice as high as wide: time times √(2g/a), and place over the
/// width a (Martin and Moyce 1952, figure 3, a = 2.25 in).
const SURGE_FRONT: [(f64, f64); 5] = [
    (0.832, 1.217),
    (1.219, 1.474),
    (1.997, 2.292),
    (2.547, 2.995),
    (3.345, 4.134),
];

#[test]
fn dam_break_follows_martin_and_moyce() {
    let width = 0.16_f64;
    let cell = 0.01;
    let sound_speed_m_s = 10.0 * (2.0 * 9.81 * 2.0 * width as f32).sqrt();
    let water = Material::Water(Water {
        sound_speed_m_s,
        ..Water::default()
    });
    let max = Vec3::new(width as f32, 2.0 * cell, 2.0 * width as f32);
    let mut simulation = cuboid(heavy(cell), Vec3::ZERO, max, water);
    let far = DVec3::new(2.0, f64::from(2.0 * cell), 2.0);
    let obstacles = Obstacle::walls(DVec3::ZERO, far);
    let mut bodies = Bodies {
        obstacles,
        ..Bodies::default()
    };
    let unit = (width / (2.0 * 9.81)).sqrt();
    let mut now = 0.0;
    for (time, front) in SURGE_FRONT {
        step(&mut simulation, (time - now) * unit, &mut bodies);
        now = time;
        // The place that a hundredth of the water has passed.
        let mut xs: Vec<f32> = simulation.particles().map(|p| p.position.x).collect();
        xs.sort_by(f32::total_cmp);
        let found = f64::from(xs[xs.len() - 1 - xs.len() / 100]) / width;
        let error = found / front - 1.0;
        assert!(
            error.abs() < 0.1,
            "T {time}: front {found}, measured {front}"
        );
    }
}
