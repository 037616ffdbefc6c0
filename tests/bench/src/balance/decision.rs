//! CPU time of the client to divide one frame among the nodes.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use carom_farm::coordinator::{Coordinator, CoordinatorAction};
use carom_farm::link::{LinkCommand, LinkEvent};
use carom_farm::{Balancing, FrameId, FrameSpec, NodeIndex, NodeInfo, PixelFormat};
use carom_protocol::session::ClientEvent;
use carom_protocol::tile_codec::TilePixels;
use carom_protocol::{
    EncodedScene, NodeLoad, PixelPrecision, RequestId, RequestReport, TraceRequest,
};
use carom_tracer::{DeviceInfo, DeviceKind, ImageSize, RenderSettings, Scene, SceneUpdate};
use cpu_time::ThreadTime;
use serde::Serialize;

use crate::timing::median;

/// CPU time from a frame's submission until all nodes have been asked for their parts.
#[derive(Serialize)]
pub(super) struct DivisionCost {
    pub(super) algorithm: Balancing,
    pub(super) nodes: usize,
    pub(super) tiles: u32,
    /// Median over the frames.
    pub(super) micros: f64,
}

/// Times a coordinator that divides frames among nodes of known, unequal speeds.
pub(super) fn measure(balancing: Balancing) -> DivisionCost {
    let mut coordinator = Coordinator::new(balancing);
    let scene = Scene::from_json(SCENE).expect("the built-in scene is right");
    let scene = EncodedScene::new(&scene).expect("the built-in scene is right");
    coordinator.set_scene(Arc::clone(&scene));
    for index in 0..NODES {
        let node = coordinator.add_node(format!("node {index}"));
        for event in [
            ClientEvent::Welcome(info()),
            ClientEvent::SceneReady(scene.hash()),
            ClientEvent::Pong {
                number: 1,
                load: NodeLoad::default(),
            },
        ] {
            coordinator.handle(Duration::ZERO, node, LinkEvent::Session(event));
        }
    }
    let micros = (0..FRAMES).map(|frame| divide(&mut coordinator, &scene, frame));
    let micros = median(micros);
    DivisionCost {
        algorithm: balancing,
        nodes: NODES,
        tiles: SIZE.width * SIZE.height,
        micros,
    }
}

/// Submits a frame and answers its requests; returns the time of the submission in µs.
fn divide(coordinator: &mut Coordinator, scene: &Arc<EncodedScene>, frame: u64) -> f64 {
    let now = Duration::from_secs(frame + 1);
    let spec = FrameSpec {
        update: SceneUpdate::default(),
        size: SIZE,
        settings: RenderSettings::default(),
        format: PixelFormat::LinearF32,
    };
    let scene = Arc::clone(scene);
    let begun = ThreadTime::now();
    coordinator.submit(now, FrameId(frame), spec, scene, 1, false);
    let micros = begun.elapsed().as_secs_f64() * 1e6;
    answer_all(coordinator, now);
    micros
}

/// Answers the nodes' requests in the order of time, until the frame is complete.
fn answer_all(coordinator: &mut Coordinator, mut now: Duration) {
    let mut asked: BTreeMap<(Duration, RequestId), (NodeIndex, Box<TraceRequest>)> =
        BTreeMap::new();
    loop {
        while let Some(action) = coordinator.poll_action() {
            match action {
                CoordinatorAction::Deliver(_) | CoordinatorAction::Refuse(_) => return,
                CoordinatorAction::Command {
                    node,
                    command: LinkCommand::Trace(request),
                } => {
                    let done = now + busy(node, &request) + Duration::from_millis(1);
                    asked.insert((done, request.id), (node, request));
                }
                CoordinatorAction::Command { .. }
                | CoordinatorAction::HangUp(_)
                | CoordinatorAction::Warn(_) => {}
            }
        }
        let ((done, _), (node, request)) = asked.pop_first().expect("the frame is asked for");
        now = done;
        answer(coordinator, now, node, &request);
    }
}

/// Time that a node works on a request; the first node is a hundred times as fast as the last.
fn busy(node: NodeIndex, request: &TraceRequest) -> Duration {
    let pace_secs = 1e-5 * 100f64.powf(node.0 as f64 / NODES as f64);
    Duration::from_secs_f64(pace_secs * f64::from(request.tiles.count))
}

fn answer(coordinator: &mut Coordinator, now: Duration, node: NodeIndex, request: &TraceRequest) {
    let frame = request.frame;
    let tiles = ClientEvent::Tiles {
        frame,
        request: request.id,
        tiles: request.tiles,
        pixels: TilePixels::Linear(vec![[1.0; 3]; request.tiles.count as usize]),
        busy_micros: busy(node, request).as_micros() as u32,
        times: carom_protocol::NodeTimes::default(),
        dropped_samples: 0,
        payload_bytes: 1,
        precision: PixelPrecision::Exact,
    };
    coordinator.handle(now, node, LinkEvent::Session(tiles));
    let report = RequestReport {
        request: request.id,
        ..RequestReport::default()
    };
    let done = ClientEvent::RequestDone { frame, report };
    coordinator.handle(now, node, LinkEvent::Session(done));
}

fn info() -> NodeInfo {
    NodeInfo {
        name: String::new(),
        instance: 0,
        device: DeviceInfo {
            kind: DeviceKind::Gpu,
            name: "none".into(),
            width: 1,
            threads: 1,
        },
    }
}

const SCENE: &str = include_str!("../../../../assets/scenes/pool.json");
const NODES: usize = 64;
const SIZE: ImageSize = ImageSize::new(60, 60);
const FRAMES: u64 = 100;
