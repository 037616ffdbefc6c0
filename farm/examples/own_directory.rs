//! A directory of one's own, which a farm asks who is there: `cargo run --release -p carom-farm --example
//! own_directory`. This one reads the variable RENDER_NODES anew every five seconds, in place of some
//! service that knows the machines.

use std::time::Duration;

use carom_farm::directory::{Directory, ListedNode};
use carom_farm::prelude::*;

struct MyDirectory;

impl Directory for MyDirectory {
    fn nodes(&mut self) -> carom_farm::Result<Vec<ListedNode>> {
        let nodes = std::env::var("RENDER_NODES").unwrap_or_default();
        let nodes = nodes.split(',').filter(|node| !node.is_empty());
        nodes
            .map(|node| Ok(ListedNode::at(node.parse()?)))
            .collect()
    }

    fn period(&self) -> Duration {
        Duration::from_secs(5)
    }
}

fn main() -> carom_farm::Result<()> {
    let mut scene = Scene::new().camera(Camera::looking_at([0.0, -4.0, 2.0], [0.0, 0.0, 0.5]));
    scene.add(Sphere::new(0.5).at([0.0, 0.0, 0.5]), Material::glass());
    scene.add(Plane::z(0.0), Material::diffuse([0.2, 0.4, 0.6]));
    let mut farm = Farm::auto()?;
    if std::env::var_os("RENDER_NODES").is_some() {
        farm.add_directory(Box::new(MyDirectory))?; // needs the farm's credentials
    }
    farm.render(&scene, Still::new(640, 360))?
        .save("own_directory.png")
}
