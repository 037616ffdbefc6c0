//! The honest player: frames one after the other, timed.

use std::time::{Duration, Instant};

use carom_farm::{Farm, FarmConfig, FrameSpec, LocalNode};
use carom_protocol::PixelFormat;
use carom_tracer::{ImageSize, RenderSettings, Scene, SceneUpdate};

use crate::attacked_node::AttackedNode;

/// Frames whose times are compared, at least.
const FRAMES: usize = 200;
/// Far longer than a frame takes; a test that needs it has failed.
const PATIENCE: Duration = Duration::from_secs(60);

pub(crate) struct HonestPlayer(Farm);

impl HonestPlayer {
    /// A player that has had its first pictures.
    pub(crate) fn new(node: &AttackedNode) -> Self {
        let mut farm = Farm::new(FarmConfig {
            local: LocalNode::None,
            nodes: vec![node.address.clone(), node.rogue_address.clone()],
            credentials: node.path().join(".carom"),
            ..FarmConfig::default()
        })
        .unwrap();
        let scene = include_str!("../../../assets/scenes/pool.json");
        farm.set_scene(&Scene::from_json(scene).unwrap()).unwrap();
        let mut player = Self(farm);
        for _ in 0..20 {
            player.frame();
        }
        player
    }

    /// Traces a frame; returns how long it took.
    pub(crate) fn frame(&mut self) -> Duration {
        let begun = Instant::now();
        let spec = FrameSpec {
            update: SceneUpdate::default(),
            size: ImageSize::new(160, 90),
            settings: RenderSettings {
                samples: 8,
                ..RenderSettings::default()
            },
            format: PixelFormat::Srgb8 { exposure: 1.0 },
        };
        self.0.submit(spec).unwrap();
        let frame = self.0.wait_frame(PATIENCE);
        assert!(frame.is_some(), "no frame: {:?}", self.0.nodes());
        begun.elapsed()
    }

    /// The 99th percentile of the times of frames, which go on for `duration` at least, in seconds.
    pub(crate) fn p99_secs(&mut self, duration: Duration) -> f64 {
        let begun = Instant::now();
        let mut times = Vec::new();
        while times.len() < FRAMES || begun.elapsed() < duration {
            times.push(self.frame());
        }
        times.sort_unstable();
        times[times.len() * 99 / 100 - 1].as_secs_f64()
    }
}
