//! Long scenes over the network: what has come once does not come again.

use std::net::SocketAddr;
use std::path::Path;
use std::sync::{Arc, mpsc};
use std::time::Duration;

use carom_farm::net::{
    Authority, Client, Credentials, LinkCommand, LinkEvent, NodeLink, Role, create_farm,
};
use carom_farm::node::{AssetCache, Node};
use carom_protocol::{ClientEvent, EncodedScene, PrecisionRange};
use carom_testkit::{link_emulator::LinkConfig, udp_proxy::UdpProxy};
use carom_tracer::{CpuTracer, Material, Mesh, Scene};
use glam::Vec3;

use crate::greeter::any_port;
use crate::running_node::RunningNode;

/// Far longer than anything here takes; a test that needs it has failed.
const TIMEOUT: Duration = Duration::from_secs(120);

/// A player's link to a node, and its events.
pub(crate) fn link(
    farm: &Path,
    node: SocketAddr,
) -> ((Client, NodeLink), mpsc::Receiver<LinkEvent>) {
    let player = Credentials::load(farm, Role::Player).unwrap();
    let client = Client::new(&player).unwrap();
    let (events, heard) = mpsc::channel();
    let address = node.to_string().parse().unwrap();
    let link = client.link(address, PrecisionRange::EXACT, move |all| {
        for event in all {
            let _ = events.send(event);
        }
    });
    ((client, link), heard)
}

/// Meshes of 4 MB each, drawn from seeds.
fn scene(seeds: &[u32]) -> Arc<EncodedScene> {
    let mut scene = Scene::new();
    for &seed in seeds {
        let corner = |index: u32| {
            let noise = (index ^ seed << 24).wrapping_mul(2_654_435_761);
            Vec3::new(index as f32, (noise >> 16) as f32, (noise & 0xffff) as f32)
        };
        let corners = (0..200_002).map(corner).collect();
        let triangle = |index: u32| [index ^ (seed % 2), index + 1, index + 2];
        let mesh = Mesh::new(corners, (0..200_000).map(triangle).collect());
        scene.add(mesh, Material::grey(0.5));
    }
    EncodedScene::new(&scene).unwrap()
}

struct TestFarm {
    folder: tempfile::TempDir,
    authority: Authority,
}

impl TestFarm {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        create_farm(folder.path()).unwrap();
        let authority = Authority::load(folder.path()).unwrap();
        Self { folder, authority }
    }

    fn cache(&self) -> std::path::PathBuf {
        self.folder.path().join("assets")
    }

    /// Starts a node with the farm's folder of chunks, and sends it a scene until so many bytes are there; returns the
    /// bytes that have passed, both ways, and what the node said to have.
    fn send(&self, scene: &Arc<EncodedScene>, until: u64) -> (u64, Vec<u64>) {
        let node = Node::new("any name", Arc::new(CpuTracer::with_threads(1).unwrap()));
        let cache = AssetCache::open(self.cache(), 1 << 30).unwrap();
        node.set_chunk_store(Arc::new(cache));
        let node = RunningNode::serve(&self.authority, any_port(), node);
        let path = LinkConfig {
            delay: Duration::from_millis(2),
            rate: Some(100e6),
            ..LinkConfig::default()
        };
        let proxy = UdpProxy::start(any_port(), node.address, path, 1).unwrap();
        let ((_client, link), heard) = link(self.folder.path(), proxy.local_addr());
        let mut progress = Vec::new();
        loop {
            match heard.recv_timeout(TIMEOUT).expect("the scene comes") {
                LinkEvent::Connecting => {}
                LinkEvent::Session(ClientEvent::Welcome(_)) => {
                    assert!(link.send(LinkCommand::Scene(Arc::clone(scene))));
                }
                LinkEvent::Session(ClientEvent::SceneComing { hash, bytes, of }) => {
                    assert_eq!((hash, of), (scene.hash(), scene.bytes() as u64));
                    progress.push(bytes);
                    if bytes >= until {
                        break;
                    }
                }
                LinkEvent::Session(ClientEvent::SceneReady(hash)) => {
                    assert_eq!(hash, scene.hash());
                    break;
                }
                other => panic!("{other:?}"),
            }
        }
        drop(link);
        // The first is the link's: it is about to ask.
        assert_eq!(progress.remove(0), 0);
        (proxy.counts().passed_bytes, progress)
    }
}

/// Whatever comes, but for the end of a scene.
const ALL: u64 = u64::MAX;
/// A list of chunks, handshakes, acknowledgements and what else belongs to a connection.
const OVERHEAD: u64 = 400_000;

#[test]
fn a_scene_goes_on_at_a_node_that_was_restarted_and_comes_once_to_a_machine() {
    let farm = TestFarm::new();
    let long = scene(&[1, 2, 3]);
    let size = long.bytes() as u64;
    assert!(size > 12_000_000, "{size}");
    let (first, progress) = farm.send(&long, size * 2 / 5);
    assert_eq!(progress[0], 0);
    assert!(progress.is_sorted());
    let (second, progress) = farm.send(&long, ALL);
    assert!(progress[0] >= size / 3, "{progress:?} of {size}");
    let both = first + second;
    assert!(both < size + size / 10, "{both} of {size}");
    // Another node of the machine has all that this one had.
    let (third, progress) = farm.send(&long, ALL);
    assert_eq!(progress, [size]);
    assert!(third < OVERHEAD, "{third}");
}

#[test]
fn of_another_scene_and_of_spoiled_files_only_that_comes_again() {
    let farm = TestFarm::new();
    let before = scene(&[1, 2, 3]);
    farm.send(&before, ALL);
    // One mesh of three is another.
    let after = scene(&[1, 4, 3]);
    let (changed, _) = farm.send(&after, ALL);
    let most = after.bytes() as u64 / 3 + 2 * 512 * 1024 + OVERHEAD;
    assert!(changed < most, "{changed} of {most}");
    let mut files = std::fs::read_dir(farm.cache()).unwrap();
    let file = files.next().unwrap().unwrap();
    let bytes = file.metadata().unwrap().len();
    std::fs::write(file.path(), vec![0; bytes as usize]).unwrap();
    // It belongs to one of the two.
    let both = [&before, &after].map(|scene| farm.send(scene, ALL).0);
    let most = bytes * 5 / 4 + 2 * OVERHEAD;
    assert!(both.iter().sum::<u64>() < most, "{both:?} of {most}");
    assert_eq!(file.metadata().unwrap().len(), bytes);
    let chunk = std::fs::read(file.path()).unwrap();
    assert!(chunk.iter().any(|&byte| byte != 0), "it is right again");
}
