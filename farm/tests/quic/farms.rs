//! Whole farms in one process, their nodes behind sockets.

use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use carom_farm::net::{Authority, NodeServer, PathConfig, Proxy, Role, Stop, create_farm};
use carom_farm::node::Node;
use carom_farm::{Farm, FarmConfig, Frame, FrameSpec, LocalNode, NodeState, PrecisionRange};
use carom_protocol::PixelFormat;
use carom_tracer::{CpuTracer, ImageSize, RenderSettings, Scene, SceneUpdate};

use crate::greeter::{any_port, today};

/// Far longer than anything here takes; a test that needs it has failed.
const PATIENCE: Duration = Duration::from_secs(120);

/// A node behind a socket, on a thread of its own.
struct Running {
    address: SocketAddr,
    stop: Stop,
    thread: Option<JoinHandle<()>>,
}

impl Running {
    fn start(authority: &Authority, address: SocketAddr) -> Self {
        let credentials = authority.credentials(Role::Node, "oak", today()).unwrap();
        let server = NodeServer::bind(address, &credentials).unwrap();
        let address = server.local_addr().unwrap();
        let node = Node::new("oak", Arc::new(CpuTracer::with_threads(1).unwrap()));
        let stop = Stop::default();
        let stopped = stop.clone();
        let thread = std::thread::spawn(move || {
            server.serve(&stopped, move |_| node.connect(), |_| {});
        });
        Self {
            address,
            stop,
            thread: Some(thread),
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop.stop();
        let ended = self.thread.take().map(JoinHandle::join);
        if !std::thread::panicking() {
            ended.unwrap().unwrap();
        }
    }
}

fn farm(credentials: &Path, nodes: &[SocketAddr]) -> Farm {
    let mut farm = Farm::new(FarmConfig {
        local: LocalNode::None,
        nodes: nodes.iter().map(SocketAddr::to_string).collect(),
        credentials: credentials.to_owned(),
        tile_edge: 16,
        precision: PrecisionRange::EXACT,
        ..FarmConfig::default()
    })
    .unwrap();
    farm.set_scene(&pool()).unwrap();
    farm
}

fn pool() -> Scene {
    Scene::from_json(include_str!("../../../assets/scenes/pool.json")).unwrap()
}

fn frame(farm: &mut Farm, format: PixelFormat) -> Frame {
    let settings = RenderSettings {
        samples: 2,
        seed: 11,
        ..RenderSettings::default()
    };
    farm.submit(FrameSpec {
        update: SceneUpdate::default(),
        size: ImageSize::new(150, 90),
        settings,
        format,
    })
    .unwrap();
    let waited = farm.wait_frame(PATIENCE);
    waited.unwrap_or_else(|| panic!("no frame, with nodes {:?}", farm.nodes()))
}

/// Waits until the only node is so, and returns how it is.
fn wait_until(farm: &Farm, is_so: impl Fn(&NodeState) -> bool) -> NodeState {
    loop {
        let state = farm.nodes().remove(0).state;
        if is_so(&state) {
            return state;
        }
        std::thread::yield_now();
    }
}

fn is_lost(state: &NodeState) -> bool {
    matches!(state, NodeState::Lost { .. })
}

#[test]
fn pixels_cross_the_network_unchanged_in_each_format() {
    let dir = tempfile::tempdir().unwrap();
    create_farm(dir.path()).unwrap();
    let authority = Authority::load(dir.path()).unwrap();
    let (oak, elm) = (
        Running::start(&authority, any_port()),
        Running::start(&authority, any_port()),
    );
    let mut remote = farm(dir.path(), &[oak.address, elm.address]);
    let tracer = Arc::new(CpuTracer::with_threads(1).unwrap());
    let mut local = Farm::with_tracers(FarmConfig::default(), vec![tracer]).unwrap();
    local.set_scene(&pool()).unwrap();
    for format in [
        PixelFormat::LinearF32,
        PixelFormat::LinearF16,
        PixelFormat::Srgb8 { exposure: 1.0 },
    ] {
        let (here, there) = (frame(&mut local, format), frame(&mut remote, format));
        assert!(here.pixels == there.pixels, "{format:?}");
        assert_eq!(there.stats.tiles_by_node.len(), 2);
    }
}

/// Tiles travel as datagrams there, and requests twice.
#[test]
fn pixels_survive_a_long_path_that_loses_and_reorders() {
    let dir = tempfile::tempdir().unwrap();
    create_farm(dir.path()).unwrap();
    let authority = Authority::load(dir.path()).unwrap();
    let oak = Running::start(&authority, any_port());
    let config = PathConfig {
        delay: Duration::from_millis(8),
        jitter: Duration::from_millis(1),
        loss: 0.1,
        burst: 2.0,
        reorder: 0.1,
        ..PathConfig::default()
    };
    let proxy = Proxy::start(any_port(), oak.address, config, 1).unwrap();
    let mut remote = farm(dir.path(), &[proxy.local_addr()]);
    let tracer = Arc::new(CpuTracer::with_threads(1).unwrap());
    let mut local = Farm::with_tracers(FarmConfig::default(), vec![tracer]).unwrap();
    local.set_scene(&pool()).unwrap();
    let format = PixelFormat::Srgb8 { exposure: 1.0 };
    let here = frame(&mut local, format);
    for _ in 0..20 {
        assert!(frame(&mut remote, format).pixels == here.pixels);
    }
    assert!(proxy.counts().lost > 0);
}

#[test]
fn a_node_that_restarts_on_its_port_is_found_again() {
    let dir = tempfile::tempdir().unwrap();
    create_farm(dir.path()).unwrap();
    let authority = Authority::load(dir.path()).unwrap();
    let oak = Running::start(&authority, any_port());
    let address = oak.address;
    let mut farm = farm(dir.path(), &[address]);
    let first = frame(&mut farm, PixelFormat::LinearF32);
    drop(oak);
    let lost = wait_until(&farm, is_lost);
    let why = "the node is shutting down".to_owned();
    assert!(
        lost.to_string().ends_with("tried again within 1 s)"),
        "{lost}"
    );
    let NodeState::Lost {
        why: given,
        retry_secs: Some(1),
    } = lost
    else {
        panic!("{lost:?}");
    };
    assert_eq!(given, why);
    let _oak = Running::start(&authority, address);
    let second = frame(&mut farm, PixelFormat::LinearF32);
    assert!(first.pixels == second.pixels);
    wait_until(&farm, NodeState::is_ready);
}

#[test]
fn a_node_of_another_farm_is_lost_with_the_reason() {
    let dir = tempfile::tempdir().unwrap();
    create_farm(dir.path()).unwrap();
    let oak = Running::start(&Authority::generate().unwrap(), any_port());
    let farm = farm(dir.path(), &[oak.address]);
    let NodeState::Lost { why, .. } = wait_until(&farm, is_lost) else {
        unreachable!();
    };
    assert_eq!(why, "its certificate is of another farm");
}

#[test]
fn a_node_that_does_not_answer_is_lost_with_what_to_check() {
    let dir = tempfile::tempdir().unwrap();
    create_farm(dir.path()).unwrap();
    let silent = UdpSocket::bind(any_port()).unwrap();
    let farm = farm(dir.path(), &[silent.local_addr().unwrap()]);
    let NodeState::Lost { why, .. } = wait_until(&farm, is_lost) else {
        unreachable!();
    };
    assert!(why.contains("does not answer"), "{why}");
    assert!(why.contains("firewall"), "{why}");
}
