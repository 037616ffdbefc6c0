//! A red ball on a grey plane, on this machine or on the farm of `farm.toml`:
//! `cargo run --release -p carom-farm --example hello`

use carom_farm::prelude::*;

#[rustfmt::skip]
fn main() -> carom_farm::Result<()> {
    let mut scene = Scene::new().camera(Camera::looking_at([0.0, -4.0, 2.0], [0.0, 0.0, 0.5]));
    scene.add(Sphere::new(0.5).at([0.0, 0.0, 0.5]), Material::diffuse([0.8, 0.1, 0.1]));
    scene.add(Plane::z(0.0), Material::grey(0.5));
    Farm::auto()?.render(&scene, Still::new(640, 360).samples(64))?.save("hello.png")
}
