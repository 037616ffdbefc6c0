//! An in-process UDP proxy that forwards packets over emulated links.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap, VecDeque};
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::link_emulator::{LinkConfig, LinkEmulator};

/// Forwards packets between clients and one server, each direction over a link of its own. Ends when
/// dropped.
pub struct UdpProxy {
    address: SocketAddr,
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

/// Counts of packets, both directions together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PacketCounts {
    /// Number of forwarded packets.
    pub passed: u64,
    /// Their payload in bytes, without UDP and IP headers.
    pub passed_bytes: u64,
    /// Number of packets lost by the link's loss or a full queue.
    pub lost: u64,
}

struct Shared {
    to: SocketAddr,
    config: LinkConfig,
    stopped: AtomicBool,
    due: Mutex<PacketQueue>,
    changed: Condvar,
    passed: AtomicU64,
    passed_bytes: AtomicU64,
    lost: AtomicU64,
    /// Queueing delays of the server's packets.
    queue_delays: Mutex<VecDeque<Duration>>,
    began: Instant,
}

/// Packets in flight.
#[derive(Default)]
struct PacketQueue {
    packets: BinaryHeap<Reverse<DelayedPacket>>,
    count: u64,
}

struct DelayedPacket {
    at: Duration,
    /// Order among packets that arrive at the same time.
    number: u64,
    socket: Arc<UdpSocket>,
    to: SocketAddr,
    bytes: Vec<u8>,
}

impl UdpProxy {
    /// Listens at `listen` and forwards packets to `to`, and answers back, each direction over a link
    /// as in `config`. Every client has links of its own, drawn from `seed`.
    ///
    /// # Errors
    /// The system's, if the address is in use or not this machine's or there are no threads left;
    /// [`io::ErrorKind::InvalidInput`] with a sentence if a number of `config` is out of range.
    pub fn start(
        listen: SocketAddr,
        to: SocketAddr,
        config: LinkConfig,
        seed: u64,
    ) -> io::Result<Self> {
        let invalid = |why| io::Error::new(io::ErrorKind::InvalidInput, why);
        config.validate().map_err(invalid)?;
        let socket = Arc::new(open(listen)?);
        let address = socket.local_addr()?;
        let shared = Arc::new(Shared {
            to,
            config,
            stopped: AtomicBool::new(false),
            due: Mutex::default(),
            changed: Condvar::new(),
            passed: AtomicU64::new(0),
            passed_bytes: AtomicU64::new(0),
            lost: AtomicU64::new(0),
            queue_delays: Mutex::default(),
            began: Instant::now(),
        });
        let mut proxy = Self {
            address,
            shared: Arc::clone(&shared),
            threads: Vec::new(),
        };
        let deliver = Arc::clone(&shared);
        proxy.spawn(move || deliver.deliver())?;
        proxy.spawn(move || shared.listen(&socket, seed))?;
        Ok(proxy)
    }

    /// Address on which it listens, with the port that the system chose if 0 was requested.
    pub fn local_addr(&self) -> SocketAddr {
        self.address
    }

    /// Counts of packets so far.
    pub fn counts(&self) -> PacketCounts {
        PacketCounts {
            passed: self.shared.passed.load(Ordering::Relaxed),
            passed_bytes: self.shared.passed_bytes.load(Ordering::Relaxed),
            lost: self.shared.lost.load(Ordering::Relaxed),
        }
    }

    /// Waiting times of the server's packets for the rate since the last call, the latest 65,536 of
    /// them.
    pub fn take_queue_delays(&self) -> Vec<Duration> {
        lock(&self.shared.queue_delays).drain(..).collect()
    }

    fn spawn(&mut self, work: impl FnOnce() + Send + 'static) -> io::Result<()> {
        let thread = std::thread::Builder::new().name("carom-proxy".into());
        self.threads.push(thread.spawn(work)?);
        Ok(())
    }
}

impl Drop for UdpProxy {
    fn drop(&mut self) {
        self.shared.stopped.store(true, Ordering::Relaxed);
        self.shared.changed.notify_all();
        for thread in self.threads.drain(..) {
            let _ = thread.join(); // a panic has been reported where it happened
        }
    }
}

/// A client's link to the server.
struct ProxyClient {
    upstream: Arc<UdpSocket>,
    there: LinkEmulator,
    answers: JoinHandle<()>,
}

impl Shared {
    fn listen(self: &Arc<Self>, socket: &Arc<UdpSocket>, seed: u64) {
        let mut clients: BTreeMap<SocketAddr, ProxyClient> = BTreeMap::new();
        let mut buffer = vec![0; PACKET_BYTES_MAX];
        while !self.stopped() {
            let Ok((length, from)) = socket.recv_from(&mut buffer) else {
                continue; // nothing came within the patience, or an ICMP message
            };
            if !clients.contains_key(&from) {
                if clients.len() == CLIENTS_MAX {
                    tracing::warn!("{from} is one client too many for the proxy");
                    continue;
                }
                // Two seeds per client, one for each direction.
                let seed = seed.wrapping_add(2 * clients.len() as u64);
                match self.client(socket, from, seed) {
                    Ok(client) => drop(clients.insert(from, client)),
                    Err(why) => {
                        tracing::warn!("{from} cannot be passed on: {why}");
                        continue;
                    }
                }
            }
            if let Some(client) = clients.get_mut(&from) {
                self.send(
                    &mut client.there,
                    &client.upstream,
                    self.to,
                    &buffer[..length],
                );
            }
        }
        for client in clients.into_values() {
            let _ = client.answers.join();
        }
    }

    fn client(
        self: &Arc<Self>,
        socket: &Arc<UdpSocket>,
        from: SocketAddr,
        seed: u64,
    ) -> io::Result<ProxyClient> {
        let any: SocketAddr = match self.to {
            SocketAddr::V4(_) => ([0, 0, 0, 0], 0).into(),
            SocketAddr::V6(_) => ([0u16; 8], 0).into(),
        };
        let upstream = Arc::new(open(any)?);
        let (shared, socket) = (Arc::clone(self), Arc::clone(socket));
        let (receive, mut back) = (
            Arc::clone(&upstream),
            LinkEmulator::new(self.config, seed + 1),
        );
        let answers = move || {
            let mut buffer = vec![0; PACKET_BYTES_MAX];
            while !shared.stopped() {
                if let Ok((length, _)) = receive.recv_from(&mut buffer) {
                    shared.note(back.queue_delay(shared.began.elapsed()));
                    shared.send(&mut back, &socket, from, &buffer[..length]);
                }
            }
        };
        let thread = std::thread::Builder::new().name("carom-proxy".into());
        Ok(ProxyClient {
            upstream,
            there: LinkEmulator::new(self.config, seed),
            answers: thread.spawn(answers)?,
        })
    }

    fn send(&self, path: &mut LinkEmulator, socket: &Arc<UdpSocket>, to: SocketAddr, bytes: &[u8]) {
        let mut due = lock(&self.due);
        let at = path.send(self.began.elapsed(), bytes.len());
        let Some(at) = at.filter(|_| due.packets.len() < PACKETS_MAX) else {
            self.lost.fetch_add(1, Ordering::Relaxed);
            return;
        };
        due.count += 1;
        let packet = DelayedPacket {
            at,
            number: due.count,
            socket: Arc::clone(socket),
            to,
            bytes: bytes.to_vec(),
        };
        due.packets.push(Reverse(packet));
        drop(due);
        self.changed.notify_one();
    }

    fn note(&self, queue_delay: Duration) {
        let mut delays = lock(&self.queue_delays);
        if delays.len() == PACKETS_MAX {
            delays.pop_front();
        }
        delays.push_back(queue_delay);
    }

    /// Sends each packet when it is due.
    fn deliver(&self) {
        let mut due = lock(&self.due);
        while !self.stopped() {
            let now = self.began.elapsed();
            let next = due.packets.peek().map(|Reverse(packet)| packet.at);
            match next {
                Some(at) if at <= now => {
                    if let Some(Reverse(packet)) = due.packets.pop() {
                        drop(due);
                        // Ignored: a peer that is gone is no fault of the link.
                        let _ = packet.socket.send_to(&packet.bytes, packet.to);
                        self.passed.fetch_add(1, Ordering::Relaxed);
                        let bytes = packet.bytes.len() as u64;
                        self.passed_bytes.fetch_add(bytes, Ordering::Relaxed);
                        due = lock(&self.due);
                    }
                }
                next => {
                    let wait = next.map_or(WAKE_PERIOD, |at| (at - now).min(WAKE_PERIOD));
                    let woken = self.changed.wait_timeout(due, wait);
                    due = woken.unwrap_or_else(PoisonError::into_inner).0;
                }
            }
        }
    }

    fn stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}

/// Opens a socket with the system's default buffers, 208 kB: enough for bursts of three frames of 65
/// kB. The code that sets larger ones for QUIC also has the system deliver several packets as one.
fn open(address: SocketAddr) -> io::Result<UdpSocket> {
    let socket = UdpSocket::bind(address)?;
    socket.set_read_timeout(Some(WAKE_PERIOD))?;
    Ok(socket)
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl PartialEq for DelayedPacket {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for DelayedPacket {}

impl PartialOrd for DelayedPacket {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for DelayedPacket {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.at, self.number).cmp(&(other.at, other.number))
    }
}

/// The largest UDP packet.
const PACKET_BYTES_MAX: usize = 65_535;
/// Maximum packets in flight: a second of 700 Mbit/s.
const PACKETS_MAX: usize = 1 << 16;
/// Maximum clients: as many nodes or players as any test has; each costs a thread.
const CLIENTS_MAX: usize = 64;
/// Longest time until a thread notices that it has been stopped.
const WAKE_PERIOD: Duration = Duration::from_millis(50);
