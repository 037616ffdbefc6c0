//! Account of a player at a node: what all its connections together may send, how often their addresses may change,
//! and when it last worked.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use carom_protocol::limits;
use tokio::sync::Semaphore;

use crate::lock::lock;
use crate::token_bucket::TokenBucket;

/// Bytes of a player's control streams that a node reads at once, and each second: the longest scene, then
/// 64 Mbit/s.
const CONTROL_BYTES_BURST: f64 = limits::SCENE_BYTES_MAX as f64;
const CONTROL_BYTES_PER_SEC: f64 = 8e6;
/// Packets likewise. A player at 60 frames a second that asks for each frame in 16 parts, and again
/// for half of them, sends 1,500; a packet costs the network thread some 10 µs.
const PACKETS_BURST: f64 = 8192.0;
const PACKETS_PER_SEC: f64 = 2048.0;
/// Path challenges and responses that a node sends a player at once, and each second: two when the address of a
/// connection changes. A NAT that forgets ports does so after 30 s at the soonest.
const PATH_PROBES_BURST: f64 = 64.0;
const PATH_PROBES_PER_SEC: f64 = 1.0;
/// How long a player that has taken more of them is turned away. Whoever sees its packets can bring this about, if his
/// copies of them, from other addresses, are faster.
const PATH_PROBES_PAUSE_MAX: Duration = Duration::from_secs(60);
/// Scenes of a player that are decoded at once: each takes a core for up to a second.
const SCENES_DECODED_MAX: usize = 1;
/// Scenes of a player whose chunks are awaited at once: each takes up to 128 MiB of memory.
const TRANSFERS_MAX: usize = 1;

/// See the [module](self).
#[derive(Debug)]
pub(crate) struct PlayerAccount {
    bytes: Mutex<TokenBucket>,
    packets: Mutex<TokenBucket>,
    path_probes: Mutex<TokenBucket>,
    /// For scenes that are decoded.
    pub(crate) decoding: Semaphore,
    /// For scenes whose chunks are awaited.
    pub(crate) transfers: Arc<Semaphore>,
    worked: Mutex<Instant>,
}

impl PlayerAccount {
    /// An account of which nothing has been spent.
    pub(crate) fn new(now: Instant) -> Self {
        let bytes = TokenBucket::new(now, CONTROL_BYTES_BURST, CONTROL_BYTES_PER_SEC);
        Self {
            bytes: Mutex::new(bytes),
            packets: Mutex::new(TokenBucket::new(now, PACKETS_BURST, PACKETS_PER_SEC)),
            path_probes: Mutex::new(TokenBucket::new(
                now,
                PATH_PROBES_BURST,
                PATH_PROBES_PER_SEC,
            )),
            decoding: Semaphore::new(SCENES_DECODED_MAX),
            transfers: Arc::new(Semaphore::new(TRANSFERS_MAX)),
            worked: Mutex::new(now),
        }
    }

    /// Counts bytes that have come; returns how long to read no more.
    pub(crate) fn spend_bytes(&self, now: Instant, bytes: usize) -> Duration {
        lock(&self.bytes).take(now, bytes as f64)
    }

    /// The same of a packet.
    pub(crate) fn spend_packet(&self, now: Instant) -> Duration {
        lock(&self.packets).take(now, 1.0)
    }

    /// Counts path challenges and responses that have been sent; whether they are no more than there may be.
    pub(crate) fn spend_path_probes(&self, now: Instant, probes: u64) -> bool {
        let mut bucket = lock(&self.path_probes);
        let pause = bucket.take(now, probes as f64);
        // What would take longer than the longest pause to be paid back is given back at once.
        let excess = pause.saturating_sub(PATH_PROBES_PAUSE_MAX);
        bucket.take(now, -excess.as_secs_f64() * PATH_PROBES_PER_SEC);
        pause.is_zero()
    }

    /// How long the player is turned away because its address has changed too often.
    pub(crate) fn path_probes_pause(&self, now: Instant) -> Duration {
        lock(&self.path_probes).take(now, 0.0)
    }

    /// Notes that the player asks for tiles, or gets some.
    pub(crate) fn work(&self, now: Instant) {
        *lock(&self.worked) = now;
    }

    /// For how long it has not worked.
    pub(crate) fn idle(&self, now: Instant) -> Duration {
        now.saturating_duration_since(*lock(&self.worked))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_may_change_now_and_then_but_not_with_each_packet() {
        let start = Instant::now();
        let account = PlayerAccount::new(start);
        let at = |secs| start + Duration::from_secs(secs);
        // A NAT that forgets ports every half a minute, for a day.
        for half_minute in 0..2880 {
            assert!(account.spend_path_probes(at(30 * half_minute), 2));
        }
        let now = at(86_400);
        assert!(account.spend_path_probes(now, 64));
        assert!(!account.spend_path_probes(now, 1));
        // However many there were, it may come back in a minute.
        assert!(!account.spend_path_probes(now, 1 << 40));
        let pause = account.path_probes_pause(now);
        assert!(pause.abs_diff(PATH_PROBES_PAUSE_MAX) < Duration::from_millis(1));
        assert!(
            account
                .path_probes_pause(now + PATH_PROBES_PAUSE_MAX)
                .is_zero()
        );
    }
}
