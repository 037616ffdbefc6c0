//! Bounds on the handshakes that a node performs at once: in all, and for each source.

use std::collections::{BTreeMap, VecDeque};
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Handshakes that a node performs at once; packets of further strangers are dropped unanswered.
const HANDSHAKES_MAX: usize = 32;
/// Of them, those kept for sources that players have come from before.
const RESERVED: usize = 8;
/// Handshakes of one source: more than [`UNVALIDATED_MAX`], so that packets with a forged address
/// cannot use up what the address's owner may have.
const PER_SOURCE_MAX: usize = 12;
/// Above this number, strangers must validate their address first (RFC 9000, 8.1.2), which costs
/// them a round trip.
const UNVALIDATED_MAX: usize = 8;
/// Sources that are remembered.
const KNOWN_MAX: usize = 256;
/// The time between two warnings.
const WARNING_INTERVAL: Duration = Duration::from_secs(60);

/// The handshakes of one node.
#[derive(Clone, Debug, Default)]
pub(crate) struct Handshakes(Arc<Mutex<HandshakeTable>>);

#[derive(Debug, Default)]
struct HandshakeTable {
    /// Under way.
    pending: BTreeMap<IpAddr, usize>,
    /// The sources that players came from last.
    known: VecDeque<IpAddr>,
    failed: usize,
    ignored: usize,
    warned: Option<Instant>,
}

/// A handshake under way, until it is dropped.
#[derive(Debug)]
pub(crate) struct PendingHandshake {
    source: IpAddr,
    handshakes: Handshakes,
}

impl Handshakes {
    /// Counts another handshake, if it may be begun.
    pub(crate) fn begin(&self, address: IpAddr) -> Option<PendingHandshake> {
        let source = source(address);
        let mut table = self.lock();
        let limit = match table.known.contains(&source) {
            true => HANDSHAKES_MAX,
            false => HANDSHAKES_MAX - RESERVED,
        };
        let of_source = table.pending.get(&source).copied().unwrap_or_default();
        if table.count() >= limit || of_source >= PER_SOURCE_MAX {
            table.ignored += 1;
            return None;
        }
        *table.pending.entry(source).or_default() += 1;
        let handshakes = self.clone();
        Some(PendingHandshake { source, handshakes })
    }

    /// Whether so many are under way that strangers must validate their addresses.
    pub(crate) fn must_validate(&self) -> bool {
        self.lock().count() > UNVALIDATED_MAX
    }

    /// Counts a handshake that failed. Once a minute at the most, a sentence for the log.
    pub(crate) fn fail(&self, now: Instant) -> Option<String> {
        let mut table = self.lock();
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

    fn lock(&self) -> MutexGuard<'_, HandshakeTable> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl HandshakeTable {
    fn count(&self) -> usize {
        self.pending.values().sum()
    }
}

impl PendingHandshake {
    /// Remembers the source as one that players come from.
    pub(crate) fn succeed(self) {
        let mut table = self.handshakes.lock();
        table.known.retain(|known| *known != self.source);
        table.known.push_back(self.source);
        if table.known.len() > KNOWN_MAX {
            table.known.pop_front();
        }
    }
}

impl Drop for PendingHandshake {
    fn drop(&mut self) {
        let mut table = self.handshakes.lock();
        if let Some(pending) = table.pending.get_mut(&self.source) {
            *pending -= 1;
            if *pending == 0 {
                table.pending.remove(&self.source);
            }
        }
    }
}

/// What one stranger may have: an address of IPv4, a /56 of IPv6.
fn source(address: IpAddr) -> IpAddr {
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
        // An IPv4 address is the same source behind a socket of IPv6.
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

    #[test]
    fn refusals_are_logged_once_a_minute() {
        let (handshakes, start) = (Handshakes::default(), Instant::now());
        let lines = (0..180).filter_map(|secs| handshakes.fail(start + Duration::from_secs(secs)));
        let lines: Vec<String> = lines.collect();
        assert_eq!(lines.len(), 3);
        assert!(lines[1].starts_with("60 connections refused"), "{lines:?}");
    }
}
