//! A custom directory, which tells a farm the current nodes: `cargo run --release -p carom-farm --example
//! own_directory -- FOLDER`. Each machine keeps a file with its address in the folder, on a shared disk.
//!
//! `cargo test -p carom-farm --test sim own_` runs it in the simulator.

use std::path::PathBuf;
use std::time::Duration;

use carom_farm::directory::{Directory, ListedNode};
use carom_farm::prelude::*;

/// Nodes that exist as long as their files do.
pub struct MyDirectory {
    /// Where the files are.
    pub folder: PathBuf,
}

impl Directory for MyDirectory {
    fn nodes(&mut self) -> carom_farm::Result<Vec<ListedNode>> {
        let path = self.folder.clone();
        let files =
            std::fs::read_dir(&self.folder).map_err(|source| Error::File { path, source })?;
        // A file that has vanished meanwhile belonged to a machine that has left.
        let addresses = files.filter_map(|file| std::fs::read_to_string(file.ok()?.path()).ok());
        addresses
            .map(|address| Ok(ListedNode::at(address.trim().parse()?)))
            .collect()
    }

    fn period(&self) -> Duration {
        Duration::from_secs(1)
    }
}

fn main() -> carom_farm::Result<()> {
    let mut scene = Scene::new().camera(Camera::looking_at([0.0, -4.0, 2.0], [0.0, 0.0, 0.5]));
    scene.add(Sphere::new(0.5).at([0.0, 0.0, 0.5]), Material::glass());
    scene.add(Plane::z(0.0), Material::diffuse([0.2, 0.4, 0.6]));
    let mut farm = Farm::auto()?;
    if let Some(folder) = std::env::args_os().nth(1) {
        let folder = PathBuf::from(folder);
        farm.add_directory(Box::new(MyDirectory { folder }))?; // needs the farm's credentials
    }
    farm.render(&scene, Still::new(640, 360))?
        .save("own_directory.png")
}
