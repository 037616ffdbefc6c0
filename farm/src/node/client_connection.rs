//! Workers' end of a client's session with the node.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::task::Waker;
use std::time::{Duration, Instant};

use carom_protocol::limits::TILES_PER_MESSAGE_MAX;
use carom_protocol::session::{NodeSession, SentReferences};
use carom_protocol::tile_codec::{Encoder, TileInput, TilePixels};
use carom_protocol::{
    NodeInfo, PixelFormat, RefusalReason, RequestId, RequestReport, TilesDone, TraceRequest,
};
use carom_tracer::{Tile, TileRange};

use super::bitrate_control::{BitrateController, LinkEstimate};
use super::fair_queue::PlayerId;
use super::rate_model::EncodedSample;
use crate::lock::lock;

/// How pixels are passed to a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TileSharing {
    /// In the messages, encoded by the tile codec.
    Encoded,
    /// Unencoded beside the messages, to a client in this process.
    InMemory,
}

/// Workers' end of a client's session.
pub(super) struct ClientConnection {
    pub(super) player: PlayerId,
    pub(super) sharing: TileSharing,
    state: Mutex<ConnectionState>,
    /// Notified when the transport has accepted a packet.
    pub(super) drained: Condvar,
    sent: Mutex<SentReferences>,
    bitrate: Mutex<BitrateController>,
    start: Instant,
}

pub(super) struct ConnectionState {
    pub(super) session: NodeSession,
    /// Cancellation flags of the requests that are neither done nor refused.
    pub(super) cancelled: BTreeMap<RequestId, Arc<AtomicBool>>,
    pub(super) waker: Option<Waker>,
    /// Whether a worker has queued a packet since the transport last polled.
    pub(super) ready: bool,
    /// Time that a worker waits for the transport to accept a packet; zero after a wait has timed out.
    pub(super) stall_timeout: Duration,
    pub(super) closed: bool,
    /// Whether the client has received everything and will send no more requests.
    pub(super) has_left: bool,
}

impl ClientConnection {
    pub(super) fn new(info: NodeInfo, player: PlayerId, sharing: TileSharing) -> Self {
        let state = ConnectionState {
            session: NodeSession::new(info),
            cancelled: BTreeMap::new(),
            waker: None,
            ready: false,
            stall_timeout: STALL_TIMEOUT,
            closed: false,
            has_left: false,
        };
        Self {
            player,
            sharing,
            state: Mutex::new(state),
            drained: Condvar::new(),
            sent: Mutex::default(),
            bitrate: Mutex::new(BitrateController::new()),
            start: Instant::now(),
        }
    }

    /// Handles a new estimate of the link's bandwidth.
    pub(super) fn on_bandwidth(&self, bytes_per_sec: f64) {
        let link = LinkEstimate {
            bytes_per_sec,
            waiting_bytes: self.lock().session.waiting_bytes(),
        };
        lock(&self.bitrate).on_estimate(self.start.elapsed(), link);
    }

    /// The payload of a request's finished tiles; sRGB tiles are delta-coded against those that the client
    /// holds.
    pub(super) fn encode(
        &self,
        encoder: &mut Encoder,
        request: &TraceRequest,
        part: TileRange,
        tiles: &[(Tile, &[[f32; 3]])],
    ) -> Vec<u8> {
        let PixelFormat::Srgb8 { exposure } = request.format else {
            return encoder.encode(request.format, tiles);
        };
        let references = lock(&self.sent).references(request, part);
        let sources: Vec<TileInput> = tiles
            .iter()
            .zip(&references)
            .map(|(&(tile, radiance), reference)| TileInput {
                tile,
                radiance,
                reference: reference.as_ref(),
            })
            .collect();
        // The same for a message in every frame, whichever range of tiles its request asks for.
        let place = part.first / TILES_PER_MESSAGE_MAX;
        let precision = lock(&self.bitrate).precision(request.precision, place);
        let (payload, kept) = encoder.encode_srgb(exposure, precision, &sources);
        lock(&self.sent).insert(request, part, kept);
        lock(&self.bitrate).on_encoded(EncodedSample {
            precision,
            pixels: tiles.iter().map(|(tile, _)| tile.pixels()).sum(),
            delta: encoder.delta_stats(),
            bytes: payload.len(),
        });
        payload
    }

    /// Sends finished tiles, whose pixels are `shared` or in the payload. Returns whether they are still
    /// wanted.
    pub(super) fn tiles(&self, tiles: TilesDone, shared: Option<TilePixels>) -> bool {
        let mut state = self.lock();
        let sent = match shared {
            Some(pixels) => state.session.shared_tiles(tiles, pixels),
            None => state.session.tiles(tiles),
        };
        let sent = match sent {
            Ok(sent) => sent && !state.closed,
            Err(error) => {
                tracing::error!("cannot send tiles: {error}");
                false
            }
        };
        wake(state);
        sent
    }

    /// Ends a request whose tiles have all been sent.
    pub(super) fn request_done(&self, report: RequestReport) {
        let mut state = self.lock();
        state.cancelled.remove(&report.request);
        if let Err(error) = state.session.request_done(report) {
            let why = RefusalReason::Device(format!("the tracer left out tiles: {error}"));
            state.session.refuse(report.request, why);
        }
        wake(state);
    }

    /// Ends a request that cannot be completed.
    pub(super) fn refuse(&self, request: RequestId, why: RefusalReason) {
        let mut state = self.lock();
        state.cancelled.remove(&request);
        state.session.refuse(request, why);
        wake(state);
    }

    /// Waits while the network accepts tiles more slowly than they are traced, and returns whether it had
    /// to. Cancels the request if none is accepted within the stall timeout, as others wait for the device.
    pub(super) fn wait_for_room(&self, cancelled: &AtomicBool) -> bool {
        let full = |state: &mut ConnectionState| {
            state.session.is_full() && !state.closed && !cancelled.load(Ordering::Relaxed)
        };
        let mut state = self.lock();
        if !full(&mut state) {
            return false;
        }
        let stall_timeout = state.stall_timeout;
        let waited = self.drained.wait_timeout_while(state, stall_timeout, full);
        let (mut state, waited) = waited.unwrap_or_else(PoisonError::into_inner);
        if waited.timed_out() {
            // Zero from now on: its next requests must not block the device as well.
            state.stall_timeout = Duration::ZERO;
            cancelled.store(true, Ordering::Relaxed);
        }
        true
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, ConnectionState> {
        lock(&self.state)
    }
}

/// Wakes the transport after releasing the lock, so that it does not block on it.
pub(super) fn wake(mut state: MutexGuard<'_, ConnectionState>) {
    state.ready = true;
    let waker = state.waker.take();
    drop(state);
    if let Some(waker) = waker {
        waker.wake();
    }
}

/// Time for which a client may accept no tiles before its requests are cancelled, as others wait for the
/// device. A connection may be silent for as long.
pub(crate) const STALL_TIMEOUT: Duration = Duration::from_secs(5);
