//! A node that several players share.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use carom_farm::net::{Authority, AuthorityFolder, Role, create_farm};
use carom_farm::{Farm, FarmConfig, FrameSpec, LocalNode, PrecisionRange};
use carom_protocol::PixelFormat;
use carom_tracer::{CpuTracer, ImageSize, RenderSettings, Scene, SceneUpdate};

use crate::drain::{farm, paced_node, submit};
use crate::greeter::any_port;
use crate::running_node::RunningNode;

#[test]
fn a_player_is_told_how_much_of_a_node_others_have() {
    let folder = tempfile::tempdir().unwrap();
    create_farm(folder.path()).unwrap();
    let authority = Authority::load(folder.path()).unwrap();
    let issuer = AuthorityFolder::open(folder.path(), None).unwrap();
    let bob = issuer.add(Role::Player, "bob", None, false).unwrap();
    let node = paced_node(&authority, Duration::from_millis(20));
    let mut busy = farm(folder.path(), &[&node]);
    let watching = farm(&bob, &[&node]);
    let load = || watching.nodes()[0].load;
    assert_eq!((load().players, load().busy_percent), (0, 0));
    // A picture takes 1.2 s.
    while load().busy_percent < 50 {
        if busy.in_flight() == 0 {
            submit(&mut busy);
        }
        drop(busy.poll_frame());
        std::thread::sleep(Duration::from_millis(5));
    }
    assert_eq!(load().players, 1);
    assert_eq!(
        busy.nodes()[0].load.players,
        0,
        "its own work is no others'"
    );
}

/// A picture of so many samples of the pool table, in tiles of 64 × 64 pixels.
fn picture(size: ImageSize, samples: u32) -> FrameSpec {
    FrameSpec {
        update: SceneUpdate::default(),
        size,
        settings: RenderSettings {
            samples,
            ..RenderSettings::default()
        },
        format: PixelFormat::LinearF32,
    }
}

fn player(credentials: &Path, node: &RunningNode) -> Farm {
    let config = FarmConfig {
        local: LocalNode::None,
        nodes: vec![node.address.to_string()],
        credentials: credentials.to_owned(),
        tile_edge: 64,
        precision: PrecisionRange::EXACT,
        ..FarmConfig::default()
    };
    with_pool(Farm::new(config).unwrap())
}

fn with_pool(mut farm: Farm) -> Farm {
    let scene = Scene::from_json(include_str!("../../../assets/scenes/pool.json")).unwrap();
    farm.set_scene(&scene).unwrap();
    farm
}

#[test]
fn a_tile_that_takes_seconds_keeps_no_other_player_waiting() {
    keeps_no_other_player_waiting(picture(ImageSize::new(64, 64), 4096));
}

#[test]
fn a_denoised_tile_that_takes_seconds_keeps_no_other_player_waiting() {
    // With the guard bands of its parts.
    let mut dear = picture(ImageSize::new(64, 64), 512);
    dear.settings.denoise = true;
    keeps_no_other_player_waiting(dear);
}

/// A picture of one tile that takes a second at least is traced between another player's pictures, and right.
fn keeps_no_other_player_waiting(dear: FrameSpec) {
    const PATIENCE: Duration = Duration::from_secs(120);
    let folder = tempfile::tempdir().unwrap();
    create_farm(folder.path()).unwrap();
    let authority = Authority::load(folder.path()).unwrap();
    let issuer = AuthorityFolder::open(folder.path(), None).unwrap();
    let bob = issuer.add(Role::Player, "bob", None, false).unwrap();
    let node = RunningNode::start(&authority, any_port());
    let mut greedy = player(folder.path(), &node);
    let mut honest = player(&bob, &node);
    let small = picture(ImageSize::new(16, 16), 1);
    for farm in [&mut greedy, &mut honest] {
        farm.submit(small.clone()).unwrap();
        farm.wait_frame(PATIENCE).expect("a first picture");
    }
    greedy.submit(dear.clone()).unwrap();
    let mut frames = 0;
    let whole = loop {
        honest.submit(small.clone()).unwrap();
        honest.wait_frame(PATIENCE).expect("the node is not idle");
        frames += 1;
        if let Some(whole) = greedy.poll_frame() {
            break whole;
        }
    };
    // Slices of 50 ms.
    assert!(frames > 5, "{frames} frames beside a tile that takes long");
    let tracer = Arc::new(CpuTracer::with_threads(1).unwrap());
    let mut local = with_pool(Farm::with_tracers(FarmConfig::default(), vec![tracer]).unwrap());
    local.submit(dear).unwrap();
    let here = local.wait_frame(PATIENCE).expect("a picture");
    assert!(whole.pixels == here.pixels, "parts change a pixel");
}
