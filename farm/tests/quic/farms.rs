//! Whole farms in one process, with their nodes behind sockets.

use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use carom_farm::net::{Authority, LinkEvent, NodeServer, Role, StopHandle, create_farm};
use carom_farm::node::Node;
use carom_farm::{
    Farm, FarmConfig, Film, Frame, FrameSpec, LocalNode, NodeState, PixelPrecision, PrecisionRange,
};
use carom_protocol::{ClientEvent, PixelFormat};
use carom_testkit::pattern_tracer::{DeviceFault, PatternTracer};
use carom_testkit::{link_emulator::LinkConfig, udp_proxy::UdpProxy};
use carom_tracer::{
    CompiledScene, CpuTracer, DeviceInfo, Error, ImageSize, RenderSettings, Scene, SceneUpdate,
    TileRadiance, TraceJob, TraceStats, Tracer,
};

use crate::assets::link;
use crate::greeter::{any_port, today};
use crate::running_node::RunningNode;

/// Far longer than anything here takes; a test that needs it has failed.
const TIMEOUT: Duration = Duration::from_secs(120);

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
    let waited = farm.wait_frame(TIMEOUT);
    waited.unwrap_or_else(|| panic!("no frame, with nodes {:?}", farm.nodes()))
}

#[test]
fn films_are_exact_over_links_that_may_send_less() {
    let folder = tempfile::tempdir().unwrap();
    create_farm(folder.path()).unwrap();
    let authority = Authority::load(folder.path()).unwrap();
    let node = RunningNode::start(&authority, any_port());
    let film = || {
        let film = Film::new(48, 27, vec![SceneUpdate::default()]);
        film.samples(2)
    };
    let coarse = PixelPrecision::Lossy50;
    let mut remote = Farm::new(FarmConfig {
        local: LocalNode::None,
        nodes: vec![node.address.to_string()],
        credentials: folder.path().to_owned(),
        precision: PrecisionRange {
            finest: coarse,
            coarsest: coarse,
        },
        ..FarmConfig::default()
    })
    .unwrap();
    let mut local = Farm::new(FarmConfig {
        local: LocalNode::Cpu,
        ..FarmConfig::default()
    })
    .unwrap();
    let frame = |farm: &mut Farm, name: &str| {
        let job = farm.film(&pool(), film(), folder.path().join(name));
        job.unwrap().wait().unwrap().read(0).unwrap()
    };
    assert!(frame(&mut remote, "remote") == frame(&mut local, "local"));
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
        RunningNode::start(&authority, any_port()),
        RunningNode::start(&authority, any_port()),
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

#[test]
fn one_handle_stops_all_servers_that_have_it() {
    let folder = tempfile::tempdir().unwrap();
    create_farm(folder.path()).unwrap();
    let authority = Authority::load(folder.path()).unwrap();
    let stop = StopHandle::default();
    let serve = |name: &str| {
        let server = NodeServer::bind(
            any_port(),
            &authority.credentials(Role::Node, name, today()).unwrap(),
        );
        let (server, stopped) = (server.unwrap(), stop.clone());
        let node = Node::new(name, Arc::new(CpuTracer::with_threads(1).unwrap()));
        std::thread::spawn(move || {
            server.serve(&stopped, move |player, _| node.connect(player), |_| {});
        })
    };
    let nodes = ["oak", "elm", "ash"].map(serve);
    stop.stop();
    for node in nodes {
        node.join().unwrap();
    }
}

/// Tiles travel as datagrams there, and requests twice.
/// Three nodes over the network, one of which sends a picture that is half as bright again.
#[test]
fn a_node_that_forges_pixels_is_dropped_and_the_others_go_on() {
    let dir = tempfile::tempdir().unwrap();
    create_farm(dir.path()).unwrap();
    let authority = Authority::load(dir.path()).unwrap();
    let start =
        |tracer: PatternTracer| RunningNode::start_with(&authority, any_port(), Arc::new(tracer));
    let forger = PatternTracer::new().with_fault(DeviceFault::Forgery, 0);
    let nodes = [PatternTracer::new(), forger, PatternTracer::new()].map(start);
    let mut farm = farm(dir.path(), &nodes.each_ref().map(|node| node.address));
    let dropped = |farm: &Farm| {
        let lost = |node: &carom_farm::NodeStatus| match &node.state {
            NodeState::Lost { why, .. } => why.contains("other pixels"),
            _ => false,
        };
        farm.nodes().iter().map(lost).collect::<Vec<_>>()
    };
    while dropped(&farm) == [false; 3] {
        frame(&mut farm, PixelFormat::LinearF32);
    }
    assert_eq!(dropped(&farm), [false, true, false], "{:?}", farm.nodes());
    let by_node = frame(&mut farm, PixelFormat::LinearF32).stats.tiles_by_node;
    assert_eq!(by_node.get(1).copied().unwrap_or(0), 0, "{by_node:?}");
}

#[test]
fn pixels_survive_a_long_path_that_loses_and_reorders() {
    let dir = tempfile::tempdir().unwrap();
    create_farm(dir.path()).unwrap();
    let authority = Authority::load(dir.path()).unwrap();
    let oak = RunningNode::start(&authority, any_port());
    let config = LinkConfig {
        delay: Duration::from_millis(8),
        jitter: Duration::from_millis(1),
        loss: 0.1,
        burst: 2.0,
        reorder: 0.1,
        ..LinkConfig::default()
    };
    let proxy = UdpProxy::start(any_port(), oak.address, config, 1).unwrap();
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
fn a_node_at_two_addresses_counts_once() {
    let dir = tempfile::tempdir().unwrap();
    create_farm(dir.path()).unwrap();
    let authority = Authority::load(dir.path()).unwrap();
    let oak = RunningNode::start(&authority, SocketAddr::from(([0; 4], 0)));
    let at = |last: u8| SocketAddr::from(([127, 0, 0, last], oak.address.port()));
    let farm = farm(dir.path(), &[at(1), at(2)]);
    let is_same = |state: &NodeState| state.sentence().contains("is the same node as 127.0.0.");
    let states = || farm.nodes().into_iter().map(|node| node.state);
    while !(states().any(|state| state.is_ready()) && states().any(|state| is_same(&state))) {
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Costs nothing, and no codec makes it smaller.
struct Static;

impl Tracer for Static {
    fn info(&self) -> DeviceInfo {
        crate::greeter::info().device
    }

    fn trace(
        &self,
        _: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileRadiance) + Sync),
    ) -> Result<TraceStats, Error> {
        let mut state = u64::from(job.settings.seed);
        let mut uniform = move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32
        };
        for (index, tile) in job.tiles.iter().enumerate() {
            let pixels = tile.width as usize * tile.height as usize;
            let radiance = (0..pixels).map(|_| [(); 3].map(|()| uniform())).collect();
            sink(TileRadiance {
                index,
                radiance,
                dropped_samples: 0,
            });
        }
        Ok(TraceStats::default())
    }
}

/// Packets that cross a path of 50 Mbit/s for frames of 8 MB in all.
fn packets_over(reorder: f64) -> u64 {
    let dir = tempfile::tempdir().unwrap();
    create_farm(dir.path()).unwrap();
    let authority = Authority::load(dir.path()).unwrap();
    let oak = RunningNode::start_with(&authority, any_port(), Arc::new(Static));
    let config = LinkConfig {
        delay: Duration::from_millis(10),
        rate: Some(50e6),
        queue_bytes: 1 << 20,
        reorder,
        ..LinkConfig::default()
    };
    let proxy = UdpProxy::start(any_port(), oak.address, config, 1).unwrap();
    let mut farm = farm(dir.path(), &[proxy.local_addr()]);
    for _ in 0..50 {
        frame(&mut farm, PixelFormat::LinearF32);
    }
    proxy.counts().passed
}

/// What was overtaken is neither taken for lost nor asked for again.
#[test]
fn reordered_packets_cost_no_retransmissions() {
    let (in_order, reordered) = (packets_over(0.0), packets_over(0.02));
    let ratio = reordered as f64 / in_order as f64;
    assert!(ratio < 1.2, "{reordered} packets for {in_order}");
}

#[test]
fn a_node_that_restarts_on_its_port_is_found_again() {
    let dir = tempfile::tempdir().unwrap();
    create_farm(dir.path()).unwrap();
    let authority = Authority::load(dir.path()).unwrap();
    let oak = RunningNode::start(&authority, any_port());
    let address = oak.address;
    let mut farm = farm(dir.path(), &[address]);
    let first = frame(&mut farm, PixelFormat::LinearF32);
    drop(oak);
    wait_until(&farm, is_lost);
    let _oak = RunningNode::start(&authority, address);
    let second = frame(&mut farm, PixelFormat::LinearF32);
    assert!(first.pixels == second.pixels);
    wait_until(&farm, NodeState::is_ready);
}

#[test]
fn a_node_that_stops_gives_its_reason() {
    let dir = tempfile::tempdir().unwrap();
    create_farm(dir.path()).unwrap();
    let authority = Authority::load(dir.path()).unwrap();
    let oak = RunningNode::start(&authority, any_port());
    let (_link, heard) = link(dir.path(), oak.address);
    let next = || heard.recv_timeout(TIMEOUT).expect("an event");
    assert_eq!(next(), LinkEvent::Connecting);
    let welcome = next();
    assert!(
        matches!(welcome, LinkEvent::Session(ClientEvent::Welcome(_))),
        "{welcome:?}"
    );
    drop(oak);
    assert_eq!(next(), LinkEvent::Session(ClientEvent::Leaving));
    let LinkEvent::Lost { why, retry } = next() else {
        panic!("the node is gone");
    };
    assert_eq!(why, "the node is shutting down");
    assert!(
        retry.is_some_and(|pause| pause <= Duration::from_secs(1)),
        "{retry:?}"
    );
}

#[test]
fn a_node_is_called_as_its_certificate_says() {
    let dir = tempfile::tempdir().unwrap();
    create_farm(dir.path()).unwrap();
    let authority = Authority::load(dir.path()).unwrap();
    let oak = RunningNode::start(&authority, any_port());
    let farm = farm(dir.path(), &[oak.address]);
    wait_until(&farm, NodeState::is_ready);
    let info = farm.nodes().remove(0).info;
    assert_eq!(info.map(|info| info.name).as_deref(), Some("oak"));
}

#[test]
fn a_node_of_another_farm_is_refused_with_a_reason() {
    let dir = tempfile::tempdir().unwrap();
    create_farm(dir.path()).unwrap();
    let oak = RunningNode::start(&Authority::generate().unwrap(), any_port());
    let farm = farm(dir.path(), &[oak.address]);
    let NodeState::Lost { why, .. } = wait_until(&farm, is_lost) else {
        unreachable!();
    };
    assert_eq!(why, "its certificate belongs to another farm");
}

#[test]
fn a_silent_node_is_lost_with_advice() {
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
