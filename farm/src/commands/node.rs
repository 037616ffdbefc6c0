//! `carom-farm node`: serves this machine's devices to players.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

use carom_farm::NodeState;
use carom_farm::directory::{NodeRecord, NodeSource, Registry};
use carom_farm::health::{HealthServer, MeteredTracer, NodeCounters, NodeProbe, watch_spot_notice};
use carom_farm::logging::LogFormat;
use carom_farm::net::{
    Credentials, NodeAddress, NodeServer, PacketHandler, Role, ServerEvent, StopHandle,
};
use carom_farm::node::{AssetCache, ConnectionDrain, Node, NodeConnection, PlayerId};
use carom_protocol::message::ToClient;
use carom_protocol::session::{Channel, Packet, SceneAssembler, SceneProgress};
use carom_protocol::{RequestId, codec};

use crate::commands::node_monitor::{NodeMonitor, RunningMonitor};
use crate::commands::{Failure, inputs, log_line};
use carom_farm::backend::NodeBackend;

/// Trace for players until Ctrl-C or SIGTERM
///
/// It then drains: what players have asked for is finished, for ten seconds at most, and they turn to
/// other nodes. The exit code is 0.
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
    /// Give each player at most this many seconds of the devices an hour [default: as many as nobody else
    /// asks for]
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u32).range(1..))]
    player_seconds: Option<u32>,
    /// Keep at most this many MiB of compiled scenes for each device; a player may have half of it
    #[arg(long, default_value_t = 1024, value_name = "MIB", value_parser = clap::value_parser!(u64).range(16..=1 << 20))]
    scene_memory: u64,
    /// Keep chunks of players' scenes in this folder, which nodes of one machine may share [default: carom/assets in the
    /// user's folder for caches]
    #[arg(long, value_name = "DIR")]
    asset_cache: Option<PathBuf>,
    /// Keep at most this many MiB there; 0 keeps none
    #[arg(long, default_value_t = 4096, value_name = "MIB", value_parser = clap::value_parser!(u64).range(0..=1 << 24))]
    asset_cache_size: u64,
    /// Answer GET /healthz, /readyz and /metrics and POST /drain by HTTP at this address, e.g.
    /// 127.0.0.1:8433; without a key, so keep it from strangers
    #[arg(long, value_name = "HOST:PORT", value_parser = inputs::listen_address)]
    health: Option<SocketAddr>,
    /// End when nothing has been traced for this time: 15m, 2h
    #[arg(long, value_name = "TIME", value_parser = inputs::duration)]
    exit_when_idle: Option<Duration>,
    /// Drain and end when EC2 gives notice that it takes this spot machine back
    #[arg(long)]
    spot_notice: bool,
    /// Register in this directory: nats://HOST:PORT/BUCKET, or mdns: for the local network
    #[arg(long, value_name = "DIRECTORY", value_parser = inputs::node)]
    register: Option<String>,
    /// Register at this address [default: that of this machine in its network]
    #[arg(long, value_name = "HOST:PORT", requires = "register")]
    advertise: Option<NodeAddress>,
}

pub(crate) fn run(args: &NodeArgs, log: LogFormat) -> Result<(), Failure> {
    let credentials = Credentials::load(&args.credentials, Role::Node)?;
    // Bound first, so that an unusable address is reported before devices are opened.
    let mut server = NodeServer::bind(args.listen, &credentials)?;
    let registry = args.registry()?;
    log_line::print(log, NodeState::Starting.word());
    let tracer = args.backend.open(usize::from(args.threads))?;
    let stop = StopHandle::default();
    let device = tracer.info().name;
    let counters = Arc::<NodeCounters>::default();
    let tracer = MeteredTracer::new(tracer, Arc::clone(&counters));
    let node = args.node(credentials.name(), tracer);
    let name = credentials.name().to_owned();
    let listening = NodeState::Listening.word();
    let address = server.local_addr()?;
    if let Some(health) = args.health {
        let info = Arc::clone(&node);
        let probe = NodeProbe {
            counters: Arc::clone(&counters),
            info: Arc::new(move || info.info()),
            stop: stop.clone(),
        };
        let health = HealthServer::start(health, probe)?.address();
        log_line::print(log, &format!("health at http://{health}"));
    }
    if args.spot_notice {
        watch_spot_notice(stop.clone())?;
    }
    let monitor = NodeMonitor {
        counters: Arc::clone(&counters),
        stop: stop.clone(),
        idle_exit: args.exit_when_idle,
        registry,
        record: NodeRecord {
            address: args.advertised(address),
            fingerprint: credentials.farm_fingerprint(),
            device: device.clone(),
            ..NodeRecord::default()
        },
        log,
    };
    let monitor = monitor.start()?;
    log_line::print(
        log,
        &format!("{listening} as {name} with {device} on {address}"),
    );
    if log == LogFormat::Plain {
        print_box(&credentials, address)?;
    }
    server.keep_renewed(credentials, args.credentials.clone());
    let wake = monitor.wake();
    let events = Arc::new(NodeEvents { counters, log });
    let sessions = Arc::clone(&events);
    server.serve(
        &stop,
        move |id, player| LoggedConnection::new(&node, &sessions, id, player),
        move |event| {
            let is_draining = event == ServerEvent::Draining;
            events.log(event);
            if is_draining {
                RunningMonitor::draining(&wake);
            }
        },
    );
    monitor.end();
    Ok(())
}

impl NodeArgs {
    fn node(&self, name: &str, tracer: MeteredTracer) -> Arc<Node> {
        let node = Node::new(name, Arc::new(tracer));
        node.set_scene_memory(self.scene_memory << 20);
        if let Some(cache) = self.asset_cache() {
            node.set_chunk_store(Arc::new(cache));
        }
        if let Some(secs_per_hour) = self.player_seconds {
            node.set_player_quota(f64::from(secs_per_hour));
        }
        node
    }

    /// The cache of scenes' chunks; without a usable folder the node works without one.
    fn asset_cache(&self) -> Option<AssetCache> {
        let bytes = self.asset_cache_size << 20;
        let folder = self.asset_cache.clone();
        let folder = folder.or_else(AssetCache::user_folder);
        let folder = folder.filter(|_| bytes > 0)?;
        let opened = AssetCache::open(&folder, bytes);
        let unused = |why: &std::io::Error| {
            tracing::warn!(
                "no scenes are kept on disk, as {} cannot be used ({why}): name another folder with --asset-cache",
                folder.display()
            );
        };
        opened.inspect_err(unused).ok()
    }

    fn registry(&self) -> Result<Option<Box<dyn Registry>>, Failure> {
        let Some(directory) = &self.register else {
            return Ok(None);
        };
        let registry = directory.parse::<NodeSource>()?.registry()?;
        registry.map(Some).ok_or_else(|| {
            Failure::Input(format!(
                "--register {directory}: a node can register in nats://HOST:PORT/BUCKET or mdns: only"
            ))
        })
    }

    fn advertised(&self, listen: SocketAddr) -> String {
        let own = || format!("{}:{}", inputs::reachable_host(listen), listen.port());
        self.advertise
            .as_ref()
            .map_or_else(own, NodeAddress::to_string)
    }
}

/// Recorder of a node's events, in counters and lines.
struct NodeEvents {
    counters: Arc<NodeCounters>,
    log: LogFormat,
}

impl NodeEvents {
    fn log(&self, event: ServerEvent) {
        let line = match event {
            ServerEvent::Renewed { last_day } => {
                format!("renewed: the certificate is valid until {last_day}")
            }
            ServerEvent::Paired { player } => {
                format!("{} with {player}", NodeState::Paired.word())
            }
            ServerEvent::Moved { player, to } => format!("{player} goes on from {to}"),
            ServerEvent::Left { player } => format!("left by {player}"),
            ServerEvent::Lost { player, why } => format!("lost {player}: {why}"),
            ServerEvent::Draining => {
                self.counters.drain();
                NodeState::Draining.word().to_owned()
            }
        };
        log_line::print(self.log, &line);
    }
}

/// Prints a box with what a person needs to use this node.
fn print_box(credentials: &Credentials, local: SocketAddr) -> Result<(), Failure> {
    let address = format!("{}:{}", inputs::reachable_host(local), local.port());
    let lines = [
        format!("node     {}", credentials.name()),
        format!("address  {address} (UDP)"),
        format!("farm     {}", credentials.farm_fingerprint()),
        format!("valid    until {}", credentials.last_day()?),
        format!("play     carom --node {address}"),
    ];
    let print_line = |line: &str| log_line::print(LogFormat::Plain, line);
    let width = lines.iter().map(String::len).max().unwrap_or_default();
    print_line(&format!("┌{}┐", "─".repeat(width + 2)));
    for line in lines {
        print_line(&format!("│ {line:<width$} │"));
    }
    print_line(&format!("└{}┘", "─".repeat(width + 2)));
    Ok(())
}

/// Session of a player that prints its changes of state. A player that has requested a picture counts as
/// rendering until it leaves or sends another scene: lines for the pauses between 60 pictures a second would
/// be noise.
struct LoggedConnection {
    node: Arc<Node>,
    events: Arc<NodeEvents>,
    connection: NodeConnection,
    /// Name of the device, which changes when a device fails or recovers.
    device: String,
    player: SocketAddr,
    state: NodeState,
}

impl LoggedConnection {
    fn new(node: &Arc<Node>, events: &Arc<NodeEvents>, id: PlayerId, player: SocketAddr) -> Self {
        events.counters.player_came();
        Self {
            node: Arc::clone(node),
            events: Arc::clone(events),
            connection: node.connect(id),
            device: node.info().device.name,
            player,
            state: NodeState::Paired,
        }
    }

    /// Sets the state, and prints it if it has changed.
    fn set_state(&mut self, state: NodeState) {
        if self.state != state {
            log_line::print(self.events.log, &format!("{state} for {}", self.player));
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
            let line = format!("{rendering} with {device} for {}", self.player);
            log_line::print(self.events.log, &line);
            self.device = device;
        }
        Ok(())
    }

    fn assembler(&self) -> SceneAssembler {
        self.connection.assembler()
    }

    fn handle_scene(
        &mut self,
        progress: Result<SceneProgress, carom_protocol::Error>,
    ) -> Result<(), carom_protocol::Error> {
        match &progress {
            Ok(SceneProgress::Received(_)) => self.set_state(NodeState::Ready),
            Ok(SceneProgress::Wanted { bytes, of, .. }) => {
                let (bytes, of) = (*bytes as u64, *of as u64);
                self.set_state(NodeState::Syncing { bytes, of });
            }
            Ok(SceneProgress::Coming { .. }) | Err(_) => {}
        }
        self.connection.handle_scene(progress)
    }

    fn poll_transmit(&mut self) -> Option<Packet> {
        let packet = self.connection.poll_transmit()?;
        let counters = &self.events.counters;
        counters.count_sent(packet.bytes.len());
        if packet.channel == Channel::Control
            && let Ok(ToClient::RequestDone(report)) = codec::decode_to_client(&packet.bytes)
        {
            counters.count_request(&report);
        }
        Some(packet)
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

    fn drain(&self) -> Option<ConnectionDrain> {
        self.connection.drain()
    }
}

impl Drop for LoggedConnection {
    fn drop(&mut self) {
        self.events.counters.player_left();
    }
}
