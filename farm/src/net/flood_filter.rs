//! Socket that drops packets of strangers beyond a rate, before they cost cryptography.
//!
//! A connection is opened by Initial packets (RFC 9000, 17.2.2), whose source address can be forged. Each
//! costs a key derivation and a decryption before a node can decide not to answer: some 20 times the cost of
//! receiving it and inspecting its first byte. Packets of existing connections are not touched.

use std::hash::{BuildHasher, RandomState};
use std::io::{self, IoSliceMut};
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, ready};
use std::time::Instant;

use quinn::udp::{RecvMeta, Transmit};
use quinn::{AsyncUdpSocket, UdpPoller};

use super::handshakes::{Handshakes, source};
use crate::lock::lock;
use crate::token_bucket::TokenBucket;

/// Packets per second from all strangers together, and again from all sources of earlier players. A handshake
/// has two to four; a hundred players that return at once fit into the burst.
const PER_SEC: f64 = 500.0;
const BURST: f64 = 500.0;
/// Packets per second from the sources that share one of [`SOURCE_BUCKETS`].
const SOURCE_PER_SEC: f64 = 100.0;
const SOURCE_BURST: f64 = 200.0;
/// Number of buckets, to which sources are assigned by a keyed hash: 40 kB, whatever the number of sources.
const SOURCE_BUCKETS: usize = 1024;

/// UDP socket behind a [`FloodFilter`].
#[derive(Debug)]
pub(super) struct FilteredSocket {
    socket: Arc<dyn AsyncUdpSocket>,
    filter: Mutex<FloodFilter>,
}

/// Filter that decides which packets that may open a connection are processed.
#[derive(Debug)]
struct FloodFilter {
    handshakes: Handshakes,
    strangers: PacketBudget,
    known: PacketBudget,
    hash: RandomState,
}

/// Budget of many sources together, and of each of them.
#[derive(Debug)]
struct PacketBudget {
    all: TokenBucket,
    sources: Vec<TokenBucket>,
}

impl FilteredSocket {
    /// Filters what `socket` receives; sources known to `handshakes` have a budget of their own.
    pub(super) fn new(socket: Arc<dyn AsyncUdpSocket>, handshakes: Handshakes) -> Self {
        let filter = Mutex::new(FloodFilter::new(handshakes, Instant::now()));
        Self { socket, filter }
    }
}

impl AsyncUdpSocket for FilteredSocket {
    fn create_io_poller(self: Arc<Self>) -> Pin<Box<dyn UdpPoller>> {
        Arc::clone(&self.socket).create_io_poller()
    }

    fn try_send(&self, transmit: &Transmit<'_>) -> io::Result<()> {
        self.socket.try_send(transmit)
    }

    fn poll_recv(
        &self,
        context: &mut Context<'_>,
        buffers: &mut [IoSliceMut<'_>],
        meta: &mut [RecvMeta],
    ) -> Poll<io::Result<usize>> {
        let count = ready!(self.socket.poll_recv(context, buffers, meta))?;
        let mut filter = None;
        for (buffer, meta) in buffers.iter().zip(meta).take(count) {
            if opens_connections(&buffer[..meta.len]) {
                let (filter, now) =
                    filter.get_or_insert_with(|| (lock(&self.filter), Instant::now()));
                // Coalesced by the kernel (GRO): several packets of one source in one buffer.
                let packets = meta.len.div_ceil(meta.stride.max(1));
                if !filter.admits(*now, meta.addr.ip(), packets) {
                    meta.len = 0;
                }
            }
        }
        Poll::Ready(Ok(count))
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    fn max_transmit_segments(&self) -> usize {
        self.socket.max_transmit_segments()
    }

    fn max_receive_segments(&self) -> usize {
        self.socket.max_receive_segments()
    }

    fn may_fragment(&self) -> bool {
        self.socket.may_fragment()
    }
}

/// Whether a datagram begins with a long header other than that of a Handshake packet (RFC 9000, 17.2): the
/// only datagrams that a node may answer without a connection, except by stateless resets.
fn opens_connections(datagram: &[u8]) -> bool {
    const LONG_HEADER: u8 = 0x80;
    const TYPE: u8 = 0x30;
    const HANDSHAKE: u8 = 0x20;
    const VERSION_1: &[u8] = &[0, 0, 0, 1];
    datagram.first().is_some_and(|first| {
        let is_handshake = first & TYPE == HANDSHAKE && datagram.get(1..5) == Some(VERSION_1);
        first & LONG_HEADER != 0 && !is_handshake
    })
}

impl FloodFilter {
    fn new(handshakes: Handshakes, now: Instant) -> Self {
        let budget = || PacketBudget {
            all: TokenBucket::new(now, BURST, PER_SEC),
            sources: (0..SOURCE_BUCKETS)
                .map(|_| TokenBucket::new(now, SOURCE_BURST, SOURCE_PER_SEC))
                .collect(),
        };
        Self {
            handshakes,
            strangers: budget(),
            known: budget(),
            hash: RandomState::new(),
        }
    }

    /// Whether this many packets of a source may be processed.
    fn admits(&mut self, now: Instant, address: IpAddr, packets: usize) -> bool {
        let slot = self.bucket_of(address);
        let budget = match self.handshakes.knows(source(address)) {
            true => &mut self.known,
            false => &mut self.strangers,
        };
        // The source's own bucket comes first, so that one flooding source does not drain the common bucket.
        (0..packets).all(|_| budget.sources[slot].try_take(now) && budget.all.try_take(now))
    }

    /// The bucket of an address, shared with about one source in [`SOURCE_BUCKETS`].
    fn bucket_of(&self, address: IpAddr) -> usize {
        self.hash.hash_one(source(address)) as usize % SOURCE_BUCKETS
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn filter(now: Instant) -> (Handshakes, FloodFilter) {
        let handshakes = Handshakes::default();
        (handshakes.clone(), FloodFilter::new(handshakes, now))
    }

    fn admitted(
        filter: &mut FloodFilter,
        now: Instant,
        sources: impl Iterator<Item = u32>,
    ) -> usize {
        let admits = |source: u32| filter.admits(now, IpAddr::from(source.to_be_bytes()), 1);
        sources.map(admits).filter(|admits| *admits).count()
    }

    #[test]
    fn strangers_share_a_rate_whatever_addresses_they_write() {
        let start = Instant::now();
        let (_, mut filter) = filter(start);
        let mut all = 0;
        for millis in 0..2000 {
            let now = start + Duration::from_millis(millis);
            all += admitted(
                &mut filter,
                now,
                (0..100).map(|at| millis as u32 * 100 + at),
            );
        }
        let bound = BURST + 2.0 * PER_SEC;
        assert!(
            (0.98..=1.0).contains(&(all as f64 / bound)),
            "{all} of 200,000"
        );
    }

    #[test]
    fn one_source_leaves_the_others_theirs() {
        let start = Instant::now();
        let (_, mut filter) = filter(start);
        let of_one = std::iter::repeat_n(7, 10_000);
        assert_eq!(admitted(&mut filter, start, of_one), SOURCE_BURST as usize);
        let bucket = |source: u32| filter.bucket_of(IpAddr::from(source.to_be_bytes()));
        let shares = |source: &u32| bucket(*source) == bucket(7);
        // On average ten of them share a bucket; with a secret hash, more than 40 have a probability of 1 in
        // 10^12.
        assert!((100..10_340).filter(shares).count() <= 40);
        let others: Vec<u32> = (100..).filter(|source| !shares(source)).take(100).collect();
        assert_eq!(admitted(&mut filter, start, others.into_iter()), 100);
    }

    #[test]
    fn players_come_back_in_a_flood_of_strangers() {
        let start = Instant::now();
        let (handshakes, mut filter) = filter(start);
        let player = u32::from_be_bytes([192, 0, 2, 1]);
        handshakes
            .begin(IpAddr::from([192, 0, 2, 1]))
            .unwrap()
            .succeed();
        admitted(&mut filter, start, 0..100_000);
        assert_eq!(
            admitted(&mut filter, start, std::iter::repeat_n(player, 4)),
            4
        );
    }

    #[test]
    fn packets_of_connections_are_not_counted() {
        let version_1 = |first: u8| [first, 0, 0, 0, 1, 8];
        assert!(opens_connections(&version_1(0xc0)), "Initial");
        assert!(opens_connections(&version_1(0xd0)), "0-RTT");
        assert!(!opens_connections(&version_1(0xe0)), "Handshake");
        assert!(
            opens_connections(&[0xe0, 0xff, 0, 0, 1, 8]),
            "another version"
        );
        assert!(!opens_connections(&[0x40, 1, 2, 3]), "a short header");
        assert!(!opens_connections(&[]));
    }
}
