//! The bench of long scenes: bytes and seconds until nodes behind emulated links hold one.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Context, anyhow};
use carom_farm::net::{Authority, Client, LinkCommand, LinkEvent, NodeServer, Role, StopHandle};
use carom_farm::node::{AssetCache, Node};
use carom_protocol::session::ClientEvent;
use carom_protocol::{EncodedScene, PrecisionRange};
use carom_testkit::noise_tracer::NoiseTracer;
use carom_testkit::{link_emulator::LinkConfig, udp_proxy::UdpProxy};
use carom_tracer::{Material, Mesh, Scene};
use glam::Vec3;
use serde::Serialize;

use crate::wait::WaitArgs;
use crate::{BenchError, print_json};

/// Send a long scene to nodes over emulated links, and count bytes and seconds.
///
/// Each row is a node and its connection, which begin and end with it. Nodes keep chunks of scenes in folders: the first two
/// in folders of their own; the third shares the first one's, as another node of that machine does. The fourth
/// is the first after a restart, and is sent the scene with another mesh, one of ten. The last two have a new folder, and the
/// connection of the first of them breaks in the middle.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Millions of bytes of the scene.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=130))]
    megabytes: u32,
    /// Megabits a second of each link.
    #[arg(long, default_value_t = 100.0)]
    rate: f64,
    /// Milliseconds one way.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u64).range(0..=1000))]
    delay: u64,
    #[command(flatten)]
    wait: WaitArgs,
}

#[derive(Serialize)]
struct AssetRow {
    case: &'static str,
    /// Both ways, without those of UDP and IP.
    megabytes: f64,
    /// Of the scene.
    scene_megabytes: f64,
    /// From the welcome until the node holds the scene, or the connection breaks.
    secs: f64,
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let folder = CacheFolder::new()?;
    let [first, second, third] = ["first", "second", "third"].map(|name| folder.0.join(name));
    let scene = scene(args, 0)?;
    let changed = self::scene(args, 1)?;
    let whole = u64::MAX;
    let half = scene.bytes() as u64 / 2;
    let rows = [
        measure(args, "a node", &first, &scene, whole)?,
        measure(args, "a node of another machine", &second, &scene, whole)?,
        measure(
            args,
            "another node of the first machine",
            &first,
            &scene,
            whole,
        )?,
        measure(args, "one mesh of ten is another", &first, &changed, whole)?,
        measure(args, "broken off at half", &third, &scene, half)?,
        measure(args, "goes on", &third, &scene, whole)?,
    ];
    if args.json {
        print_json(&rows)?;
        return Ok(());
    }
    println!("{:<34}  MB sent  of scene's  seconds", "");
    for row in &rows {
        let AssetRow {
            case,
            megabytes,
            scene_megabytes,
            secs,
        } = row;
        println!("{case:<34}  {megabytes:>7.2}  {scene_megabytes:>10.2}  {secs:>7.2}");
    }
    Ok(())
}

/// Ten meshes; `seed` chooses the fifth.
fn scene(args: &Args, seed: u32) -> Result<Arc<EncodedScene>, BenchError> {
    // 12 bytes of a vertex, 12 of its normal, and nine or so of a triangle.
    let vertices = args.megabytes * 1_000_000 / MESHES / 33;
    let mut scene = Scene::new();
    for mesh in 0..MESHES {
        let salt = (mesh + if mesh == 4 { seed * MESHES } else { 0 }) << 24;
        let noise = |index: u32| (index ^ salt).wrapping_mul(2_654_435_761);
        let corner = |index| Vec3::new(index as f32, (noise(index) >> 9) as f32, mesh as f32);
        let normal =
            |index: u32| Vec3::new(1.0, noise(!index) as f32 * 1e-9, noise(index) as f32 * 1e-9);
        let corners = (0..vertices).map(corner).collect();
        let triangle = |index: u32| [index, index + 1, (noise(index) >> 8) % vertices];
        let triangles = (0..vertices - 1).map(triangle).collect();
        let mesh = Mesh::new(corners, triangles).normals((0..vertices).map(normal).collect());
        scene.add(mesh, Material::grey(0.5));
    }
    Ok(EncodedScene::new(&scene).context("the scene")?)
}

/// A node with chunks in `folder` gets the scene until it has so many bytes of it.
fn measure(
    args: &Args,
    case: &'static str,
    folder: &Path,
    scene: &Arc<EncodedScene>,
    until: u64,
) -> Result<AssetRow, BenchError> {
    let now = SystemTime::now();
    let day = Duration::from_secs(24 * 3600);
    let authority = Authority::generate()?;
    let issue = |role, name| authority.credentials(role, name, now - day..now + day);
    let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let server = NodeServer::bind(any, &issue(Role::Node, "node")?)?;
    let path = LinkConfig {
        delay: Duration::from_millis(args.delay),
        rate: Some(args.rate * 1e6),
        ..LinkConfig::default()
    };
    let proxy = UdpProxy::start(any, server.local_addr()?, path, 1).context("a proxy")?;
    let node = Node::new("node", Arc::new(NoiseTracer::new(Duration::ZERO)));
    let cache = AssetCache::open(folder, 1 << 30).context("a folder for chunks")?;
    node.set_chunk_store(Arc::new(cache));
    let stop = StopHandle::default();
    let stopped = stop.clone();
    let serve = move || server.serve(&stopped, move |player, _| node.connect(player), |_| {});
    let server = std::thread::spawn(serve);
    let secs = send(args, &issue(Role::Player, "player")?, &proxy, scene, until);
    stop.stop();
    let _ = server.join(); // a panic has been reported where it happened
    Ok(AssetRow {
        case,
        megabytes: proxy.counts().passed_bytes as f64 * 1e-6,
        scene_megabytes: scene.bytes() as f64 * 1e-6,
        secs: secs?,
    })
}

/// Seconds that it took.
fn send(
    args: &Args,
    player: &carom_farm::net::Credentials,
    proxy: &UdpProxy,
    scene: &Arc<EncodedScene>,
    until: u64,
) -> Result<f64, BenchError> {
    let client = Client::new(player)?;
    let (sender, events) = mpsc::channel();
    let address = proxy.local_addr().to_string();
    let address = address.parse().map_err(|why| anyhow!("{why}"))?;
    let link = client.link(address, PrecisionRange::EXACT, move |all| {
        all.into_iter().for_each(|event| drop(sender.send(event)));
    });
    let mut begun = Instant::now();
    let mut wait = args.wait.begin();
    loop {
        match events.recv_timeout(wait.left()) {
            Ok(LinkEvent::Session(ClientEvent::Welcome(_))) => {
                begun = Instant::now();
                link.send(LinkCommand::Scene(Arc::clone(scene)));
            }
            Ok(LinkEvent::Session(ClientEvent::SceneComing { bytes, .. })) if bytes < until => {
                wait = args.wait.begin();
            }
            Ok(LinkEvent::Session(
                ClientEvent::SceneReady(_) | ClientEvent::SceneComing { .. },
            )) => return Ok(begun.elapsed().as_secs_f64()),
            Ok(LinkEvent::Connecting) => {}
            Ok(other) => return Err(anyhow!("the node does not take the scene: {other:?}").into()),
            Err(RecvTimeoutError::Timeout) => {
                wait.check("the scene", || "nothing more of it comes".to_owned())?;
            }
            Err(RecvTimeoutError::Disconnected) => {
                return Err(anyhow!("the link to the node has ended").into());
            }
        }
    }
}

/// The nodes' folders; gone when dropped.
struct CacheFolder(PathBuf);

impl CacheFolder {
    fn new() -> Result<Self, BenchError> {
        let name = format!("carom-bench-assets-{}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir(&folder).context("a folder for chunks")?;
        Ok(Self(folder))
    }
}

impl Drop for CacheFolder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0); // of the system's temporary folder
    }
}

const MESHES: u32 = 10;
