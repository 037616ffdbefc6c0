//! `carom-farm node`: this machine's devices, served to players.

use std::io::Write as _;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::task::{Context, Poll};

use carom_farm::NodeState;
use carom_farm::net::{Credentials, NodeServer, PacketHandler, Role, ServerEvent, StopHandle};
use carom_farm::node::{Node, NodeConnection, PlayerId};
use carom_protocol::session::{Packet, ReceivedScene};
use carom_protocol::{RequestId, codec};

use crate::commands::{Failure, inputs};
use carom_farm::backend::NodeBackend;

/// Trace for players until Ctrl-C or SIGTERM
///
/// Prints one line per change of state. Its first word is the state: starting, listening (with the
/// address), paired, syncing, ready, rendering, lost or draining.
#[derive(clap::Args)]
pub(crate) struct NodeArgs {
    /// Listen on this address, e.g. 0.0.0.0:4433, [::]:4433 or localhost:4433; port 0 lets the
    /// system choose
    #[arg(long, default_value = "0.0.0.0:4433", value_name = "HOST:PORT",
        value_parser = inputs::listen_address)]
    listen: SocketAddr,
    /// Read ca.pem, node.pem and node.key from this folder, which `join` or `add-node` created
    #[arg(long, default_value = ".carom")]
    credentials: PathBuf,
    /// Trace with these devices
    #[arg(long, default_value = "auto")]
    backend: NodeBackend,
    /// Use this many CPU threads; 0 means one per core
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u16).range(..=1024))]
    threads: u16,
}

pub(crate) fn run(args: &NodeArgs) -> Result<(), Failure> {
    let credentials = Credentials::load(&args.credentials, Role::Node)?;
    let mut server = NodeServer::bind(args.listen, &credentials)?;
    print_line(NodeState::Starting.word());
    let tracer = args.backend.open(usize::from(args.threads))?;
    let stop = StopHandle::default();
    let device = tracer.info().name;
    let node = Node::new(credentials.name(), tracer);
    let name = credentials.name().to_owned();
    let listening = NodeState::Listening.word();
    print_line(&format!(
        "{listening} as {name} with {device} on {}",
        server.local_addr()?
    ));
    print_box(&credentials, server.local_addr()?)?;
    server.keep_renewed(credentials, args.credentials.clone());
    server.serve(
        &stop,
        move |id, player| LoggedConnection::new(&node, id, player),
        |event| match event {
            ServerEvent::Renewed { last_day } => {
                print_line(&format!(
                    "renewed: the certificate is valid until {last_day}"
                ));
            }
            ServerEvent::Paired { player } => {
                print_line(&format!("{} with {player}", NodeState::Paired.word()));
            }
            ServerEvent::Left { player } => print_line(&format!("left by {player}")),
            ServerEvent::Lost { player, why } => print_line(&format!("lost {player}: {why}")),
            ServerEvent::Draining => print_line(NodeState::Draining.word()),
        },
    );
    Ok(())
}

/// Prints what a person needs to use this node.
fn print_box(credentials: &Credentials, local: SocketAddr) -> Result<(), Failure> {
    let address = format!("{}:{}", inputs::reachable_host(local), local.port());
    let lines = [
        format!("node     {}", credentials.name()),
        format!("address  {address} (UDP)"),
        format!("farm     {}", credentials.farm_fingerprint()),
        format!("valid    until {}", credentials.last_day()?),
        format!("play     carom --node {address}"),
    ];
    let width = lines.iter().map(String::len).max().unwrap_or_default();
    print_line(&format!("┌{}┐", "─".repeat(width + 2)));
    for line in lines {
        print_line(&format!("│ {line:<width$} │"));
    }
    print_line(&format!("└{}┘", "─".repeat(width + 2)));
    Ok(())
}

/// Prints a line. A reader of the output that has gone away does not end the node.
fn print_line(line: &str) {
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// A player's session that prints its changes of state. A player that has requested a picture
/// counts as rendering until it leaves or sends another scene: at 60 pictures a second, lines for
/// the pauses between them would be noise.
struct LoggedConnection {
    node: Arc<Node>,
    connection: NodeConnection,
    /// The device's name, which changes when a device fails or recovers.
    device: String,
    player: SocketAddr,
    state: NodeState,
}

impl LoggedConnection {
    fn new(node: &Arc<Node>, id: PlayerId, player: SocketAddr) -> Self {
        Self {
            node: Arc::clone(node),
            connection: node.connect(id),
            device: node.info().device.name,
            player,
            state: NodeState::Paired,
        }
    }

    /// Prints the state if it is new.
    fn set_state(&mut self, state: NodeState) {
        if self.state != state {
            print_line(&format!("{state} for {}", self.player));
            self.state = state;
        }
    }
}

impl PacketHandler for LoggedConnection {
    fn handle(&mut self, packet: Packet) -> Result<(), carom_protocol::Error> {
        let is_trace = codec::is_trace(&packet.bytes);
        self.connection.handle(packet)?;
        if is_trace {
            self.set_state(NodeState::Rendering);
        }
        let device = self.node.info().device.name;
        if device != self.device {
            let rendering = NodeState::Rendering.word();
            print_line(&format!("{rendering} with {device} for {}", self.player));
            self.device = device;
        }
        Ok(())
    }

    fn handle_scene(
        &mut self,
        scene: Result<ReceivedScene, carom_protocol::Error>,
    ) -> Result<(), carom_protocol::Error> {
        self.set_state(NodeState::Syncing { percent: 100 });
        self.connection.handle_scene(scene)?;
        self.set_state(NodeState::Ready);
        Ok(())
    }

    fn on_scene_progress(&mut self, bytes: usize, of: usize) {
        let percent = (100 * bytes / of.max(1)) as u8;
        self.set_state(NodeState::Syncing { percent });
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
