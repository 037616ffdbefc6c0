//! Farms whose nodes register in a NATS server: a real one, killed and restarted.

use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use carom_farm::directory::{NatsBucket, NatsRegistry, NodeRecord, Registry as _};
use carom_farm::net::{Authority, create_farm};
use carom_farm::{Farm, FarmConfig, LocalNode, NodeStatus};

use crate::greeter::any_port;
use crate::running_node::RunningNode;

struct NatsServer(Child);

impl NatsServer {
    /// Absent where the program is not installed.
    fn start(port: u16, store: &Path) -> Option<Self> {
        let server = Command::new("nats-server")
            .args(["-js", "-a", "127.0.0.1", "-p", &port.to_string(), "-sd"])
            .arg(store)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn();
        server.ok().map(Self)
    }
}

impl Drop for NatsServer {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A node that registers as `carom-farm node` does, more often; dropped, it leaves.
struct RegisteredNode {
    node: RunningNode,
    ends: Arc<AtomicBool>,
    registration: Option<JoinHandle<()>>,
}

impl RegisteredNode {
    fn start(authority: &Authority, bucket: &NatsBucket) -> Self {
        let node = RunningNode::start(authority, any_port());
        let ends = Arc::<AtomicBool>::default();
        let record = NodeRecord {
            address: node.address.to_string(),
            ..NodeRecord::default()
        };
        let (mut registry, ended) = (
            NatsRegistry::new(bucket.clone()).unwrap(),
            Arc::clone(&ends),
        );
        let registration = std::thread::spawn(move || {
            while !ended.load(Ordering::Relaxed) {
                let _ = registry.register(&record); // while the server is gone
                std::thread::sleep(Duration::from_millis(200));
            }
            registry.leave(&record).unwrap();
        });
        Self {
            node,
            ends,
            registration: Some(registration),
        }
    }
}

impl Drop for RegisteredNode {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        let ended = self.registration.take().map(JoinHandle::join);
        if !std::thread::panicking() {
            ended.unwrap().unwrap();
        }
    }
}

/// Waits until so many nodes answer; far longer than that takes is a failure.
fn wait_for(farm: &Farm, count: usize) -> Vec<NodeStatus> {
    for _ in 0..6000 {
        let nodes = farm.nodes();
        if nodes.iter().filter(|node| node.info.is_some()).count() == count {
            return nodes;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("{:?}", farm.nodes());
}

#[test]
fn a_farm_outlives_its_nats_server() {
    let folder = tempfile::tempdir().unwrap();
    let store = tempfile::tempdir().unwrap();
    let port = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let Some(server) = NatsServer::start(port, store.path()) else {
        println!("skipped: nats-server is not installed");
        return;
    };
    create_farm(folder.path()).unwrap();
    let authority = Authority::load(folder.path()).unwrap();
    let url = format!("nats://127.0.0.1:{port}/carom");
    let bucket: NatsBucket = url.parse().unwrap();
    let [oak, elm] = [(); 2].map(|()| RegisteredNode::start(&authority, &bucket));
    let farm = Farm::new(FarmConfig {
        local: LocalNode::None,
        nodes: vec![url],
        credentials: folder.path().to_owned(),
        ..FarmConfig::default()
    })
    .unwrap();
    wait_for(&farm, 2);
    drop(server);
    std::thread::sleep(Duration::from_secs(3));
    wait_for(&farm, 2);
    let server = NatsServer::start(port, store.path());
    // It has forgotten who was there; they register again, and so does one that is new.
    let ash = RegisteredNode::start(&authority, &bucket);
    wait_for(&farm, 3);
    let gone = elm.node.address.to_string();
    drop(elm);
    let nodes = wait_for(&farm, 2);
    assert!(
        nodes
            .iter()
            .all(|node| node.address != gone || node.info.is_none())
    );
    drop(farm);
    drop((oak, ash));
    drop(server);
}
