//! A player whose NAT gives it another address in the middle of a session.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use carom_farm::net::{Authority, ServerEvent, create_farm};
use carom_farm::node::Node;
use carom_farm::{Farm, FarmConfig, Frame, LocalNode};
use carom_testkit::pattern_tracer::{self, PatternTracer};

use crate::drain::submit;
use crate::greeter::any_port;
use crate::running_node::RunningNode;

/// A NAT with a single host inside and a single one outside; dropped, it ends.
struct Nat {
    address: SocketAddr,
    shared: Arc<NatState>,
    threads: Vec<JoinHandle<()>>,
}

struct NatState {
    inside: UdpSocket,
    outside: SocketAddr,
    player: Mutex<Option<SocketAddr>>,
    /// Packets go out by these in turn.
    mappings: Mutex<Vec<Arc<UdpSocket>>>,
    /// Mappings that are gone: what comes there is not read.
    gone: Mutex<Vec<Arc<UdpSocket>>>,
    ends: AtomicBool,
}

impl Nat {
    fn before(outside: SocketAddr) -> Self {
        let inside = open(any_port());
        let address = inside.local_addr().unwrap();
        let shared = Arc::new(NatState {
            inside,
            outside,
            player: Mutex::default(),
            mappings: Mutex::new(vec![Arc::new(open(any_port()))]),
            gone: Mutex::default(),
            ends: AtomicBool::new(false),
        });
        let spawn = |pass: fn(&NatState, &mut [u8])| {
            let shared = Arc::clone(&shared);
            std::thread::spawn(move || {
                let mut buffer = vec![0; 1 << 16];
                while !shared.ends.load(Ordering::Relaxed) {
                    pass(&shared, &mut buffer);
                }
            })
        };
        let threads = vec![spawn(NatState::pass_out), spawn(NatState::pass_in)];
        Self {
            address,
            shared,
            threads,
        }
    }

    /// Packets go out by other ports, one of each of `from`, from now on, and come in by those alone.
    fn rebind(&self, from: &[Ipv4Addr]) {
        let mappings = from
            .iter()
            .map(|&from| Arc::new(open(SocketAddr::from((from, 0)))))
            .collect();
        let before = std::mem::replace(&mut *self.shared.mappings.lock().unwrap(), mappings);
        self.shared.gone.lock().unwrap().extend(before);
    }
}

impl NatState {
    fn pass_out(&self, buffer: &mut [u8]) {
        if let Ok((length, player)) = self.inside.recv_from(buffer) {
            *self.player.lock().unwrap() = Some(player);
            let mut mappings = self.mappings.lock().unwrap();
            mappings.rotate_left(1);
            let _ = mappings[0].send_to(&buffer[..length], self.outside);
        }
    }

    fn pass_in(&self, buffer: &mut [u8]) {
        let mappings = self.mappings.lock().unwrap().clone();
        for mapping in mappings {
            let Ok(length) = mapping.recv(buffer) else {
                continue; // nothing has come for a moment
            };
            let is_there = |one: &Arc<UdpSocket>| Arc::ptr_eq(one, &mapping);
            let is_there = self.mappings.lock().unwrap().iter().any(is_there);
            if let Some(player) = self.player.lock().unwrap().filter(|_| is_there) {
                let _ = self.inside.send_to(&buffer[..length], player);
            }
        }
    }
}

impl Drop for Nat {
    fn drop(&mut self) {
        self.shared.ends.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

fn open(address: SocketAddr) -> UdpSocket {
    let socket = UdpSocket::bind(address).unwrap();
    let moment = Duration::from_millis(5);
    socket.set_read_timeout(Some(moment)).unwrap();
    socket
}

/// A node behind a NAT, its player, and what becomes of the node's connections.
fn session(pace: Duration) -> (RunningNode, Nat, Farm, Arc<Mutex<Vec<ServerEvent>>>) {
    let folder = tempfile::tempdir().unwrap();
    create_farm(folder.path()).unwrap();
    let authority = Authority::load(folder.path()).unwrap();
    let tracer = PatternTracer::new().with_pace(pace.as_micros() as u64);
    let events = Arc::<Mutex<Vec<ServerEvent>>>::default();
    let told = Arc::clone(&events);
    let node = Node::new("oak", Arc::new(tracer));
    let node = RunningNode::serve_and_tell(&authority, any_port(), node, move |event| {
        told.lock().unwrap().push(event);
    });
    let nat = Nat::before(node.address);
    let config = FarmConfig {
        local: LocalNode::None,
        nodes: vec![nat.address.to_string()],
        credentials: folder.path().to_owned(),
        tile_edge: 16,
        ..FarmConfig::default()
    };
    let mut farm = Farm::new(config).unwrap();
    farm.set_scene(&pattern_tracer::scene()).unwrap();
    while !farm.nodes()[0].state.is_ready() {
        std::thread::sleep(Duration::from_millis(1));
    }
    (node, nat, farm, events)
}

fn wait(farm: &mut Farm) -> Frame {
    let frame = farm.wait_frame(PATIENCE);
    frame.unwrap_or_else(|| panic!("no frame, with nodes {:?}", farm.nodes()))
}

/// Far longer than anything here takes; a test that needs it has failed.
const PATIENCE: Duration = Duration::from_secs(60);

/// Other ports of the same host, then of another, as of a machine that changes its network.
const ADDRESSES: [Ipv4Addr; 4] = [
    Ipv4Addr::LOCALHOST,
    Ipv4Addr::LOCALHOST,
    Ipv4Addr::new(127, 0, 0, 2),
    Ipv4Addr::LOCALHOST,
];

#[test]
fn a_player_whose_port_changes_goes_on_without_another_handshake() {
    let (node, nat, mut farm, events) = session(Duration::from_millis(10));
    for address in ADDRESSES {
        // 60 tiles, for 0.6 s.
        submit(&mut farm);
        std::thread::sleep(Duration::from_millis(200));
        let early = farm.poll_frame(); // where this thread was held up
        nat.rebind(&[address]);
        let rebound = Instant::now();
        let frame = early.unwrap_or_else(|| wait(&mut farm));
        assert!(frame.missing.is_empty());
        let secs = rebound.elapsed().as_secs_f64();
        println!("a frame that was half done is whole after {secs:.2} s by way of {address}");
    }
    let events = events.lock().unwrap().clone();
    let is_call = |event: &&ServerEvent| !matches!(event, ServerEvent::Moved { .. });
    let calls: Vec<_> = events.iter().filter(is_call).collect();
    let [ServerEvent::Paired { .. }] = calls[..] else {
        panic!("it has called once: {events:?}");
    };
    drop((farm, nat, node));
}

#[test]
fn a_player_whose_address_changes_with_each_packet_is_turned_away() {
    let (node, nat, mut farm, events) = session(Duration::ZERO);
    nat.rebind(&[Ipv4Addr::LOCALHOST, Ipv4Addr::new(127, 0, 0, 2)]);
    let begun = Instant::now();
    let lost = || {
        let events = events.lock().unwrap();
        events.iter().find_map(|event| match event {
            ServerEvent::Lost { why, .. } => Some(why.clone()),
            _ => None,
        })
    };
    let why = loop {
        if let Some(why) = lost() {
            break why;
        }
        assert!(begun.elapsed() < PATIENCE, "{:?}", events.lock().unwrap());
        if farm.in_flight() == 0 {
            submit(&mut farm);
        }
        drop(farm.poll_frame());
        std::thread::sleep(Duration::from_millis(1));
    };
    assert_eq!(why, "its address changes too often");
    while !farm.nodes()[0].state.sentence().contains("its address ") {
        assert!(begun.elapsed() < PATIENCE, "{:?}", farm.nodes());
        std::thread::sleep(Duration::from_millis(1));
    }
    drop((farm, nat, node));
}
