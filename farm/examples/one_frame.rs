//! Renders a scene file on this machine and all nodes that are named, and writes a PNG:
//! `cargo run --release -p carom-farm --example one_frame -- SCENE.json OUT.png [NODE:PORT …]`

use std::time::Duration;

use carom_farm::{Farm, FarmConfig, FrameSpec, PixelFormat, Pixels};
use carom_tracer::{ImageSize, RadianceImage, RenderSettings, Scene, SceneUpdate};

fn main() -> anyhow::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (Some(scene), Some(output)) = (arguments.next(), arguments.next()) else {
        anyhow::bail!("usage: one_frame SCENE.json OUT.png [NODE:PORT …]");
    };
    let mut farm = Farm::new(FarmConfig {
        nodes: arguments.collect(),
        ..FarmConfig::default()
    })?;
    farm.set_scene(&Scene::load(scene)?)?;
    farm.submit(FrameSpec {
        update: SceneUpdate::default(),
        size: ImageSize::new(1280, 720),
        settings: RenderSettings {
            samples: 16,
            ..RenderSettings::default()
        },
        format: PixelFormat::LinearF16,
    })?;
    let frame = loop {
        match farm.wait_frame(Duration::from_secs(2)) {
            Some(frame) => break frame,
            None => eprintln!("waiting for {:?}", farm.nodes()),
        }
    };
    let Pixels::Linear(pixels) = frame.pixels else {
        anyhow::bail!("linear pixels were asked for");
    };
    let size = frame.size;
    RadianceImage { size, pixels }.write_png(output, 1.0)?;
    let millis = 1e3 * frame.stats.makespan_secs;
    println!("{millis:.0} ms on {:?}", farm.nodes());
    Ok(())
}
