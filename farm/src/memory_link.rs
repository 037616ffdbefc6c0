//! Link to a node in this process: a thread carries the packets of a connection. They are those of any
//! link, except that pixels are not encoded.

use std::sync::Arc;
use std::task::{Context, Poll, Wake, Waker};
use std::thread::{JoinHandle, Thread};

use carom_protocol::PrecisionRange;

use crate::channel;
use crate::link::{LinkCommand, LinkEvent, LinkSession};
use crate::node::{Node, NodeConnection, PacketHandler as _};

/// A link to a node in this process.
pub(crate) struct MemoryLink {
    /// Set to `None` on drop, which ends the thread.
    commands: Option<channel::Sender<LinkCommand>>,
    thread: Option<JoinHandle<()>>,
}

impl MemoryLink {
    /// Connects to `node`. `events` is called on the link's thread with batches of at least one.
    pub(crate) fn new(
        node: &Arc<Node>,
        mut events: impl FnMut(Vec<LinkEvent>) + Send + 'static,
    ) -> Self {
        let (commands, receiver) = channel::channel();
        let connection = node.connect_local();
        let carry = move || {
            events(vec![LinkEvent::Connecting]);
            let mut session = LinkSession::new(PrecisionRange::EXACT, &mut events);
            let why = carry(receiver, connection, &mut session);
            session.flush();
            events(vec![LinkEvent::Lost { why, retry: None }]);
        };
        let thread = std::thread::Builder::new().name("carom-link".into());
        Self {
            commands: Some(commands),
            thread: thread.spawn(carry).ok(),
        }
    }

    /// Sends a command. Returns whether the link is still alive.
    pub(crate) fn send(&self, command: LinkCommand) -> bool {
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

/// Carries packets between a session and a node until either ends; returns the reason.
fn carry(
    commands: channel::Receiver<LinkCommand>,
    mut connection: NodeConnection,
    session: &mut LinkSession<impl FnMut(Vec<LinkEvent>)>,
) -> String {
    let waker = Waker::from(Arc::new(Unpark(std::thread::current())));
    let mut cx = Context::from_waker(&waker);
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
            session.flush();
            // A wake-up since the last check has left its token, so that this returns at once and nothing
            // is missed.
            std::thread::park();
        }
    }
}

/// Wakes the link's thread.
struct Unpark(Thread);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}
