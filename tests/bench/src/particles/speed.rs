//! Speed of the material point method: each material, and a Taichi program of the same method for
//! comparison.

use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, anyhow};
use carom_mpm::{
    Bodies, Jelly, Material, Obstacle, Region, Sand, Settings, Simulation, Snow, Water,
};
use carom_tracer::glam::{DVec3, Vec3};
use cpu_time::ProcessTime;
use serde::Deserialize;

use super::soft_body::{self, CpuCost};
use crate::BenchError;

#[derive(clap::Args)]
pub(super) struct SpeedArgs {
    /// Edge of the cube of particles in cells, eight particles a cell; 50 are a million.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u16).range(2..=80))]
    edge: u16,
    /// Python with taichi, for the comparison.
    #[arg(long, default_value = "python3")]
    python: String,
}

/// Output of `mpm_taichi.py`.
#[derive(Deserialize)]
struct TaichiSpeed {
    particles: u64,
    substeps: u32,
    ns: f64,
}

pub(super) fn run(args: &SpeedArgs) -> Result<(), BenchError> {
    println!("material  particles  substeps  orderings  ns CPU a particle and substep");
    let mut jelly = CpuCost {
        ns: f64::NAN,
        ns_simulated_sec: f64::NAN,
    };
    for (name, material) in materials() {
        let speed = time(name, material, args.edge).context("a cube that spreads")?;
        if name == "jelly" {
            jelly = speed;
        }
    }
    let rapier = soft_body::time(args.edge);
    let ratio = rapier.ns_simulated_sec / jelly.ns_simulated_sec;
    println!("a second of jelly takes rapier {ratio:.2} times as long, in steps of its own length");
    match taichi(args) {
        Ok(TaichiSpeed {
            particles,
            substeps,
            ns,
        }) => {
            println!("taichi    {particles:9}  {substeps:8}  {:>9}  {ns:.1}", "-");
            println!("jelly takes taichi {:.1} times as long", ns / jelly.ns);
        }
        Err(why) => println!("taichi: not compared: {why:#}"),
    }
    Ok(())
}

/// Each material with its name.
pub(super) fn materials() -> [(&'static str, Material); 4] {
    [
        ("jelly", Material::Jelly(Jelly::default())),
        ("water", Material::Water(Water::default())),
        ("sand", Material::Sand(Sand::default())),
        ("snow", Material::Snow(Snow::default())),
    ]
}

/// Times a cube that falls and spreads in a box.
fn time(name: &str, material: Material, edge: u16) -> carom_mpm::Result<CpuCost> {
    let settings = Settings {
        rest_speed_m_s: 0.0,
        ..Settings::default()
    };
    let mut simulation = Simulation::new(settings)?;
    let width = f32::from(edge) * settings.cell_size_m;
    let region = Region::Cuboid {
        min: Vec3::ZERO,
        max: Vec3::splat(width),
    };
    let particles = simulation.fill(&region, material, Vec3::ZERO)?;
    let far = DVec3::new(2.0, 1.0, 2.0) * f64::from(width);
    let mut bodies = Bodies {
        obstacles: Obstacle::walls(DVec3::ZERO, far),
        ..Bodies::default()
    };
    simulation.step(0.02, &mut bodies)?;
    let start = ProcessTime::now();
    let (mut substeps, mut orderings, mut simulated_secs) = (0, 0, 0.0);
    while u64::from(substeps) * (particles as u64) < PARTICLE_STEPS {
        let report = simulation.step(0.01, &mut bodies)?;
        substeps += report.substeps;
        orderings += report.orderings;
        simulated_secs += 0.01;
    }
    let particle_ns = start.elapsed().as_secs_f64() * 1e9 / particles as f64;
    let ns = particle_ns / f64::from(substeps);
    println!("{name:8}  {particles:9}  {substeps:8}  {orderings:9}  {ns:.1}");
    Ok(CpuCost {
        ns,
        ns_simulated_sec: particle_ns / simulated_secs,
    })
}

fn taichi(args: &SpeedArgs) -> anyhow::Result<TaichiSpeed> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../mpm_taichi.py");
    let output = Command::new(&args.python)
        .arg(script)
        .arg(args.edge.to_string())
        .output()
        .with_context(|| format!("cannot run {}", args.python))?;
    let said = String::from_utf8_lossy(&output.stderr);
    if !output.status.success() {
        let last = said.lines().last().unwrap_or("no reason told");
        return Err(anyhow!(
            "{} ended with: {last}. `pip install taichi` and `--python PATH` give one that has it",
            args.python
        ));
    }
    let printed = String::from_utf8_lossy(&output.stdout);
    let line = printed.lines().last().context("it printed nothing")?;
    serde_json::from_str(line).with_context(|| format!("it printed {line:?}"))
}

/// Number of particle-substeps over which a material is timed.
const PARTICLE_STEPS: u64 = 25_000_000;
