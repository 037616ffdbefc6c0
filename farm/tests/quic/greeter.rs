//! A node that greets players and counts their packets.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

use carom_farm::net::{
    Authority, Credentials, NodeServer, PacketHandler, Role, ServerEvent, StopHandle,
};
use carom_protocol::NodeInfo;
use carom_protocol::session::{NodeSession, Packet};
use carom_tracer::{DeviceInfo, DeviceKind};

const DAY: Duration = Duration::from_secs(24 * 3600);

pub(crate) fn today() -> std::ops::Range<SystemTime> {
    SystemTime::now() - DAY..SystemTime::now() + DAY
}

pub(crate) fn long_ago() -> std::ops::Range<SystemTime> {
    SystemTime::now() - 3 * DAY..SystemTime::now() - 2 * DAY
}

pub(crate) fn any_port() -> SocketAddr {
    SocketAddr::from((Ipv4Addr::LOCALHOST, 0))
}

pub(crate) fn info() -> NodeInfo {
    NodeInfo {
        name: "oak".into(),
        instance: 0,
        device: DeviceInfo {
            kind: DeviceKind::Scalar,
            name: "test".into(),
            width: 1,
            threads: 1,
        },
    }
}

struct CountedSession {
    session: NodeSession,
    packets: Arc<AtomicUsize>,
}

impl PacketHandler for CountedSession {
    fn handle(&mut self, packet: Packet) -> Result<(), carom_protocol::Error> {
        self.packets.fetch_add(1, Ordering::SeqCst);
        self.session.handle(packet).map(drop)
    }

    fn poll_transmit(&mut self) -> Option<Packet> {
        self.session.poll_transmit()
    }

    fn poll_commands(&mut self, _: &mut Context<'_>) -> Poll<Result<(), carom_farm::Error>> {
        Poll::Pending
    }
}

pub(crate) struct Greeter {
    pub(crate) address: SocketAddr,
    stop: StopHandle,
    thread: Option<JoinHandle<()>>,
    packets: Arc<AtomicUsize>,
    sessions: Arc<AtomicUsize>,
}

impl Greeter {
    pub(crate) fn start(authority: &Authority) -> Self {
        Self::with_credentials(&authority.credentials(Role::Node, "oak", today()).unwrap())
    }

    pub(crate) fn with_credentials(credentials: &Credentials) -> Self {
        let server = NodeServer::bind(any_port(), credentials).unwrap();
        let address = server.local_addr().unwrap();
        let stop = StopHandle::default();
        let (packets, sessions): (Arc<AtomicUsize>, Arc<AtomicUsize>) = Default::default();
        let (stopped, counted, paired) = (stop.clone(), packets.clone(), sessions.clone());
        let thread = std::thread::spawn(move || {
            let connect = move |_, _| CountedSession {
                session: NodeSession::new(info()),
                packets: Arc::clone(&counted),
            };
            server.serve(&stopped, connect, move |event| {
                if matches!(event, ServerEvent::Paired { .. }) {
                    paired.fetch_add(1, Ordering::SeqCst);
                }
            });
        });
        Self {
            address,
            stop,
            thread: Some(thread),
            packets,
            sessions,
        }
    }

    /// Sessions that were opened, and packets that were received.
    pub(crate) fn heard(&self) -> (usize, usize) {
        let count = |counter: &AtomicUsize| counter.load(Ordering::SeqCst);
        (count(&self.sessions), count(&self.packets))
    }
}

impl Drop for Greeter {
    fn drop(&mut self) {
        self.stop.stop();
        let ended = self.thread.take().map(JoinHandle::join);
        if !std::thread::panicking() {
            ended.unwrap().unwrap();
        }
    }
}
