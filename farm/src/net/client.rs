//! Links of a player to nodes: one task each, which connects, runs the session, decodes tiles and reconnects.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

use carom_protocol::PrecisionRange;
use carom_protocol::session::{ClientEvent, Packet};
use tokio::runtime::Runtime;
use tokio::sync::{mpsc, oneshot};
use tokio::time::Instant;

use crate::Error;
use crate::link::LinkSession;
pub use crate::link::{LinkCommand, LinkEvent};
use crate::net::address::NodeAddress;
use crate::net::certificate_fields::{common_name, peer_certificate};
use crate::net::connection_driver;
use crate::net::connector::{Connector, NodeClaims};
use crate::net::credentials::Credentials;
use crate::net::deny_list::DenyList;
use crate::net::runtime;
use crate::node::PacketHandler;

/// Network side of a player: its threads, sockets and links.
pub struct Client {
    threads: Vec<NetworkThread>,
    denied: Arc<DenyList>,
    links: AtomicUsize,
}

/// Network thread with sockets and links of its own.
struct NetworkThread {
    runtime: Runtime,
    connector: Arc<Connector>,
}

/// Link to one node, which reconnects until it is dropped.
pub struct NodeLink {
    commands: mpsc::Sender<LinkCommand>,
    task: tokio::task::AbortHandle,
}

/// Backoff between attempts to connect, doubled up to [`BACKOFF_MAX`]. A node that restarts is reconnected
/// within a second; one that is down costs a packet every five seconds.
const BACKOFF_FIRST: Duration = Duration::from_millis(200);
const BACKOFF_MAX: Duration = Duration::from_secs(5);
/// A connection that lasted this long resets the backoff: its end was not a failure to connect.
const STABLE_AFTER: Duration = Duration::from_secs(2);
/// Number of threads that links are distributed over, as a 720p frame takes 5 ms to decode. A single
/// runtime with several threads would wake them for each message: an answer of 64 KiB over loopback took
/// 0.9 ms instead of 0.7 at the median, 1.8 instead of 1.1 at the 99th percentile.
const THREADS: usize = 4;
/// Commands that may wait for a link's task; the coordinator issues far fewer at once.
const COMMANDS_MAX: usize = 1024;
/// Maximum wait of a leaving player for its nodes' acknowledgement.
const CLOSE_TIMEOUT: Duration = Duration::from_millis(200);

impl Client {
    /// Starts the network threads. No socket is opened before the first link.
    ///
    /// # Errors
    /// [`Error::KeyPair`] if the credentials are unusable, [`Error::Socket`] if the system can start no
    /// threads.
    pub fn new(credentials: &Credentials) -> Result<Self, Error> {
        let claims = NodeClaims::default();
        let thread = |_| {
            let runtime = runtime::own_thread("carom-net");
            let runtime = runtime.map_err(Error::socket("network threads"))?;
            let connector = Arc::new(Connector::new(credentials, claims.clone())?);
            Ok(NetworkThread { runtime, connector })
        };
        Ok(Self {
            threads: (0..THREADS).map(thread).collect::<Result<_, Error>>()?,
            denied: Arc::clone(&credentials.denied),
            links: AtomicUsize::new(0),
        })
    }

    /// Connects to a node, and reconnects until the link is dropped; `precision` bounds the precision of its
    /// sRGB tiles. `events` is called on a network thread, with one event or more, and must not block.
    pub fn link(
        &self,
        address: NodeAddress,
        precision: PrecisionRange,
        events: impl FnMut(Vec<LinkEvent>) + Send + 'static,
    ) -> NodeLink {
        let (commands, receiver) = mpsc::channel(COMMANDS_MAX);
        let index = self.links.fetch_add(1, Ordering::Relaxed);
        let thread = &self.threads[index % self.threads.len()];
        let link = LinkTask {
            connector: Arc::clone(&thread.connector),
            denied: Arc::clone(&self.denied),
            address,
            precision,
            commands: receiver,
            events: Box::new(events),
        };
        NodeLink {
            commands,
            task: thread.runtime.spawn(link.run()).abort_handle(),
        }
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        // Concurrently, so that the timeouts do not add up.
        let close = |thread: &NetworkThread| {
            let connector = Arc::clone(&thread.connector);
            let close = async move { tokio::time::timeout(CLOSE_TIMEOUT, connector.close()).await };
            thread.runtime.spawn(close)
        };
        let closing: Vec<_> = self.threads.iter().map(close).collect();
        for (thread, closed) in self.threads.drain(..).zip(closing) {
            let _ = thread.runtime.block_on(closed);
            thread.runtime.shutdown_background();
        }
    }
}

impl NodeLink {
    /// Sends a command to the node. It is dropped without a connection, and lost with one that breaks.
    /// Returns `false` if too many commands are waiting.
    pub fn send(&self, command: LinkCommand) -> bool {
        self.commands.try_send(command).is_ok()
    }
}

impl Drop for NodeLink {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// Task behind a [`NodeLink`].
struct LinkTask {
    connector: Arc<Connector>,
    denied: Arc<DenyList>,
    address: NodeAddress,
    precision: PrecisionRange,
    commands: mpsc::Receiver<LinkCommand>,
    events: EventSink,
}

type EventSink = Box<dyn FnMut(Vec<LinkEvent>) + Send>;

impl LinkTask {
    async fn run(mut self) {
        let mut backoff = BACKOFF_FIRST;
        let mut warned = false;
        loop {
            let started = Instant::now();
            (self.events)(vec![LinkEvent::Connecting]);
            let error = self.connect().await;
            if matches!(error, Error::SameNode { .. }) && !warned {
                warned = true;
                tracing::warn!("{}: {error}", self.address);
            }
            let why = error.to_string();
            if started.elapsed() >= STABLE_AFTER {
                backoff = BACKOFF_FIRST;
            }
            let retry = Some(backoff);
            (self.events)(vec![LinkEvent::Lost { why, retry }]);
            tokio::time::sleep(backoff).await;
            backoff = (backoff * 2).min(BACKOFF_MAX);
        }
    }

    /// Connects, runs the session until the connection is lost, and returns the reason.
    async fn connect(&mut self) -> Error {
        let (streams, address_claim) = match self.connector.connect(&self.address).await {
            Ok(connected) => connected,
            Err(error) => return error,
        };
        // Commands meant for the previous connection are obsolete.
        while self.commands.try_recv().is_ok() {}
        let certificate = peer_certificate(&streams.connection);
        let name = certificate.and_then(|shown| common_name(&shown).ok());
        let mut claims = vec![address_claim];
        // A failed claim is found in the callback below, which cannot end the connection; this channel does.
        let (same, is_same) = oneshot::channel();
        let mut same = Some(same);
        let events = |mut events: Vec<LinkEvent>| {
            for event in &mut events {
                if let LinkEvent::Session(ClientEvent::Welcome(node)) = event {
                    // The certificate's name counts, whatever the node calls itself.
                    node.name = name.clone().unwrap_or_default();
                    match claims[0].claim_instance(node.instance) {
                        Ok(claim) => claims.extend(claim),
                        Err(error) => drop(same.take().map(|same| same.send(error))),
                    }
                }
            }
            if same.is_some() {
                (self.events)(events);
            }
        };
        let mut player = PlayerSession {
            session: LinkSession::new(self.precision, events),
            commands: &mut self.commands,
        };
        let connection = streams.connection.clone();
        let error = tokio::select! {
            error = connection_driver::drive(streams, &mut player) => error,
            Ok(error) = is_same => error,
            error = self.denied.close_if_denied(&connection) => error,
        };
        player.flush();
        error
    }
}

/// Player's side of one connection.
struct PlayerSession<'a, F> {
    session: LinkSession<F>,
    commands: &'a mut mpsc::Receiver<LinkCommand>,
}

impl<F: FnMut(Vec<LinkEvent>)> PacketHandler for PlayerSession<'_, F> {
    fn handle(&mut self, packet: Packet) -> Result<(), carom_protocol::Error> {
        self.session.handle(packet)
    }

    fn flush(&mut self) {
        self.session.flush();
    }

    fn poll_transmit(&mut self) -> Option<Packet> {
        self.session.poll_transmit()
    }

    fn poll_commands(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Error>> {
        self.commands.poll_recv(cx).map(|command| {
            self.session.command(command.ok_or(Error::FarmClosed)?);
            Ok(())
        })
    }
}
