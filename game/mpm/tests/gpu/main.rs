//! Laws of the simulation on a GPU, software Vulkan where there is no other. Without any the tests are
//! skipped, unless `CAROM_REQUIRE_GPU` is set.

mod agreement;
mod bounds;
mod laws;

use std::sync::OnceLock;

use carom_mpm::{
    Bodies, Gpu, GpuSimulation, Jelly, Material, Sand, Settings, Simulation, Snow, Water,
};
use glam::Vec3;

/// The GPU of all tests.
fn gpu() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| match Gpu::open_any() {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("CAROM_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            println!("skipped: {error}");
            None
        }
    })
    .as_ref()
}

/// One of each material.
fn materials() -> [Material; 4] {
    [
        Material::Jelly(Jelly::default()),
        Material::Water(Water::default()),
        Material::Sand(Sand::default()),
        Material::Snow(Snow::default()),
    ]
}

/// Settings that never sleep, with or without gravity.
fn settings(gravity: Vec3) -> Settings {
    Settings {
        gravity,
        rest_speed_m_s: 0.0,
        ..Settings::default()
    }
}

/// Continues a simulation on the GPU.
fn on_gpu(gpu: &Gpu, simulation: &Simulation) -> GpuSimulation {
    GpuSimulation::new(gpu, simulation.clone()).expect("within the device's limits")
}

fn step_gpu(simulation: &mut GpuSimulation, duration_secs: f64, bodies: &mut Bodies) {
    simulation
        .step(duration_secs, bodies)
        .expect("a stable step");
}
