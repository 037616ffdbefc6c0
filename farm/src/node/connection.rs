//! A client's session with the node, shared by its transport and the workers.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

use carom_protocol::limits::TILES_PER_MESSAGE_MAX;
use carom_protocol::session::{NodeEvent, NodeSession, Packet, SentReferences};
use carom_protocol::tile_codec::{Encoder, TileInput};
use carom_protocol::{
    NodeInfo, PixelFormat, RefusalReason, RequestId, RequestReport, TilesDone, TraceRequest,
};
use carom_tracer::{Tile, TileRange};

use super::bitrate_control::{BitrateController, LinkEstimate};
use super::queue::{JobQueue, NodeJob};
use super::rate_model::EncodedSample;

/// The transport's end of a client's session.
pub struct NodeConnection {
    client: Arc<ClientConnection>,
    queue: Arc<JobQueue>,
}

/// The workers' end of a client's session.
pub(super) struct ClientConnection {
    state: Mutex<ConnectionState>,
    /// Notified when the transport has accepted a packet.
    drained: Condvar,
    sent: Mutex<SentReferences>,
    bitrate: Mutex<BitrateController>,
    start: Instant,
}

struct ConnectionState {
    session: NodeSession,
    /// Flags of requests that are neither done nor refused.
    cancelled: BTreeMap<RequestId, Arc<AtomicBool>>,
    waker: Option<Waker>,
    /// Whether a worker has queued a packet since the transport last polled.
    ready: bool,
    /// The time a worker waits for the transport to accept a packet; zero once it has waited in
    /// vain.
    stall_timeout: Duration,
    closed: bool,
}

impl NodeConnection {
    pub(super) fn new(info: NodeInfo, queue: Arc<JobQueue>) -> Self {
        let state = ConnectionState {
            session: NodeSession::new(info),
            cancelled: BTreeMap::new(),
            waker: None,
            ready: false,
            stall_timeout: STALL_TIMEOUT,
            closed: false,
        };
        let client = Arc::new(ClientConnection {
            state: Mutex::new(state),
            drained: Condvar::new(),
            sent: Mutex::default(),
            bitrate: Mutex::new(BitrateController::new()),
            start: Instant::now(),
        });
        Self { client, queue }
    }

    /// Handles a packet from the client.
    ///
    /// # Errors
    /// The rule that the client broke: send what [`NodeConnection::poll_transmit`] still hands out,
    /// and close.
    pub fn handle(&mut self, packet: Packet) -> Result<(), carom_protocol::Error> {
        let mut state = self.client.lock();
        match state.session.handle(packet)? {
            // The session keeps scenes; they are compiled when they are first drawn.
            None | Some(NodeEvent::Scene { .. }) => {}
            Some(NodeEvent::Trace { request, scene }) => {
                let cancelled = Arc::new(AtomicBool::new(false));
                state.cancelled.insert(request.id, Arc::clone(&cancelled));
                // The queue's lock is never taken under this one.
                drop(state);
                self.queue.push(NodeJob {
                    client: Arc::clone(&self.client),
                    request,
                    scene,
                    cancelled,
                    arrived: Instant::now(),
                });
            }
            Some(NodeEvent::Cancelled(requests)) => {
                for request in requests {
                    if let Some(flag) = state.cancelled.remove(&request) {
                        flag.store(true, Ordering::Relaxed);
                    }
                }
                drop(state);
                self.client.drained.notify_all();
                self.queue.drop_cancelled();
            }
        }
        Ok(())
    }

    /// Handles the arrival of a part of a scene: of so many bytes until now.
    pub fn on_scene_progress(&mut self, received_bytes: usize) {
        self.client.lock().session.scene_progress(received_bytes);
    }

    /// Requests that have been cancelled since the last call.
    pub fn take_cancelled(&mut self) -> Vec<RequestId> {
        self.client.lock().session.take_unwanted()
    }

    /// Handles a new estimate of what the link carries.
    pub fn on_bandwidth(&mut self, bytes_per_sec: f64) {
        let waiting_bytes = self.client.lock().session.waiting_bytes();
        let link = LinkEstimate {
            bytes_per_sec,
            waiting_bytes,
        };
        let now = self.client.start.elapsed();
        lock(&self.client.bitrate).on_estimate(now, link);
    }

    /// The next packet to send, if there is one now.
    pub fn poll_transmit(&mut self) -> Option<Packet> {
        let mut state = self.client.lock();
        let packet = state.session.poll_transmit()?;
        state.stall_timeout = STALL_TIMEOUT;
        drop(state);
        self.client.drained.notify_all();
        Some(packet)
    }

    /// The next packet to send; wakes `cx` when there is one.
    pub fn poll_packet(&mut self, cx: &mut Context<'_>) -> Poll<Packet> {
        // The waker first: a packet that is queued in between is returned, or wakes.
        self.client.lock().waker = Some(cx.waker().clone());
        self.poll_transmit().map_or(Poll::Pending, Poll::Ready)
    }

    /// Wakes `cx` when a worker has queued a packet for [`NodeConnection::poll_transmit`].
    pub fn poll_ready(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        let mut state = self.client.lock();
        if state.ready {
            state.ready = false;
            return Poll::Ready(());
        }
        state.waker = Some(cx.waker().clone());
        Poll::Pending
    }
}

impl Drop for NodeConnection {
    fn drop(&mut self) {
        let mut state = self.client.lock();
        state.closed = true;
        for flag in std::mem::take(&mut state.cancelled).values() {
            flag.store(true, Ordering::Relaxed);
        }
        drop(state);
        self.client.drained.notify_all();
        self.queue.drop_cancelled();
    }
}

impl ClientConnection {
    /// The payload of a request's finished tiles, delta-coded against those that the client holds.
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
        // The same for a message in every frame, whatever range of tiles a request asks for.
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

    /// Sends finished tiles; `false` if they are no longer wanted.
    pub(super) fn tiles(&self, tiles: TilesDone) -> bool {
        let mut state = self.lock();
        let sent = match state.session.tiles(tiles) {
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

    /// Waits while the network accepts tiles more slowly than they are traced. Gives the request up
    /// if it accepts none at all: others wait for the device.
    pub(super) fn wait_for_room(&self, cancelled: &AtomicBool) {
        let full = |state: &mut ConnectionState| {
            state.session.is_full() && !state.closed && !cancelled.load(Ordering::Relaxed)
        };
        let state = self.lock();
        let stall_timeout = state.stall_timeout;
        let waited = self.drained.wait_timeout_while(state, stall_timeout, full);
        let (mut state, waited) = waited.unwrap_or_else(PoisonError::into_inner);
        if waited.timed_out() {
            // The client has had its chance: its next requests must not block the device as well.
            state.stall_timeout = Duration::ZERO;
            cancelled.store(true, Ordering::Relaxed);
        }
    }

    fn lock(&self) -> MutexGuard<'_, ConnectionState> {
        lock(&self.state)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Wakes the transport after the lock is released, so that it does not wait for it.
fn wake(mut state: MutexGuard<'_, ConnectionState>) {
    state.ready = true;
    let waker = state.waker.take();
    drop(state);
    if let Some(waker) = waker {
        waker.wake();
    }
}

/// The time for which a client may accept no tiles before its requests are given up: others wait
/// for the device. A connection may be silent for as long.
pub(crate) const STALL_TIMEOUT: Duration = Duration::from_secs(5);

#[cfg(test)]
mod tests {
    use carom_protocol::limits::TILES_QUEUED_BYTES_MAX;
    use carom_protocol::session::ClientSession;
    use carom_protocol::{FrameId, NodeTimes, PrecisionRange, SceneHash};
    use carom_tracer::{
        DeviceInfo, DeviceKind, ImageSize, RenderSettings, Scene, SceneUpdate, TileGrid,
    };

    use super::*;

    /// A player that has requested tiles of a megabyte a message, and its connection.
    fn connected(messages: u32) -> (ClientSession, NodeConnection) {
        let device = DeviceInfo {
            kind: DeviceKind::Cpu,
            name: String::new(),
            width: 1,
            threads: 1,
        };
        let (name, queue) = (String::new(), Arc::new(JobQueue::new()));
        let mut connection = NodeConnection::new(NodeInfo { name, device }, queue);
        let mut session = ClientSession::new();
        let mut exchange = |session: &mut ClientSession| {
            while let Some(packet) = session.poll_transmit() {
                connection.handle(packet).unwrap();
                while let Some(answer) = connection.poll_transmit() {
                    session.handle(answer).unwrap();
                }
            }
        };
        exchange(&mut session);
        let scene = Scene::from_json(include_str!("../../../assets/scenes/pool.json")).unwrap();
        let hash = SceneHash::of(&scene);
        session.set_scene(hash, &scene).unwrap();
        let count = TILES_PER_MESSAGE_MAX * messages;
        let request = TraceRequest {
            frame: FrameId(0),
            id: RequestId(0),
            scene: hash,
            update: SceneUpdate::default(),
            grid: TileGrid::new(ImageSize::new(8 * count, 8), 8),
            tiles: TileRange { first: 0, count },
            settings: RenderSettings::default(),
            format: PixelFormat::LinearF32,
            precision: PrecisionRange::EXACT,
            references: Vec::new(),
        };
        session.trace(request).unwrap();
        exchange(&mut session);
        (session, connection)
    }

    #[test]
    fn a_stalled_client_blocks_a_worker_once() {
        let messages = (TILES_QUEUED_BYTES_MAX >> 20) as u32 + 1;
        let (_session, mut connection) = connected(messages);
        let client = Arc::clone(&connection.client);
        client.lock().stall_timeout = Duration::from_millis(1);
        for message in 0..messages {
            let first = message * TILES_PER_MESSAGE_MAX;
            let count = TILES_PER_MESSAGE_MAX;
            let sent = client.tiles(TilesDone {
                request: RequestId(0),
                tiles: TileRange { first, count },
                busy_micros: 0,
                times: NodeTimes::default(),
                dropped_samples: 0,
                pixels: vec![0; 1 << 20],
            });
            assert!(sent, "message {message}");
        }
        let cancelled = AtomicBool::new(false);
        client.wait_for_room(&cancelled);
        assert!(cancelled.load(Ordering::Relaxed));
        assert_eq!(client.lock().stall_timeout, Duration::ZERO);
        for _ in 0..2 {
            assert!(connection.poll_transmit().is_some());
        }
        assert_eq!(client.lock().stall_timeout, STALL_TIMEOUT);
        let cancelled = AtomicBool::new(false);
        client.wait_for_room(&cancelled);
        assert!(!cancelled.load(Ordering::Relaxed));
    }
}
