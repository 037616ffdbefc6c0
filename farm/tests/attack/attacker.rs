//! The attacker: `attacker.py`, a QUIC stack of its own, as a process.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Lines};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::LazyLock;

use carom_protocol::{
    ClientSession, CodedParticles, EncodedScene, FrameId, NodeInfo, NodeSession, PixelFormat,
    PrecisionRange, RequestId, SceneHash, ToClient, ToNode, TraceRequest, codec, framing, message,
};
use carom_tracer::texture_file::{self, Texels};
use carom_tracer::{
    DeviceInfo, DeviceKind, ImageSize, ImageTexture, Material, Mesh, RenderSettings, Scene,
    SceneUpdate, TileGrid,
};
use glam::Vec3;
use serde_json::{Map, Value};

use crate::attacked_node::AttackedNode;

/// A Python with aioquic: `CAROM_ATTACK_PYTHON`, or the system's. None where neither has it, which is
/// an error if `CAROM_REQUIRE_ATTACKS` is set.
pub(crate) static PYTHON: LazyLock<Option<OsString>> = LazyLock::new(|| {
    let python = std::env::var_os("CAROM_ATTACK_PYTHON").unwrap_or_else(|| "python3".into());
    let imports = Command::new(&python)
        .args(["-c", "import aioquic"])
        .output();
    if imports.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    let advice = "no Python with aioquic: python3 -m venv VENV; VENV/bin/pip install aioquic; \
                  CAROM_ATTACK_PYTHON=VENV/bin/python";
    assert!(
        std::env::var_os("CAROM_REQUIRE_ATTACKS").is_none(),
        "{advice}"
    );
    eprintln!("skipped: {advice}");
    None
});

/// An attack that is going on; it ends with [`Attacker::end`].
pub(crate) struct Attacker {
    child: Child,
    lines: Lines<BufReader<ChildStdout>>,
}

impl Attacker {
    /// Begins an attack with what a player of the node knows, at the node's address or at another one, and
    /// waits until it is on.
    pub(crate) fn start(
        python: &OsString,
        attack: &str,
        node: &AttackedNode,
        address: &str,
    ) -> Self {
        for (name, bytes) in &*MESSAGES {
            std::fs::write(node.path().join(name), bytes).unwrap();
        }
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/attack/attacker.py");
        let mut child = Command::new(python)
            .args(["-B", script, attack])
            .args([address, &node.rogue_address])
            .arg(node.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut attacker = Self { child, lines };
        assert_eq!(attacker.line(), "attacking");
        attacker
    }

    /// Ends the attack. Returns what the attacker has counted.
    pub(crate) fn end(mut self) -> Map<String, Value> {
        drop(self.child.stdin.take());
        let counts = serde_json::from_str(&self.line()).unwrap();
        self.child.wait().unwrap();
        counts
    }

    fn line(&mut self) -> String {
        let line = self
            .lines
            .next()
            .expect("the attacker has failed, see above");
        line.unwrap()
    }
}

impl Drop for Attacker {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A file with a message, as framed bytes.
type MessageFile = (String, Vec<u8>);

/// Messages that the attacker sends as they are.
static MESSAGES: LazyLock<Vec<MessageFile>> = LazyLock::new(|| {
    let scene = Scene::from_json(include_str!("../../../assets/scenes/pool.json")).unwrap();
    let hash = SceneHash::of(&scene);
    let version = message::VERSION;
    // Little work, and more bytes than a window that is never opened further.
    let many_pixels = ImageSize::new(320, 180);
    let nobodys = SceneHash([9; 32]);
    let mut files = vec![
        message_file("hello", &ToNode::Hello { version }),
        message_file("scene", &scene_message(&scene)),
        message_file("trace", &trace(hash, many_pixels)),
        message_file("unknown-trace", &trace(nobodys, many_pixels)),
    ];
    for index in 0..BOMBS {
        let bomb = texture_bomb(&scene, index);
        let name = format!("bomb-{index}");
        let few_pixels = ImageSize::new(32, 32);
        let request = trace(SceneHash::of(&bomb), few_pixels);
        files.push(message_file(&format!("trace-{name}"), &request));
        files.push(message_file(&name, &scene_message(&bomb)));
    }
    let node = node_info();
    let welcome = codec::encode_to_client(&ToClient::Welcome { version, node }).unwrap();
    files.push(("welcome".to_owned(), framing::frame(&welcome)));
    files.extend(long_scene());
    files
});

fn node_info() -> NodeInfo {
    let device = DeviceInfo {
        kind: DeviceKind::Cpu,
        name: "a device".to_owned(),
        width: 16,
        threads: 1,
    };
    NodeInfo {
        name: "birch".to_owned(),
        instance: 0,
        device,
    }
}

/// What a player sends of a scene of 20 MB, and what of one whose chunks the node has.
fn long_scene() -> [MessageFile; 2] {
    let number = |index: u32| index.wrapping_mul(2_654_435_761);
    let corner = |index: u32| Vec3::new(index as f32, (number(index) >> 9) as f32, 0.0);
    let mut scene = Scene::new();
    scene.add(
        Mesh::new(
            (0..1_000_002).map(corner).collect(),
            (0..1_000_000)
                .map(|first| [first, first + 1, first + 2])
                .collect(),
        ),
        Material::grey(0.5),
    );
    let mut client = ClientSession::new();
    let mut node = NodeSession::new(node_info());
    client
        .set_scene(&EncodedScene::new(&scene).unwrap())
        .unwrap();
    let (mut whole, mut again) = (Vec::new(), Vec::new());
    loop {
        while let Some(packet) = node.poll_transmit() {
            client.handle(packet).unwrap();
        }
        let Some(packet) = client.poll_transmit() else {
            break;
        };
        let framed = framing::frame(&packet.bytes);
        match codec::decode_to_node(&packet.bytes).unwrap() {
            ToNode::Manifest { .. } | ToNode::ChunksSent(_) => {
                again.extend_from_slice(&framed);
                whole.extend(framed);
            }
            ToNode::Chunk { .. } => whole.extend(framed),
            _ => {}
        }
        node.handle(packet).unwrap();
    }
    [("long-scene", whole), ("long-scene-again", again)]
        .map(|(name, bytes)| (name.to_owned(), bytes))
}

/// Scenes with textures that are small as files.
const BOMBS: u8 = 3;

/// A scene with a picture of one colour, 17 kB that are decoded to 16 MiB.
fn texture_bomb(scene: &Scene, index: u8) -> Scene {
    const EDGE: u32 = 2048;
    let texels = Texels {
        size: [EDGE; 2],
        texels: vec![[index; 4]; (EDGE * EDGE) as usize],
    };
    let file = texture_file::encode_png(&texels).unwrap();
    let mut bomb = scene.clone();
    bomb.textures.push(ImageTexture::new("a bomb", file));
    bomb
}

fn scene_message(scene: &Scene) -> ToNode {
    ToNode::Scene {
        hash: SceneHash::of(scene),
        scene: Box::new(scene.clone()),
    }
}

/// A request for a picture of one sample.
fn trace(scene: SceneHash, size: ImageSize) -> ToNode {
    let grid = TileGrid::new(size, 32);
    ToNode::Trace(Box::new(TraceRequest {
        frame: FrameId(0),
        id: RequestId(1),
        scene,
        update: SceneUpdate::default(),
        grid,
        tiles: grid.all(),
        settings: RenderSettings {
            samples: 1,
            ..RenderSettings::default()
        },
        format: PixelFormat::LinearF32,
        precision: PrecisionRange::EXACT,
        references: Vec::new(),
        particles: CodedParticles::default(),
    }))
}

fn message_file(name: &str, message: &ToNode) -> MessageFile {
    let bytes = codec::encode_to_node(message).unwrap();
    (name.to_owned(), framing::frame(&bytes))
}
