//! How the coordinator reaches a node: commands in, events out, the same over memory and QUIC.
//!
//! ```text
//! coordinator ──Command──▶ link ──Packet──▶ NodeConnection, in this process or behind a socket
//!             ◀─LinkEvent─      ◀─Packet───
//! ```
//!
//! A link keeps calling its node until it is dropped. Each connection begins with
//! [`LinkEvent::Connecting`] and, if it is made, [`ClientEvent::Welcome`], and ends with
//! [`LinkEvent::Lost`]; commands that were meant for an earlier connection are dropped. Packets
//! become events, and pixels are decoded, on the link's own thread: [`crate::net::NodeLink`] over
//! QUIC, [`MemoryLink`] here. Over memory the session and the packets are the same, so that
//! playing on one machine takes the path that a farm takes.

use std::sync::Arc;
use std::task::{Context, Poll, Wake, Waker};
use std::thread::{JoinHandle, Thread};
use std::time::{Duration, Instant};

use carom_protocol::session::{ClientEvent, ClientSession, Packet};
use carom_protocol::{
    FrameId, PrecisionRange, Refusal, RefusalReason, RunId, SceneHash, TraceRequest,
};
use carom_tracer::Scene;

use crate::mailbox;
use crate::node::{Node, NodeConnection};

/// What the coordinator asks of a node; each is a call of [`ClientSession`].
#[derive(Clone, Debug)]
pub enum Command {
    /// [`ClientSession::set_scene`].
    Scene(SceneHash, Arc<Scene>),
    /// [`ClientSession::trace`].
    Trace(Box<TraceRequest>),
    /// [`ClientSession::cancel_before`].
    CancelBefore(FrameId),
    /// [`ClientSession::cancel_run`].
    CancelRun(RunId),
    /// [`ClientSession::ping`].
    Ping(u64),
}

/// What becomes of a node.
#[derive(Clone, Debug, PartialEq)]
pub enum LinkEvent {
    /// It is being called.
    Connecting,
    /// What it says, decoded. The first of a connection is [`ClientEvent::Welcome`].
    Session(ClientEvent),
    /// How long the tiles of the next event took to decode, by the client's clock.
    Decoded {
        /// Whose tiles.
        run: RunId,
        /// From packet to pixels.
        took: Duration,
    },
    /// It is gone, with all its runs and scenes; it is called again after a pause.
    Lost {
        /// A sentence.
        why: String,
        /// The pause; absent if it is not called again.
        retry: Option<Duration>,
    },
}

/// One connection to a node: commands and packets in, packets and events out.
pub struct LinkSession<F> {
    session: ClientSession,
    precision: PrecisionRange,
    events: F,
}

impl<F: FnMut(LinkEvent)> LinkSession<F> {
    /// The session of a connection that has just been made, over which sRGB tiles come as exactly
    /// as `precision` has it; its greeting waits to be sent.
    pub fn new(precision: PrecisionRange, events: F) -> Self {
        Self {
            session: ClientSession::new(),
            precision,
            events,
        }
    }

    /// Puts a command into packets. What cannot be asked is refused here as the node would.
    pub fn command(&mut self, command: Command) {
        let session = &mut self.session;
        let done = match command {
            Command::Scene(hash, scene) => session.set_scene(hash, &scene).map(drop),
            Command::CancelBefore(frame) => session.cancel_before(frame),
            Command::CancelRun(run) => session.cancel_run(run),
            Command::Ping(number) => session.ping(number),
            Command::Trace(request) => return self.trace(*request),
        };
        if let Err(why) = done {
            tracing::warn!("{why}");
        }
    }

    /// Takes a packet from the node and reports what it says.
    ///
    /// # Errors
    /// What rule the node broke: the connection must end.
    pub fn handle(&mut self, packet: Packet) -> Result<(), carom_protocol::Error> {
        let begun = Instant::now();
        for event in self.session.handle(packet)? {
            if let ClientEvent::Tiles { run, .. } = event {
                let took = begun.elapsed();
                (self.events)(LinkEvent::Decoded { run, took });
            }
            (self.events)(LinkEvent::Session(event));
        }
        Ok(())
    }

    /// The next packet to send.
    pub fn poll_transmit(&mut self) -> Option<Packet> {
        self.session.poll_transmit()
    }

    fn trace(&mut self, mut request: TraceRequest) {
        request.precision = self.precision;
        let (frame, run) = (request.frame, request.run);
        if let Err(why) = self.session.trace(request) {
            let why = RefusalReason::Invalid(why.to_string());
            let refusal = Refusal { run, why };
            let event = ClientEvent::RunRefused { frame, refusal };
            (self.events)(LinkEvent::Session(event));
        }
    }
}

/// A link to a node in this process.
pub struct MemoryLink {
    /// Taken when dropped, which ends the thread.
    commands: Option<mailbox::Sender<Command>>,
    thread: Option<JoinHandle<()>>,
}

impl MemoryLink {
    /// Connects to `node`. `events` is called on the link's thread.
    pub fn new(node: &Arc<Node>, mut events: impl FnMut(LinkEvent) + Send + 'static) -> Self {
        let (commands, receiver) = mailbox::mailbox();
        let connection = node.connect();
        let carry = move || {
            events(LinkEvent::Connecting);
            let why = carry(receiver, connection, &mut events);
            events(LinkEvent::Lost { why, retry: None });
        };
        let thread = std::thread::Builder::new().name("carom-link".into());
        Self {
            commands: Some(commands),
            thread: thread.spawn(carry).ok(),
        }
    }

    /// Asks something of the node. `false` if the link has ended.
    pub fn send(&self, command: Command) -> bool {
        self.commands
            .as_ref()
            .is_some_and(|commands| commands.send(command))
    }
}

impl Drop for MemoryLink {
    fn drop(&mut self) {
        self.commands = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // a panic has been reported where it happened
        }
    }
}

/// Carries packets between a session and a node until one of them ends; says why.
fn carry(
    commands: mailbox::Receiver<Command>,
    mut connection: NodeConnection,
    events: &mut impl FnMut(LinkEvent),
) -> String {
    let waker = Waker::from(Arc::new(Unpark(std::thread::current())));
    let mut cx = Context::from_waker(&waker);
    let mut session = LinkSession::new(PrecisionRange::EXACT, events);
    loop {
        let mut idle = true;
        match commands.poll_recv(&mut cx) {
            Poll::Ready(Some(command)) => {
                session.command(command);
                idle = false;
            }
            Poll::Ready(None) => return "the farm is gone".into(),
            Poll::Pending => {}
        }
        while let Some(packet) = session.poll_transmit() {
            if let Err(why) = connection.handle(packet) {
                return why.to_string();
            }
        }
        if let Poll::Ready(packet) = connection.poll_packet(&mut cx) {
            if let Err(why) = session.handle(packet) {
                return why.to_string();
            }
            idle = false;
        }
        if idle {
            std::thread::park();
        }
    }
}

struct Unpark(Thread);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}
