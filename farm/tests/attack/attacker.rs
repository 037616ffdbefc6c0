//! The attacker: `attacker.py`, a QUIC stack of its own, as a process.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Lines};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::LazyLock;

use carom_protocol::{
    CodedParticles, FrameId, PixelFormat, PrecisionRange, RequestId, SceneHash, ToNode,
    TraceRequest, codec, framing, message,
};
use carom_tracer::{ImageSize, RenderSettings, Scene, SceneUpdate, TileGrid, TileRange};
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
    /// Begins an attack on a node, and waits until it is on.
    pub(crate) fn start(python: &OsString, attack: &str, node: &AttackedNode) -> Self {
        write_messages(node.path());
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/attack/attacker.py");
        let mut child = Command::new(python)
            .args(["-B", script, attack, &node.address])
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

/// Messages that the attacker sends as they are.
fn write_messages(folder: &Path) {
    let scene = Scene::from_json(include_str!("../../../assets/scenes/pool.json")).unwrap();
    let hash = SceneHash::of(&scene);
    let write = |name: &str, message: &ToNode| {
        let bytes = codec::encode_to_node(message).unwrap();
        std::fs::write(folder.join(name), framing::frame(&bytes)).unwrap();
    };
    let trace = |scene: SceneHash, samples: u32| {
        // Little work, and more bytes than a window that is never opened further.
        let grid = TileGrid::new(ImageSize::new(320, 180), 32);
        ToNode::Trace(Box::new(TraceRequest {
            frame: FrameId(0),
            id: RequestId(1),
            scene,
            update: SceneUpdate::default(),
            grid,
            tiles: TileRange {
                count: grid.len(),
                ..grid.all()
            },
            settings: RenderSettings {
                samples,
                ..RenderSettings::default()
            },
            format: PixelFormat::LinearF32,
            precision: PrecisionRange::EXACT,
            references: Vec::new(),
            particles: CodedParticles::default(),
        }))
    };
    let version = message::VERSION;
    write("hello", &ToNode::Hello { version });
    write(
        "scene",
        &ToNode::Scene {
            hash,
            scene: Box::new(scene),
        },
    );
    write("trace", &trace(hash, 1));
    write("unknown-trace", &trace(SceneHash([9; 32]), 1));
}
