//! Speed of the material point method on a GPU.

use std::time::{Duration, Instant};

use anyhow::Context as _;
use carom_mpm::{Bodies, Gpu, GpuSimulation, Obstacle, Region, Settings, Simulation};
use carom_tracer::glam::{DVec3, Vec3};

use super::speed::materials;
use crate::BenchError;

/// Default numbers of particles.
const COUNTS: [u32; 2] = [100_000, 1_000_000];

/// Minimum wall-clock time of a measurement.
const TIME_MIN: Duration = Duration::from_millis(500);

pub(super) fn run(particles: Option<u32>) -> Result<(), BenchError> {
    let gpu = match Gpu::open_any() {
        Ok(gpu) => gpu,
        Err(why) => {
            println!("not measured: {why}");
            return Ok(());
        }
    };
    println!("{}", gpu.name());
    println!(
        "material  particles  substeps  orderings  µs a substep  ns a particle and substep  \
         particle-substeps/s  simulated : wall time"
    );
    let counts = particles.map_or(COUNTS.to_vec(), |count| vec![count]);
    for count in counts {
        for (name, material) in materials() {
            time(&gpu, name, material, count).with_context(|| format!("{count} of {name}"))?;
        }
    }
    Ok(())
}

/// Times frames of a cube that falls and spreads in a box; reports are read back, particles are not.
fn time(gpu: &Gpu, name: &str, material: carom_mpm::Material, count: u32) -> carom_mpm::Result<()> {
    const FRAME_SECS: f64 = 1.0 / 60.0;
    let settings = Settings::default();
    let width = (f64::from(count) / 8.0).cbrt() * f64::from(settings.cell_size_m);
    let region = Region::Cuboid {
        min: Vec3::ZERO,
        max: Vec3::splat(width as f32),
    };
    let mut start = Simulation::new(settings)?;
    let particles = start.fill(&region, material, Vec3::ZERO)?;
    let mut bodies = Bodies {
        obstacles: Obstacle::walls(DVec3::ZERO, DVec3::new(2.0, 1.0, 2.0) * width),
        ..Bodies::default()
    };
    let mut simulation = GpuSimulation::new(gpu, start)?;
    simulation.step(FRAME_SECS, &mut bodies)?;
    let clock = Instant::now();
    let (mut frames, mut substeps, mut orderings) = (0, 0, 0);
    while clock.elapsed() < TIME_MIN {
        let report = simulation.step(FRAME_SECS, &mut bodies)?;
        substeps += report.substeps;
        orderings += report.orderings;
        frames += 1;
    }
    let secs = clock.elapsed().as_secs_f64();
    let each_secs = secs / f64::from(substeps);
    println!(
        "{name:8}  {particles:9}  {substeps:8}  {orderings:9}  {:12.1}  {:25.3}  {:19.2e}  {:.2}",
        each_secs * 1e6,
        each_secs * 1e9 / particles as f64,
        particles as f64 / each_secs,
        f64::from(frames) * FRAME_SECS / secs,
    );
    Ok(())
}
