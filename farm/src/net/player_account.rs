//! Account of a player at a node: limits on what all its connections together may send and on how often their
//! addresses may change, and the time when it was last active.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use carom_protocol::limits;
use tokio::sync::Semaphore;

use crate::lock::lock;
use crate::token_bucket::TokenBucket;

/// Bytes of a player's control streams that a node reads as a burst, and per second: the longest scene, then
/// 64 Mbit/s.
const CONTROL_BYTES_BURST: f64 = limits::SCENE_BYTES_MAX as f64;
const CONTROL_BYTES_PER_SEC: f64 = 8e6;
/// Packets as a burst and per second. A player at 60 frames a second that requests each frame in 16 parts,
/// and half of them again, sends 1,500 a second; a packet costs the network thread some 10 µs.
const PACKETS_BURST: f64 = 8192.0;
const PACKETS_PER_SEC: f64 = 2048.0;
/// Path challenges and responses that a node sends a player as a burst, and per second: two when the address
/// of a connection changes. A NAT drops idle mappings after 30 s at the earliest.
const PATH_PROBES_BURST: f64 = 64.0;
const PATH_PROBES_PER_SEC: f64 = 1.0;
/// Maximum time for which a player that exceeded them is turned away. An attacker who sees its packets can
/// cause this, by copies of them from other addresses that arrive before the originals.
const PATH_PROBES_PAUSE_MAX: Duration = Duration::from_secs(60);
/// Concurrently decoded scenes of a player: each occupies a core for up to a second.
const SCENES_DECODED_MAX: usize = 1;
/// Concurrent transfers of scenes in chunks of a player: each takes up to 128 MiB of memory.
const TRANSFERS_MAX: usize = 1;

/// Account of a player at a node; see the [module](self).
#[derive(Debug)]
pub(crate) struct PlayerAccount {
    bytes: Mutex<TokenBucket>,
    packets: Mutex<TokenBucket>,
    path_probes: Mutex<TokenBucket>,
    /// Permits to decode scenes.
    pub(crate) decoding: Semaphore,
    /// Permits to receive a scene in chunks.
    pub(crate) transfers: Arc<Semaphore>,
    worked: Mutex<Instant>,
}

impl PlayerAccount {
    /// An account with its full budget.
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

    /// Charges received bytes; returns for how long to pause reading.
    pub(crate) fn spend_bytes(&self, now: Instant, bytes: usize) -> Duration {
        lock(&self.bytes).take(now, bytes as f64)
    }

    /// Charges a received packet; returns for how long to pause reading.
    pub(crate) fn spend_packet(&self, now: Instant) -> Duration {
        lock(&self.packets).take(now, 1.0)
    }

    /// Charges sent path challenges and responses; returns whether they are within the budget.
    pub(crate) fn spend_path_probes(&self, now: Instant, probes: u64) -> bool {
        let mut bucket = lock(&self.path_probes);
        let pause = bucket.take(now, probes as f64);
        // Debt beyond the longest pause is cancelled at once.
        let excess = pause.saturating_sub(PATH_PROBES_PAUSE_MAX);
        bucket.take(now, -excess.as_secs_f64() * PATH_PROBES_PER_SEC);
        pause.is_zero()
    }

    /// How long the player is still turned away because its address has changed too often.
    pub(crate) fn path_probes_pause(&self, now: Instant) -> Duration {
        lock(&self.path_probes).take(now, 0.0)
    }

    /// Records that the player requests or gets tiles.
    pub(crate) fn work(&self, now: Instant) {
        *lock(&self.worked) = now;
    }

    /// Time since it was last active.
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
        // A NAT that drops its mapping every half minute, for a day.
        for half_minute in 0..2880 {
            assert!(account.spend_path_probes(at(30 * half_minute), 2));
        }
        let now = at(86_400);
        assert!(account.spend_path_probes(now, 64));
        assert!(!account.spend_path_probes(now, 1));
        // However large the excess was, the player may return after a minute.
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
