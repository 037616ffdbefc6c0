//! Nodes that are told to end while they trace.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use carom_farm::net::{Authority, create_farm};
use carom_farm::{Farm, FarmConfig, Frame, FrameSpec, LocalNode, PixelFormat};
use carom_testkit::pattern_tracer::{self, PatternTracer};
use carom_tracer::{ImageSize, RenderSettings, SceneUpdate};

use crate::greeter::any_port;
use crate::running_node::RunningNode;

/// A node that takes `pace` for a tile.
pub(crate) fn paced_node(authority: &Authority, pace: Duration) -> RunningNode {
    let tracer = PatternTracer::new().with_pace(pace.as_micros() as u64);
    RunningNode::start_with(authority, any_port(), Arc::new(tracer))
}

/// Connected nodes that hold a scene.
pub(crate) fn farm(credentials: &Path, nodes: &[&RunningNode]) -> Farm {
    let mut farm = Farm::new(FarmConfig {
        local: LocalNode::None,
        nodes: nodes.iter().map(|node| node.address.to_string()).collect(),
        credentials: credentials.to_owned(),
        tile_edge: 16,
        ..FarmConfig::default()
    })
    .unwrap();
    farm.set_scene(&pattern_tracer::scene()).unwrap();
    while !farm.nodes().iter().all(|node| node.state.is_ready()) {
        std::thread::sleep(Duration::from_millis(1));
    }
    farm
}

/// Asks for a picture of 60 tiles.
pub(crate) fn submit(farm: &mut Farm) {
    let spec = FrameSpec {
        update: SceneUpdate::default(),
        size: ImageSize::new(160, 96),
        settings: RenderSettings {
            samples: 1,
            ..RenderSettings::default()
        },
        format: PixelFormat::Srgb8 { exposure: 1.0 },
    };
    farm.submit(spec).unwrap();
}

fn wait(farm: &mut Farm) -> Frame {
    let frame = farm.wait_frame(Duration::from_secs(60));
    frame.unwrap_or_else(|| panic!("no frame, with nodes {:?}", farm.nodes()))
}

#[test]
fn what_a_node_has_been_asked_for_is_finished_before_it_ends() {
    let folder = tempfile::tempdir().unwrap();
    create_farm(folder.path()).unwrap();
    let authority = Authority::load(folder.path()).unwrap();
    let oak = paced_node(&authority, Duration::from_millis(10));
    let mut farm = farm(folder.path(), &[&oak]);
    submit(&mut farm);
    std::thread::sleep(Duration::from_millis(100));
    assert!(farm.poll_frame().is_none(), "the node is at work");
    oak.stop.stop();
    let frame = wait(&mut farm);
    assert_eq!(frame.stats.lost_tiles, 0);
    drop(oak);
    while !farm.nodes()[0].state.sentence().contains("shutting down") {
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// A busy machine may hold the node up until it counts as silent, which no drain is to blame for: of a few runs one
/// must be without.
#[test]
fn no_tile_is_lost_while_a_node_of_two_drains() {
    let lost_tiles = (0..5).map(|_| tiles_lost_by_a_drain());
    assert!(lost_tiles.into_iter().any(|lost| lost == 0));
}

/// Tiles that a node loses from when it is told to end. Prints them, and how much later the latest frame comes than the
/// latest before: on a machine with nothing else to do less than a period of 60 frames a second.
fn tiles_lost_by_a_drain() -> u64 {
    let folder = tempfile::tempdir().unwrap();
    create_farm(folder.path()).unwrap();
    let authority = Authority::load(folder.path()).unwrap();
    let pace = Duration::from_micros(100);
    let [oak, elm] = [(); 2].map(|()| paced_node(&authority, pace));
    let mut farm = farm(folder.path(), &[&oak, &elm]);
    let begun = Instant::now();
    let mut frames = Vec::new();
    let mut lost_before = 0;
    for frame in 0..FRAMES {
        if frame == FRAMES / 2 {
            lost_before = farm.nodes()[0].lost_tiles;
            oak.stop.stop();
        }
        let due = begun + PERIOD * frame;
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        submit(&mut farm);
        while let Some(done) = match farm.in_flight() {
            0..4 => farm.poll_frame(),
            _ => Some(wait(&mut farm)),
        } {
            frames.push(done);
        }
    }
    while farm.in_flight() > 0 {
        frames.push(wait(&mut farm));
    }
    let lost_tiles = farm.nodes()[0].lost_tiles - lost_before;
    assert_eq!(frames.len(), FRAMES as usize);
    assert!(frames.iter().all(|frame| frame.missing.is_empty()));
    let latest_ms = |frames: &[Frame]| {
        let makespans = frames.iter().map(|frame| frame.stats.makespan_secs);
        1e3 * makespans.fold(0.0, f64::max)
    };
    let (before, after) = frames.split_at(FRAMES as usize / 2);
    // Until the pipe is full nothing is known of the nodes.
    let later_ms = latest_ms(after) - latest_ms(&before[30..]);
    println!(
        "{lost_tiles} tiles lost, the latest frame {later_ms:.1} ms later than the latest before"
    );
    lost_tiles
}

const FRAMES: u32 = 240;
const PERIOD: Duration = Duration::from_nanos(1_000_000_000 / 60);
