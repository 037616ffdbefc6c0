//! A cluster on one machine: three nodes that listen on local sockets with a farm's certificates, and a client
//! that knows only their addresses: `cargo run --release -p carom-farm --example local_cluster`

use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use carom_farm::carom_tracer::CpuTracer;
use carom_farm::net::server::{NodeServer, StopHandle};
use carom_farm::net::{Credentials, Role, farm_folder};
use carom_farm::node::Node;
use carom_farm::prelude::*;

/// Starts a node with one thread on a free port; in production this is `carom-farm node` on another machine.
fn start(
    farm: &Path,
    name: &str,
    stop: &StopHandle,
) -> carom_farm::Result<(SocketAddr, JoinHandle<()>)> {
    let folder = farm_folder::add_node(farm, name, Some(&farm.join(name)), false)?;
    let credentials = Credentials::load(&folder, Role::Node)?;
    let server = NodeServer::bind((Ipv4Addr::LOCALHOST, 0).into(), &credentials)?;
    let address = server.local_addr()?;
    let node = Node::new(name, Arc::new(CpuTracer::with_threads(1)?));
    let stopped = stop.clone();
    let serve = move || server.serve(&stopped, move |player, _| node.connect(player), |_| {});
    Ok((address, thread::spawn(serve)))
}

fn main() -> carom_farm::Result<()> {
    let folder = std::env::temp_dir().join(format!("carom-cluster-{}", std::process::id()));
    farm_folder::create_farm(&folder)?; // `carom-farm init`
    let stop = StopHandle::default();
    let nodes = ["ash", "beech", "cedar"].map(|name| start(&folder, name, &stop));
    let nodes = nodes.into_iter().collect::<carom_farm::Result<Vec<_>>>()?;

    let mut farm = Farm::new(FarmConfig {
        local: LocalNode::None,
        nodes: nodes
            .iter()
            .map(|(address, _)| address.to_string())
            .collect(),
        credentials: folder.clone(),
        ..FarmConfig::default()
    })?;
    let mut scene = Scene::new();
    scene.add(Sphere::new(0.5).at([0.0, 0.0, 0.5]), Material::steel(0.2));
    scene.add(
        Cuboid::new([0.6; 3]).at([1.2, 0.4, 0.3]),
        Material::diffuse([0.2, 0.4, 0.7]),
    );
    scene.add(Plane::z(0.0), Material::grey(0.5));
    let picture = farm.render(&scene, Still::new(640, 360))?;
    for node in farm.nodes() {
        println!("{} traced {} tiles", node.address, node.tiles);
    }
    drop(farm);
    stop.stop();
    for (_, thread) in nodes {
        let _ = thread.join(); // a panic has been reported
    }
    let _ = std::fs::remove_dir_all(folder);
    picture.save("local_cluster.png")
}
