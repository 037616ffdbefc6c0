//! Elastic bars and waves against closed forms.

use std::f64::consts::PI;

use carom_mpm::{Bodies, Jelly, Material, Region, Simulation};
use glam::Vec3;

use crate::{step, weightless};

/// A free bar along x of some cells' length and width, set into its first longitudinal vibration.
fn vibrating_bar(cell: f32, cells: u32, width: u32, speed: f64, jelly: Jelly) -> Simulation {
    let mut simulation = Simulation::new(weightless(cell)).expect("valid");
    let (length, width) = (cells as f32 * cell, width as f32 * cell);
    for slice in 0..2 * cells {
        let min = Vec3::new(slice as f32 * cell / 2.0, 0.0, 0.0);
        let max = min + Vec3::new(cell / 2.0, width, width);
        let velocity = speed * (PI * f64::from((min.x + cell / 4.0) / length)).cos();
        let velocity = Vec3::new(velocity as f32, 0.0, 0.0);
        let region = Region::Cuboid { min, max };
        simulation
            .fill(&region, Material::Jelly(jelly), velocity)
            .expect("valid");
    }
    simulation
}

#[test]
fn free_bar_vibrates_with_twice_its_length_over_the_speed_of_sound() {
    let cell = 0.01;
    let jelly = Jelly {
        poisson: 0.0,
        ..Jelly::default()
    };
    let length = 40.0 * cell;
    let mut simulation = vibrating_bar(cell, 40, 4, 0.02, jelly);
    let exact = 2.0 * f64::from(length) / f64::from(jelly.young_pa / jelly.density_kg_m3).sqrt();
    // The velocity in the shape of the first mode falls through zero a quarter of a period after
    // the start, and then twice a period.
    let amplitude = |simulation: &Simulation| {
        let term = |p: carom_mpm::Particle| {
            f64::from(p.velocity.x) * (PI * f64::from(p.position.x) / f64::from(length)).cos()
        };
        simulation.particles().map(term).sum::<f64>()
    };
    let dt = exact / 400.0;
    let (mut last, mut crossings) = (amplitude(&simulation), Vec::new());
    for count in 1..1200 {
        step(&mut simulation, dt, &mut Bodies::default());
        let now = amplitude(&simulation);
        if last * now < 0.0 {
            crossings.push((f64::from(count) - now / (now - last)) * dt);
        }
        last = now;
    }
    let periods = (crossings.len() - 1) as f64 / 2.0;
    let period = (crossings[crossings.len() - 1] - crossings[0]) / periods;
    assert!(
        (period / exact - 1.0).abs() < 0.02,
        "{period} s, not {exact} s"
    );
}

/// Mean error of the displacement of a free bar in its first mode after 1.3 periods, relative to the
/// amplitude, at some number of cells over its length.
fn wave_error(cells: u32) -> f64 {
    let length = 0.4;
    let cell = length / cells as f32;
    let jelly = Jelly {
        poisson: 0.0,
        ..Jelly::default()
    };
    let speed = 0.05;
    let mut simulation = vibrating_bar(cell, cells, 2, speed, jelly);
    let start = sorted_places(&simulation);
    let sound = f64::from(Material::Jelly(jelly).sound_speed_m_s());
    let omega = PI * sound / f64::from(length);
    let duration = 1.3 * 2.0 * PI / omega;
    step(&mut simulation, duration, &mut Bodies::default());
    let amplitude = speed / omega;
    let end = sorted_places(&simulation);
    let error = start.iter().zip(&end).map(|(start, end)| {
        let exact = amplitude * (omega * duration).sin() * (PI * start / f64::from(length)).cos();
        (end - start - exact).abs()
    });
    error.sum::<f64>() / start.len() as f64 / amplitude
}

/// x of all particles, by id.
fn sorted_places(simulation: &Simulation) -> Vec<f64> {
    let mut particles: Vec<_> = simulation.particles().collect();
    particles.sort_by_key(|particle| particle.id);
    particles
        .iter()
        .map(|particle| particle.position.x.into())
        .collect()
}

#[test]
fn error_of_a_wave_falls_with_the_cell_size() {
    let errors = [8, 16, 32, 64].map(wave_error);
    for pair in errors.windows(2) {
        assert!(pair[1] < pair[0] / 1.7, "{errors:?}");
    }
}
