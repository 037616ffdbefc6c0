//! A custom back end beside the farm's others: `cargo run --release -p carom-farm --example own_tracer`.
//! It delegates to the CPU tracer where a real one would use its own device.
//!
//! `cargo test -p carom-farm --test sim own_` runs it in the simulator.

use std::sync::Arc;

use carom_farm::carom_tracer::{
    CompiledScene, CpuTracer, DeviceInfo, TileRadiance, TraceJob, TraceStats, Tracer,
};
use carom_farm::prelude::*;

/// The CPU under another name.
pub struct MyTracer {
    /// The device that traces.
    pub device: CpuTracer,
}

impl Tracer for MyTracer {
    fn info(&self) -> DeviceInfo {
        DeviceInfo {
            name: "my device".to_owned(),
            ..self.device.info()
        }
    }

    fn trace(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> std::result::Result<TraceStats, carom_farm::carom_tracer::Error> {
        // Tiles may come in any order, and from several threads; `job.cancelled` ends the work early.
        self.device.trace(scene, job, sink)
    }
}

fn main() -> carom_farm::Result<()> {
    let mut scene = Scene::new().camera(Camera::looking_at([0.0, -4.0, 2.0], [0.0, 0.0, 0.5]));
    scene.add(Sphere::new(0.5).at([0.0, 0.0, 0.5]), Material::gold(0.2));
    scene.add(Plane::z(0.0), Material::wood(Axis::X));
    let device = CpuTracer::new()?;
    let mut farm = Farm::with_tracers(FarmConfig::default(), vec![Arc::new(MyTracer { device })])?;
    let picture = farm.render(&scene, Still::new(640, 360))?;
    for node in farm.nodes() {
        let device = node.info.map(|info| info.device.name);
        println!("{}: {} tiles", device.unwrap_or_default(), node.tiles);
    }
    picture.save("own_tracer.png")
}
