//! Progress within a frame, events of the farm, and a still that is cancelled after some seconds; the same
//! command resumes from its checkpoint: `cargo run --release -p carom-farm --example progress -- [SECONDS]`

use std::time::{Duration, Instant};

use carom_farm::prelude::*;

fn main() -> carom_farm::Result<()> {
    let seconds = std::env::args().nth(1).and_then(|count| count.parse().ok());
    let patience = Duration::from_secs(seconds.unwrap_or(10));
    let mut scene = Scene::new();
    scene.add(
        Sphere::new(0.5).at([0.0, 0.0, 0.5]),
        Material::plastic([0.1, 0.4, 0.2]),
    );
    scene.add(Plane::z(0.0), Material::grey(0.5));
    let mut farm = Farm::auto()?;
    let events = farm.events();
    let still = Still::new(1280, 720)
        .samples(1024)
        .checkpoint("progress.checkpoint", Duration::from_secs(5));
    let job = farm.still(&scene, still)?;
    println!("{} samples were there", job.resumed_samples());
    let begun = Instant::now();
    while !job.is_finished() {
        while let Some(event) = events.poll() {
            if let FarmEvent::Node { address, state, .. } = event {
                println!("{address} {}", state.sentence());
            }
        }
        println!("{:5.1} %", 100.0 * job.progress().fraction());
        if begun.elapsed() > patience {
            job.cancel();
        }
        std::thread::sleep(Duration::from_millis(250));
    }
    match job.wait() {
        Ok(picture) => {
            picture.save("progress.png")?;
            picture.remove_checkpoint()
        }
        Err(Error::Cancelled { samples_done }) => {
            println!("cancelled with {samples_done} samples: run it again to go on");
            Ok(())
        }
        Err(why) => Err(why),
    }
}
