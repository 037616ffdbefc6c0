//! A player's links: one task a node, which calls, runs the session, decodes, and calls again.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

use carom_protocol::PrecisionRange;
use carom_protocol::session::Packet;
use tokio::runtime::Runtime;
use tokio::sync::mpsc;
use tokio::time::Instant;

use crate::Error;
use crate::link::LinkSession;
pub use crate::link::{Command, LinkEvent};
use crate::net::address::NodeAddress;
use crate::net::connection_driver::{self, Peer};
use crate::net::connector::Caller;
use crate::net::credentials::Credentials;

/// All of a player's links.
pub struct Client {
    networks: Vec<Network>,
    links: AtomicUsize,
}

/// A thread with its sockets and links of its own.
struct Network {
    runtime: Runtime,
    caller: Arc<Caller>,
}

/// One node, called until this is dropped.
pub struct NodeLink {
    commands: mpsc::Sender<Command>,
    task: tokio::task::AbortHandle,
}

/// Pauses between calls. A node that restarts is back within a second; one that is down costs a
/// packet every five seconds.
const PAUSE_FIRST: Duration = Duration::from_millis(200);
const PAUSE_MAX: Duration = Duration::from_secs(5);
/// A connection that has held so long is called again at once: what ended it was an accident.
const SETTLED: Duration = Duration::from_secs(2);
/// A 720p frame takes 5 ms to decode; links are shared out over so many threads. Threads that share
/// links wake each other for each message: an answer of 64 KiB over a loopback took 0.9 ms instead of
/// 0.7, and 1.8 instead of 1.1 in one case of a hundred.
const THREADS: usize = 4;
/// Commands that wait for a link's task. The coordinator asks for far fewer at once.
const COMMANDS_MAX: usize = 1024;
/// How long a leaving player waits for nodes to hear of it.
const FAREWELL: Duration = Duration::from_millis(200);

impl Client {
    /// Starts the network threads. No socket is opened before the first call.
    ///
    /// # Errors
    /// [`Error::Credentials`] if the credentials are no player's, [`Error::Socket`] if the system
    /// has no threads left.
    pub fn new(credentials: &Credentials) -> Result<Self, Error> {
        let network = |_| {
            let runtime = tokio::runtime::Builder::new_multi_thread()
                .worker_threads(1)
                .thread_name("carom-net")
                .enable_all()
                .build()
                .map_err(|source| Error::Socket {
                    address: "network threads".into(),
                    source,
                })?;
            let caller = Arc::new(Caller::new(credentials)?);
            Ok(Network { runtime, caller })
        };
        Ok(Self {
            networks: (0..THREADS).map(network).collect::<Result<_, Error>>()?,
            links: AtomicUsize::new(0),
        })
    }

    /// Calls a node until the link is dropped; sRGB tiles come as exactly as `precision` has it.
    /// `events` is called on a network thread, with one or more, and must not block.
    pub fn link(
        &self,
        address: NodeAddress,
        precision: PrecisionRange,
        events: impl FnMut(Vec<LinkEvent>) + Send + 'static,
    ) -> NodeLink {
        let (commands, receiver) = mpsc::channel(COMMANDS_MAX);
        let turn = self.links.fetch_add(1, Ordering::Relaxed);
        let network = &self.networks[turn % self.networks.len()];
        let link = Link {
            caller: Arc::clone(&network.caller),
            address,
            precision,
            commands: receiver,
            events: Box::new(events),
        };
        NodeLink {
            commands,
            task: network.runtime.spawn(link.keep_calling()).abort_handle(),
        }
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        let farewell = |network: &Network| {
            let caller = Arc::clone(&network.caller);
            let farewell = async move { tokio::time::timeout(FAREWELL, caller.close()).await };
            network.runtime.spawn(farewell)
        };
        let farewells: Vec<_> = self.networks.iter().map(farewell).collect();
        for (network, farewell) in self.networks.drain(..).zip(farewells) {
            let _ = network.runtime.block_on(farewell);
            network.runtime.shutdown_background();
        }
    }
}

impl NodeLink {
    /// Asks something of the node. Without a connection it is dropped, as is everything that was
    /// asked of a connection that is lost. `false` if too much is waiting already.
    pub fn send(&self, command: Command) -> bool {
        self.commands.try_send(command).is_ok()
    }
}

impl Drop for NodeLink {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// The task behind a [`NodeLink`].
struct Link {
    caller: Arc<Caller>,
    address: NodeAddress,
    precision: PrecisionRange,
    commands: mpsc::Receiver<Command>,
    events: Events,
}

type Events = Box<dyn FnMut(Vec<LinkEvent>) + Send>;

impl Link {
    async fn keep_calling(mut self) {
        let mut pause = PAUSE_FIRST;
        loop {
            let called = Instant::now();
            (self.events)(vec![LinkEvent::Connecting]);
            let why = self.call().await;
            if called.elapsed() >= SETTLED {
                pause = PAUSE_FIRST;
            }
            let retry = Some(pause);
            (self.events)(vec![LinkEvent::Lost { why, retry }]);
            tokio::time::sleep(pause).await;
            pause = (pause * 2).min(PAUSE_MAX);
        }
    }

    /// One connection from call to loss.
    async fn call(&mut self) -> String {
        let streams = match self.caller.call(&self.address).await {
            Ok(streams) => streams,
            Err(why) => return why,
        };
        // They were meant for the connection before this one.
        while self.commands.try_recv().is_ok() {}
        let mut player = Player {
            session: LinkSession::new(self.precision, &mut self.events),
            commands: &mut self.commands,
        };
        let why = connection_driver::carry(streams, &mut player).await;
        player.flush();
        why
    }
}

/// The player's side of one connection.
struct Player<'a> {
    session: LinkSession<&'a mut Events>,
    commands: &'a mut mpsc::Receiver<Command>,
}

impl Peer for Player<'_> {
    fn handle(&mut self, packet: Packet) -> Result<(), carom_protocol::Error> {
        self.session.handle(packet)
    }

    fn flush(&mut self) {
        self.session.flush();
    }

    fn poll_transmit(&mut self) -> Option<Packet> {
        self.session.poll_transmit()
    }

    fn poll_owner(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), String>> {
        self.commands.poll_recv(cx).map(|command| {
            self.session.command(command.ok_or("the farm is gone")?);
            Ok(())
        })
    }
}
