//! Account of a player at a node: what all its connections together may send, and when it last worked.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use carom_protocol::limits;
use tokio::sync::Semaphore;

use crate::token_bucket::TokenBucket;

/// Bytes of a player's control streams that a node reads at once, and each second: the longest scene, then
/// 64 Mbit/s.
const CONTROL_BYTES_BURST: f64 = limits::SCENE_BYTES_MAX as f64;
const CONTROL_BYTES_PER_SEC: f64 = 8e6;
/// Packets likewise. A player at 60 frames a second that asks for each frame in 16 parts, and again
/// for half of them, sends 1,500; a packet costs the network thread some 10 µs.
const PACKETS_BURST: f64 = 8192.0;
const PACKETS_PER_SEC: f64 = 2048.0;
/// Scenes of a player that are decoded at once: each takes a core for up to a second.
const SCENES_DECODED_MAX: usize = 1;
/// Scenes of a player whose chunks are awaited at once: each takes up to 128 MiB of memory.
const TRANSFERS_MAX: usize = 1;

/// See the [module](self).
#[derive(Debug)]
pub(crate) struct PlayerAccount {
    bytes: Mutex<TokenBucket>,
    packets: Mutex<TokenBucket>,
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

    /// Notes that the player asks for tiles, or gets some.
    pub(crate) fn work(&self, now: Instant) {
        *lock(&self.worked) = now;
    }

    /// For how long it has not worked.
    pub(crate) fn idle(&self, now: Instant) -> Duration {
        now.saturating_duration_since(*lock(&self.worked))
    }
}

fn lock<T>(state: &Mutex<T>) -> MutexGuard<'_, T> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}
