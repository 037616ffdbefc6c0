//! The bench of large scenes: bytes and seconds until nodes behind emulated links hold one.

use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use carom_farm::net::{
    Authority, Client, LinkCommand, LinkEvent, NodeAddress, Role, TransportOptions,
};
use carom_farm::node::{AssetCache, Node};
use carom_protocol::session::ClientEvent;
use carom_protocol::{EncodedScene, PrecisionRange};
use carom_testkit::{link_emulator::LinkConfig, noise_tracer::NoiseTracer};
use carom_tracer::{Material, Mesh, Scene};
use glam::Vec3;
use serde::Serialize;

use crate::served_node::{self, ServedNode};
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
    /// Payload in both directions, without UDP and IP headers.
    megabytes: f64,
    /// Size of the scene.
    scene_megabytes: f64,
    /// Time from the welcome until the node holds the scene, or the connection breaks.
    secs: f64,
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let folder = tempfile::tempdir().context("a folder for chunks")?;
    let [first, second, third] = ["first", "second", "third"].map(|name| folder.path().join(name));
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

/// A scene of ten meshes; `seed` varies the fifth.
fn scene(args: &Args, seed: u32) -> Result<Arc<EncodedScene>, BenchError> {
    // Bytes per vertex: 12 of its position, 12 of its normal, and about nine of a triangle.
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

/// Sends the scene to a node with chunks in `folder` until it has `until` bytes of it.
fn measure(
    args: &Args,
    case: &'static str,
    folder: &Path,
    scene: &Arc<EncodedScene>,
    until: u64,
) -> Result<AssetRow, BenchError> {
    let authority = Authority::generate()?;
    let path = LinkConfig {
        delay: Duration::from_millis(args.delay),
        rate: Some(args.rate * 1e6),
        ..LinkConfig::default()
    };
    let node = Node::new("node", Arc::new(NoiseTracer::new(Duration::ZERO)));
    let cache = AssetCache::open(folder, 1 << 30).context("a folder for chunks")?;
    node.set_chunk_store(Arc::new(cache));
    let options = TransportOptions::default();
    let mut node = ServedNode::start(&authority, options, Some((path, 1)), move |server, stop| {
        server.serve(stop, move |player, _| node.connect(player), |_| {});
    })?;
    let client = Client::new(&served_node::credentials(&authority, Role::Player)?)?;
    let secs = send(args, client, node.address.into(), scene, until)?;
    node.end();
    let bytes = node.proxy.as_ref().map(|proxy| proxy.counts().passed_bytes);
    Ok(AssetRow {
        case,
        megabytes: bytes.unwrap_or(0) as f64 * 1e-6,
        scene_megabytes: scene.bytes() as f64 * 1e-6,
        secs,
    })
}

/// Sends the scene; returns the time in seconds.
fn send(
    args: &Args,
    client: Client,
    address: NodeAddress,
    scene: &Arc<EncodedScene>,
    until: u64,
) -> Result<f64, BenchError> {
    let (sender, events) = mpsc::channel();
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

const MESHES: u32 = 10;
