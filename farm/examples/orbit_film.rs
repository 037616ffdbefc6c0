//! A camera orbit as an animated PNG; after Ctrl-C the same command resumes with the missing frames: `cargo run --release -p carom-farm --example orbit_film -- [FRAMES] [SAMPLES]`

use std::f32::consts::TAU;

use carom_farm::prelude::*;

fn main() -> carom_farm::Result<()> {
    let mut arguments = std::env::args()
        .skip(1)
        .map(|count| count.parse::<u16>().ok());
    let frames = arguments.next().flatten().unwrap_or(48);
    let samples = arguments.next().flatten().unwrap_or(32);
    let mut scene = Scene::new();
    for (x, material) in [
        (-1.1, Material::plastic([0.7, 0.1, 0.1])),
        (0.0, Material::glass()),
        (1.1, Material::gold(0.2)),
    ] {
        scene.add(Sphere::new(0.5).at([x, 0.0, 0.5]), material);
    }
    scene.add(Plane::z(0.0), Material::wood(Axis::X));
    let orbit = (0..frames).map(|frame| {
        let (sin, cos) = (TAU * f32::from(frame) / f32::from(frames)).sin_cos();
        let eye = [4.0 * sin, -4.0 * cos, 1.6];
        SceneUpdate::default().camera(Camera::looking_at(eye, [0.0, 0.0, 0.4]))
    });
    let film = Film::new(320, 180, orbit)
        .samples(samples.into())
        .on_progress(|progress| {
            if progress.frame.is_some() {
                println!("{} of {} frames", progress.frames_done, progress.frames);
            }
        });
    let film = Farm::auto()?.film(&scene, film, "orbit.frames")?.wait()?;
    film.save("orbit_film.png", 24)?;
    film.remove()
}
