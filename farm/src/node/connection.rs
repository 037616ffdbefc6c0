//! Transport's end of a client's session with the node.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};
use std::time::Instant;

use carom_protocol::limits::SCENE_BYTES_MAX;
use carom_protocol::session::{ChunkStore, NodeEvent, Packet, SceneAssembler, SceneProgress};
use carom_protocol::{NodeInfo, RequestId};

use super::client_connection::{ClientConnection, STALL_TIMEOUT, TileSharing, wake};
use super::fair_queue::PlayerId;
use super::job::UncompiledJob;
use super::queue::JobQueue;
use crate::Error;

/// Handle for finishing a connection's work, from outside its session.
#[derive(Clone)]
pub struct ConnectionDrain {
    client: Arc<ClientConnection>,
}

impl ConnectionDrain {
    /// Asks the client to send no more requests; those already under way are still answered.
    pub fn begin(&self) {
        let mut state = self.client.lock();
        state.session.leave();
        wake(state);
    }

    /// Whether the client has confirmed that it has received everything.
    pub fn has_left(&self) -> bool {
        self.client.lock().has_left
    }

    /// Whether all received requests are answered, and all answers handed to the transport.
    pub fn is_idle(&self) -> bool {
        let state = self.client.lock();
        state.session.open_requests() == 0 && state.session.waiting_bytes() == 0
    }
}

/// A session and its owner, as the transport that carries their packets sees them.
pub trait PacketHandler {
    /// Handles a packet; an error is the peer's fault and ends the connection.
    ///
    /// # Errors
    /// The protocol rule that the peer broke.
    fn handle(&mut self, packet: Packet) -> Result<(), carom_protocol::Error>;

    /// The assembler of the peer's scenes, which runs on other threads.
    fn assembler(&self) -> SceneAssembler {
        SceneAssembler::default()
    }

    /// Handles the progress of a scene's assembly, in place of its packets.
    ///
    /// # Errors
    /// The protocol rule that the peer broke.
    fn handle_scene(
        &mut self,
        progress: Result<SceneProgress, carom_protocol::Error>,
    ) -> Result<(), carom_protocol::Error> {
        progress.map(drop)
    }

    /// Passes on the events of the handled packets.
    fn flush(&mut self) {}

    /// The next packet to send, if there is one now.
    fn poll_transmit(&mut self) -> Option<Packet>;

    /// Executes the next command of this side's owner. Ready when [`PacketHandler::poll_transmit`] may have
    /// a packet, or with an error to close the connection; otherwise pending, and wakes `cx`.
    fn poll_commands(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Error>>;

    /// Requests that have been cancelled since the last call: their streams are reset.
    fn take_cancelled(&mut self) -> Vec<RequestId> {
        Vec::new()
    }

    /// Handles a new estimate of the path's bandwidth in bytes per second.
    fn on_bandwidth(&mut self, _bytes_per_sec: f64) {}

    /// The handle for finishing the session's work before its node ends; without one the session is cut
    /// off.
    fn drain(&self) -> Option<ConnectionDrain> {
        None
    }
}

/// Transport's end of a client's session.
pub struct NodeConnection {
    client: Arc<ClientConnection>,
    queue: Arc<JobQueue>,
    /// The node's store for chunks of scenes.
    store: Option<Arc<dyn ChunkStore>>,
}

impl NodeConnection {
    pub(super) fn new(
        info: NodeInfo,
        player: PlayerId,
        queue: Arc<JobQueue>,
        sharing: TileSharing,
    ) -> Self {
        let client = Arc::new(ClientConnection::new(info, player, sharing));
        Self {
            client,
            queue,
            store: None,
        }
    }

    /// Adds a store for chunks of scenes.
    pub(super) fn with_store(mut self, store: Option<Arc<dyn ChunkStore>>) -> Self {
        self.store = store;
        self
    }

    fn on_event(&self, event: Option<NodeEvent>) {
        match event {
            // The session keeps scenes; they are compiled when first traced.
            None | Some(NodeEvent::Scene { .. }) => {}
            Some(NodeEvent::Trace { request, scene }) => {
                let cancelled = Arc::new(AtomicBool::new(false));
                let flag = Arc::clone(&cancelled);
                self.client.lock().cancelled.insert(request.id, flag);
                self.queue.push(UncompiledJob {
                    client: Arc::clone(&self.client),
                    request,
                    scene,
                    cancelled,
                    arrived: Instant::now(),
                });
            }
            Some(NodeEvent::Ping(number)) => {
                let load = self.queue.load(self.client.player);
                self.client.lock().session.pong(number, load);
            }
            Some(NodeEvent::Left) => self.client.lock().has_left = true,
            Some(NodeEvent::Cancelled(requests)) => {
                let mut state = self.client.lock();
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
    }

    /// The next packet to send; wakes `cx` when there is one.
    pub fn poll_packet(&mut self, cx: &mut Context<'_>) -> Poll<Packet> {
        // The waker is set first, so that a packet queued in between is either returned or wakes.
        self.client.lock().waker = Some(cx.waker().clone());
        self.poll_transmit().map_or(Poll::Pending, Poll::Ready)
    }
}

impl PacketHandler for NodeConnection {
    fn handle(&mut self, packet: Packet) -> Result<(), carom_protocol::Error> {
        let event = self.client.lock().session.handle(packet)?;
        self.on_event(event);
        Ok(())
    }

    fn assembler(&self) -> SceneAssembler {
        let memory = usize::try_from(self.queue.scenes.player_bytes_max());
        let bytes_max = memory.unwrap_or(usize::MAX).min(SCENE_BYTES_MAX);
        SceneAssembler::new(self.store.clone(), bytes_max)
    }

    fn handle_scene(
        &mut self,
        progress: Result<SceneProgress, carom_protocol::Error>,
    ) -> Result<(), carom_protocol::Error> {
        let event = self.client.lock().session.handle_scene(progress)?;
        self.on_event(event);
        Ok(())
    }

    fn poll_transmit(&mut self) -> Option<Packet> {
        let mut state = self.client.lock();
        let packet = state.session.poll_transmit()?;
        state.stall_timeout = STALL_TIMEOUT;
        drop(state);
        self.client.drained.notify_all();
        Some(packet)
    }

    /// Ready when a worker has queued a packet.
    fn poll_commands(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Error>> {
        let mut state = self.client.lock();
        if state.ready {
            state.ready = false;
            return Poll::Ready(Ok(()));
        }
        state.waker = Some(cx.waker().clone());
        Poll::Pending
    }

    fn take_cancelled(&mut self) -> Vec<RequestId> {
        self.client.lock().session.take_unwanted()
    }

    fn on_bandwidth(&mut self, bytes_per_sec: f64) {
        self.client.on_bandwidth(bytes_per_sec);
    }

    fn drain(&self) -> Option<ConnectionDrain> {
        let client = Arc::clone(&self.client);
        Some(ConnectionDrain { client })
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

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use carom_protocol::limits::{TILES_PER_MESSAGE_MAX, TILES_QUEUED_BYTES_MAX};
    use carom_protocol::session::ClientSession;
    use carom_protocol::{
        CodedParticles, EncodedScene, FrameId, NodeTimes, PixelFormat, PrecisionRange, TilesDone,
        TraceRequest,
    };
    use carom_tracer::{
        DeviceInfo, DeviceKind, ImageSize, RenderSettings, Scene, SceneUpdate, TileGrid, TileRange,
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
        let (name, queue) = (String::new(), Arc::new(JobQueue::default()));
        let info = NodeInfo {
            name,
            instance: 0,
            device,
        };
        let mut connection =
            NodeConnection::new(info, PlayerId::LOCAL, queue, TileSharing::Encoded);
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
        let scene = EncodedScene::new(&scene).unwrap();
        session.set_scene(&scene).unwrap();
        let count = TILES_PER_MESSAGE_MAX * messages;
        let request = TraceRequest {
            frame: FrameId(0),
            id: RequestId(0),
            scene: scene.hash(),
            update: SceneUpdate::default(),
            grid: TileGrid::new(ImageSize::new(8 * count, 8), 8),
            tiles: TileRange { first: 0, count },
            settings: RenderSettings::default(),
            format: PixelFormat::LinearF32,
            precision: PrecisionRange::EXACT,
            references: Vec::new(),
            particles: CodedParticles::default(),
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
            let tiles = TilesDone {
                request: RequestId(0),
                tiles: TileRange { first, count },
                busy_micros: 0,
                times: NodeTimes::default(),
                dropped_samples: 0,
                pixels: vec![0; 1 << 20],
            };
            let sent = client.tiles(tiles, None);
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
