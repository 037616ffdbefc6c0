//! `carom-farm node`: this machine's device, served to players.

use std::io::Write as _;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::task::{Context, Poll};

use carom_farm::NodeState;
use carom_farm::net::{Credentials, NodeServer, PacketHandler, Role, ServerEvent, StopHandle};
use carom_farm::node::{Node, NodeConnection};
use carom_protocol::session::Packet;
use carom_protocol::{RequestId, ToNode, codec};

use crate::commands::Failure;
use carom_farm::backend::NodeBackend;

/// Trace for players, until Ctrl-C or SIGTERM.
///
/// Prints a line whenever the state changes, its first word being one of: starting, listening (with
/// the address), paired, syncing, ready, rendering, lost, draining.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Where to listen, as in 0.0.0.0:4433 or [::]:4433; port 0 lets the system choose.
    #[arg(long)]
    listen: SocketAddr,
    /// Folder with ca.pem, node.pem and node.key, as `add` made it.
    #[arg(long, default_value = ".carom")]
    credentials: PathBuf,
    /// What to trace with.
    #[arg(long, default_value = "auto")]
    backend: NodeBackend,
    /// Threads of the CPU back end; 0 is one per core.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: u16,
}

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    let credentials = Credentials::load(&args.credentials, Role::Node)?;
    let server = NodeServer::bind(args.listen, &credentials)?;
    say(NodeState::Starting.word());
    let tracer = args.backend.open(usize::from(args.threads))?;
    let stop = StopHandle::default();
    let device = tracer.info().name;
    let node = Node::new(credentials.name(), tracer);
    let name = credentials.name();
    let listening = NodeState::Listening.word();
    say(&format!(
        "{listening} as {name} with {device} on {}",
        server.local_addr()?
    ));
    server.serve(
        &stop,
        move |player| Watched::new(&node, player),
        |event| match event {
            ServerEvent::Paired { player } => {
                say(&format!("{} with {player}", NodeState::Paired.word()));
            }
            ServerEvent::Lost { player, why } => say(&format!("lost {player}: {why}")),
            ServerEvent::Draining => say(NodeState::Draining.word()),
        },
    );
    Ok(())
}

/// A reader that has gone away must not end the node.
fn say(line: &str) {
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// A player's session, whose changes of state are printed. A player that has asked for a picture
/// counts as rendering until it leaves or brings another scene: at 60 pictures a second, lines for
/// the pauses between them would tell nobody anything.
struct Watched {
    node: Arc<Node>,
    connection: NodeConnection,
    /// The device's name, which changes when one fails or is back.
    device: String,
    player: SocketAddr,
    state: NodeState,
}

impl Watched {
    fn new(node: &Arc<Node>, player: SocketAddr) -> Self {
        Self {
            node: Arc::clone(node),
            connection: node.connect(),
            device: node.info().device.name,
            player,
            state: NodeState::Paired,
        }
    }

    /// Says that it has come to a state, unless it was there already.
    fn come_to(&mut self, state: NodeState) {
        if self.state != state {
            say(&format!("{state} for {}", self.player));
            self.state = state;
        }
    }
}

impl PacketHandler for Watched {
    fn handle(&mut self, packet: Packet) -> Result<(), carom_protocol::Error> {
        let message = codec::decode_to_node(&packet.bytes);
        let is_scene = matches!(message, Ok(ToNode::Scene { .. }));
        if is_scene {
            self.come_to(NodeState::Syncing { percent: 100 });
        }
        self.connection.handle(packet)?;
        if is_scene {
            self.come_to(NodeState::Ready);
        }
        if matches!(message, Ok(ToNode::Trace(_))) {
            self.come_to(NodeState::Rendering);
        }
        let device = self.node.info().device.name;
        if device != self.device {
            let rendering = NodeState::Rendering.word();
            say(&format!("{rendering} with {device} for {}", self.player));
            self.device = device;
        }
        Ok(())
    }

    fn on_scene_progress(&mut self, bytes: usize, of: usize) {
        let percent = (100 * bytes / of.max(1)) as u8;
        self.come_to(NodeState::Syncing { percent });
        self.connection.on_scene_progress(bytes);
    }

    fn poll_transmit(&mut self) -> Option<Packet> {
        self.connection.poll_transmit()
    }

    fn poll_commands(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), carom_farm::Error>> {
        self.connection.poll_commands(cx)
    }

    fn take_cancelled(&mut self) -> Vec<RequestId> {
        self.connection.take_cancelled()
    }

    fn on_bandwidth(&mut self, bytes_per_sec: f64) {
        self.connection.on_bandwidth(bytes_per_sec);
    }
}
