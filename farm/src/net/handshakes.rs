//! Bounds on the concurrent handshakes of a node: in total and per source.

use std::collections::{BTreeMap, VecDeque};
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use tokio::sync::Notify;

use crate::lock::lock;

/// Maximum concurrent handshakes of a node.
const HANDSHAKES_MAX: usize = 32;
/// Handshakes of those reserved for sources from which players have come before.
const RESERVED: usize = 8;
/// Concurrent handshakes per source: more than [`UNVALIDATED_MAX`], so that packets with a forged address
/// cannot use up what the address's owner may have.
const PER_SOURCE_MAX: usize = 12;
/// Above this number of handshakes, strangers must first validate their address (RFC 9000, 8.1.2), which
/// costs them a round trip.
const UNVALIDATED_MAX: usize = 8;
/// Number of remembered sources.
const KNOWN_MAX: usize = 256;
/// Minimum time between two warnings.
const WARNING_INTERVAL: Duration = Duration::from_secs(60);

/// Table of the handshakes of one node, shared by its tasks.
#[derive(Clone, Debug, Default)]
pub(crate) struct Handshakes(Arc<Mutex<HandshakeTable>>);

#[derive(Debug, Default)]
struct HandshakeTable {
    /// Handshakes in progress per source, the oldest first.
    pending: BTreeMap<IpAddr, VecDeque<Arc<Notify>>>,
    /// The sources of the last players.
    known: VecDeque<IpAddr>,
    failed: usize,
    ignored: usize,
    warned: Option<Instant>,
}

/// Handshake in progress, counted until it is dropped.
#[derive(Debug)]
pub(crate) struct PendingHandshake {
    source: IpAddr,
    handshakes: Handshakes,
    evicted: Arc<Notify>,
}

impl Handshakes {
    /// Registers another handshake, if it may begin. If all places are taken, the oldest handshake of the
    /// source with the most of them is evicted for a source with fewer: no source can hold many places for
    /// long.
    pub(crate) fn begin(&self, address: IpAddr) -> Option<PendingHandshake> {
        let source = source(address);
        let mut table = lock(&self.0);
        // Strangers leave the reserved places free.
        let limit = match table.known.contains(&source) {
            true => HANDSHAKES_MAX,
            false => HANDSHAKES_MAX - RESERVED,
        };
        let of_source = table.pending.get(&source).map_or(0, VecDeque::len);
        let is_full = of_source >= PER_SOURCE_MAX || table.count() >= limit;
        if is_full && !table.evict_for(of_source) {
            table.ignored += 1;
            return None;
        }
        let evicted = Arc::new(Notify::new());
        let pending = table.pending.entry(source).or_default();
        pending.push_back(Arc::clone(&evicted));
        let handshakes = self.clone();
        Some(PendingHandshake {
            source,
            handshakes,
            evicted,
        })
    }

    /// Whether players have come from this [`source`] before.
    pub(super) fn knows(&self, source: IpAddr) -> bool {
        lock(&self.0).known.contains(&source)
    }

    /// Whether so many handshakes are in progress that strangers must validate their addresses.
    pub(crate) fn must_validate(&self) -> bool {
        lock(&self.0).count() > UNVALIDATED_MAX
    }

    /// Counts a failed handshake. Returns a sentence for the log, at most once a minute.
    pub(crate) fn fail(&self, now: Instant) -> Option<String> {
        let mut table = lock(&self.0);
        table.failed += 1;
        let since = table
            .warned
            .map(|warned| now.saturating_duration_since(warned));
        if since.is_some_and(|since| since < WARNING_INTERVAL) {
            return None;
        }
        table.warned = Some(now);
        let (failed, ignored) = (
            std::mem::take(&mut table.failed),
            std::mem::take(&mut table.ignored),
        );
        Some(format!(
            "{failed} connections refused and {ignored} not answered since the last such line"
        ))
    }
}

impl HandshakeTable {
    fn count(&self) -> usize {
        self.pending.values().map(VecDeque::len).sum()
    }

    /// Evicts the oldest handshake of the source with the most of them, if it would still have at least as
    /// many as a source that has `of_source` and gets one more. Without this condition two sources could
    /// evict each other in turn.
    fn evict_for(&mut self, of_source: usize) -> bool {
        let fullest = self
            .pending
            .values_mut()
            .max_by_key(|pending| pending.len());
        let Some(fullest) = fullest.filter(|pending| pending.len() > of_source + 1) else {
            return false;
        };
        if let Some(oldest) = fullest.pop_front() {
            oldest.notify_one();
        }
        true
    }
}

impl PendingHandshake {
    /// Completes once another handshake has taken the place of this one.
    pub(crate) async fn evicted(&self) {
        self.evicted.notified().await;
    }

    /// Remembers the source as one from which players come.
    pub(crate) fn succeed(&self) {
        let mut table = lock(&self.handshakes.0);
        table.known.retain(|known| *known != self.source);
        table.known.push_back(self.source);
        if table.known.len() > KNOWN_MAX {
            table.known.pop_front();
        }
    }
}

impl Drop for PendingHandshake {
    fn drop(&mut self) {
        let mut table = lock(&self.handshakes.0);
        if let Some(pending) = table.pending.get_mut(&self.source) {
            pending.retain(|one| !Arc::ptr_eq(one, &self.evicted));
            if pending.is_empty() {
                table.pending.remove(&self.source);
            }
        }
    }
}

/// The unit in which sources are counted: an IPv4 address, or a /56 of IPv6, as one subscriber may have.
pub(super) fn source(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => {
            let network = u128::from(address) & (u128::MAX << (128 - 56));
            IpAddr::V6(Ipv6Addr::from(network))
        }
        v4 @ IpAddr::V4(_) => v4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn v4(last: u8) -> IpAddr {
        IpAddr::from([192, 0, 2, last])
    }

    #[test]
    fn one_source_cannot_take_all_handshakes() {
        let handshakes = Handshakes::default();
        let begin = |address| handshakes.begin(address);
        let from_one: Vec<_> = (0..99).filter_map(|_| begin(v4(1))).collect();
        assert_eq!(from_one.len(), PER_SOURCE_MAX);
        let network = |host: u16| IpAddr::from([0x2001, 0xdb8, 0, host & 0xff, 0, 0, 0, host]);
        let from_network: Vec<_> = (0..99).filter_map(|host| begin(network(host))).collect();
        assert_eq!(from_network.len(), PER_SOURCE_MAX);
        // An IPv4-mapped IPv6 address is the same source as the IPv4 address.
        assert!(begin("::ffff:192.0.2.1".parse().unwrap()).is_none());
        drop(from_one);
        assert!(begin(v4(1)).is_some());
    }

    #[test]
    fn known_sources_have_a_reserve() {
        let handshakes = Handshakes::default();
        handshakes.begin(v4(200)).unwrap().succeed();
        let strangers: Vec<_> = (0..99)
            .filter_map(|one| handshakes.begin(v4(one)))
            .collect();
        assert_eq!(strangers.len(), HANDSHAKES_MAX - RESERVED);
        assert!(handshakes.must_validate());
        let known: Vec<_> = (0..99).filter_map(|_| handshakes.begin(v4(200))).collect();
        assert_eq!(known.len(), RESERVED);
    }

    #[tokio::test]
    async fn sources_with_many_handshakes_give_way_to_others() {
        let handshakes = Handshakes::default();
        let places = HANDSHAKES_MAX - RESERVED;
        let held: Vec<_> = (0..places as u8)
            .map(|index| handshakes.begin(v4(index % 3)).unwrap())
            .collect();
        let newcomer = handshakes.begin(v4(9)).unwrap();
        let mut evicted = 0;
        for pending in &held {
            let told = tokio::time::timeout(Duration::ZERO, pending.evicted()).await;
            evicted += usize::from(told.is_ok());
        }
        assert_eq!(evicted, 1);
        // The source with many handshakes cannot take the place back.
        let back: Vec<_> = (0..99).filter_map(|_| handshakes.begin(v4(0))).collect();
        assert!(back.len() <= 1, "{}", back.len());
        let told = tokio::time::timeout(Duration::ZERO, newcomer.evicted()).await;
        assert!(told.is_err());
    }

    #[test]
    fn refusals_are_logged_once_a_minute() {
        let (handshakes, start) = (Handshakes::default(), Instant::now());
        let lines = (0..180).filter_map(|secs| handshakes.fail(start + Duration::from_secs(secs)));
        let lines: Vec<String> = lines.collect();
        assert_eq!(lines.len(), 3);
        assert!(lines[1].starts_with("60 connections refused"), "{lines:?}");
    }
}
