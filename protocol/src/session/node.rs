//! Session of a node: the state machine at its end of a connection.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use carom_tracer::text::printable;
use carom_tracer::{Scene, SceneUpdate, Shape, TileRange};

use super::scene_assembler::{ReceivedScene, SceneAssembler, SceneProgress};
use super::scenes::SceneCache;
use super::{Channel, Packet, SessionState, not_above};
use crate::codec;
use crate::error::{Error, REPEATED, Reason, SESSION_CLOSED};
use crate::limits::{
    CONTROL_QUEUED_MAX, NODE_NAME_BYTES_MAX, REQUESTS_QUEUED_MAX, REQUESTS_REFUSED_KEPT,
    SENTENCE_BYTES_MAX, TILES_QUEUED_BYTES_MAX,
};
use crate::message::{
    CodedParticles, FrameId, NodeInfo, NodeLoad, Refusal, RefusalReason, RequestId, RequestReport,
    SceneHash, TilesDone, ToClient, ToNode, TraceRequest, VERSION,
};
use crate::particle_codec::ParticleDecoder;
use crate::tile_codec::TilePixels;

/// An event of a node's session.
#[derive(Clone, Debug, PartialEq)]
pub enum NodeEvent {
    /// A scene has arrived and is kept; the client has been told. The caller may compile it.
    Scene {
        /// Its hash.
        hash: SceneHash,
        /// The scene; it can be drawn.
        scene: Arc<Scene>,
    },
    /// Tiles to trace. The answer is [`NodeSession::tiles`] and [`NodeSession::request_done`], or
    /// [`NodeSession::refuse`]. The update fits the scene.
    Trace {
        /// The request.
        request: Box<TraceRequest>,
        /// Its scene.
        scene: Arc<Scene>,
    },
    /// Requests to stop or to remove from the queue. The client has been told; later answers to them are
    /// dropped.
    Cancelled(Vec<RequestId>),
    /// A ping, to be answered by [`NodeSession::pong`].
    Ping(u64),
    /// The client has received all that it asked for and will ask for nothing more.
    Left,
}

/// A request that a copy has begun and whose control packet has not arrived.
#[derive(Debug)]
struct CopiedRequest {
    /// BLAKE3 of the copy: the control packet must be the same.
    digest: blake3::Hash,
    /// Whether a cancellation has stopped it.
    stopped: bool,
}

/// The node's end of a connection: see [`crate::session`].
#[derive(Debug)]
pub struct NodeSession {
    info: NodeInfo,
    state: SessionState,
    scenes: SceneCache<Arc<Scene>>,
    /// Used if the transport has no assembler of its own.
    assembler: SceneAssembler,
    /// Requests that are not yet answered on the wire, at most [`REQUESTS_QUEUED_MAX`].
    requests: BTreeMap<RequestId, AcceptedRequest>,
    /// The last request that arrived on the control channel.
    last_request: Option<RequestId>,
    /// Holds the particles of `last_request`.
    particles: ParticleDecoder,
    /// Requests above `last_request` that a copy has begun, at most [`REQUESTS_QUEUED_MAX`].
    begun: BTreeMap<RequestId, CopiedRequest>,
    /// The last [`REQUESTS_REFUSED_KEPT`] requests answered in full: their tiles may still be in flight.
    answered: VecDeque<(RequestId, AcceptedRequest)>,
    /// Requests, open or answered, that were cancelled since the transport last called
    /// [`Self::take_unwanted`].
    unwanted: Vec<RequestId>,
    control_queue: VecDeque<Vec<u8>>,
    /// Queued tiles and reports of requests, which a cancellation drops.
    results: VecDeque<QueuedResult>,
    results_bytes: usize,
    /// Queued tiles and reports of stale and background frames, sent when nothing else waits.
    stale: VecDeque<QueuedResult>,
    stale_bytes: usize,
    /// The newest frame, background ones aside, of which a result has been queued.
    newest: FrameId,
}

/// A packet with tiles or a report, waiting for the network.
#[derive(Debug)]
struct QueuedResult {
    request: RequestId,
    frame: FrameId,
    packet: Packet,
}

/// Frames whose results are sent in order: the newest and the one before. A backlog of two frames is too
/// long to keep in order; a shorter one is soon sent.
const FRAMES_IN_ORDER: u64 = 2;

#[derive(Clone, Copy, Debug)]
struct AcceptedRequest {
    frame: FrameId,
    tiles: TileRange,
    tiles_left: u32,
    reported: bool,
}

impl AcceptedRequest {
    const fn new(request: &TraceRequest) -> Self {
        Self {
            frame: request.frame,
            tiles: request.tiles,
            tiles_left: request.tiles.count,
            reported: false,
        }
    }
}

impl NodeSession {
    /// A session for a client that has just connected. Names are made [`printable`] and truncated to
    /// [`NODE_NAME_BYTES_MAX`] bytes.
    pub fn new(mut info: NodeInfo) -> Self {
        info.name = printable(&info.name, NODE_NAME_BYTES_MAX);
        info.device.name = printable(&info.device.name, NODE_NAME_BYTES_MAX);
        Self {
            info,
            state: SessionState::New,
            scenes: SceneCache::new(),
            assembler: SceneAssembler::default(),
            requests: BTreeMap::new(),
            last_request: None,
            particles: ParticleDecoder::default(),
            begun: BTreeMap::new(),
            answered: VecDeque::new(),
            unwanted: Vec::new(),
            control_queue: VecDeque::new(),
            results: VecDeque::new(),
            results_bytes: 0,
            stale: VecDeque::new(),
            stale_bytes: 0,
            newest: FrameId::default(),
        }
    }

    /// Handles a packet from the client. Requests that cannot be served are refused without an event.
    ///
    /// # Errors
    /// The rule that the client broke. The session then accepts no further packet; the transport sends
    /// what is queued, so that a client of another version learns of it, and closes.
    pub fn handle(&mut self, packet: Packet) -> Result<Option<NodeEvent>, Error> {
        let event = self.try_handle(packet);
        if event.is_err() {
            self.state = SessionState::Closed;
        }
        event
    }

    /// Handles what a [`SceneAssembler`] has made of a packet with a scene or part of one.
    ///
    /// # Errors
    /// As [`NodeSession::handle`].
    pub fn handle_scene(
        &mut self,
        progress: Result<SceneProgress, Error>,
    ) -> Result<Option<NodeEvent>, Error> {
        let event = match self.state {
            SessionState::Open => progress.and_then(|progress| {
                self.check_answers_are_read("scene")?;
                Ok(self.answer_scene(progress))
            }),
            SessionState::New => Err(Error::out_of_order("scene", HELLO_FIRST)),
            SessionState::Closed => Err(Error::out_of_order("scene", SESSION_CLOSED)),
        };
        if event.is_err() {
            self.state = SessionState::Closed;
        }
        event
    }

    /// Tells the client to send no more requests, since the node is about to end; [`NodeEvent::Left`]
    /// follows once the client has the answers to those that it has sent.
    pub fn leave(&mut self) {
        if self.state == SessionState::Open {
            self.send(&ToClient::Leaving);
        }
    }

    /// Answers a ping, with the load by the node's other players.
    pub fn pong(&mut self, number: u64, load: NodeLoad) {
        if self.state == SessionState::Open {
            self.send(&ToClient::Pong { number, load });
        }
    }

    /// Sends finished tiles of a request, in any order. Returns `false` if the request is no longer wanted
    /// and should be stopped.
    ///
    /// Tiles that the network has not taken accumulate here: wait while [`NodeSession::is_full`].
    ///
    /// # Errors
    /// [`Error::Unsendable`] if the tiles are not in the request, or are more than are left of it.
    pub fn tiles(&mut self, tiles: TilesDone) -> Result<bool, Error> {
        self.send_tiles(tiles, None)
    }

    /// As [`NodeSession::tiles`], to a client in this process, which gets the pixels unencoded: the payload
    /// of `tiles` is empty.
    ///
    /// # Errors
    /// As [`NodeSession::tiles`].
    pub fn shared_tiles(&mut self, tiles: TilesDone, pixels: TilePixels) -> Result<bool, Error> {
        self.send_tiles(tiles, Some(pixels))
    }

    fn send_tiles(&mut self, tiles: TilesDone, pixels: Option<TilePixels>) -> Result<bool, Error> {
        let Some(request) = self.requests.get_mut(&tiles.request) else {
            return Ok(false);
        };
        let part = tiles.tiles;
        let inside = request.tiles.first <= part.first && part.end() <= request.tiles.end();
        if !inside || part.count > request.tiles_left {
            let (left, requested) = (request.tiles_left, request.tiles);
            let rule =
                format!("{part:?} is not in the {left} tiles that are left of {requested:?}");
            return Err(Error::unsendable("tile message", rule));
        }
        let (id, frame) = (tiles.request, request.frame);
        let bytes = codec::encode_to_client(&ToClient::Tiles(tiles))?;
        request.tiles_left -= part.count;
        let packet = Packet {
            pixels,
            ..Packet::new(Channel::Tiles, bytes)
        };
        self.queue_result(id, frame, packet);
        Ok(true)
    }

    /// Ends a request all of whose tiles have been handed over. Returns `false` if it is no longer wanted.
    ///
    /// # Errors
    /// [`Error::Unsendable`] if tiles are missing, or if the request was reported already.
    pub fn request_done(&mut self, report: RequestReport) -> Result<bool, Error> {
        let Some(request) = self.requests.get_mut(&report.request) else {
            return Ok(false);
        };
        if request.reported {
            return Err(Error::unsendable("report", REPEATED));
        }
        if request.tiles_left > 0 {
            let rule = format!("{} tiles are missing", request.tiles_left);
            return Err(Error::unsendable("report", rule));
        }
        let bytes = codec::encode_to_client(&ToClient::RequestDone(report))?;
        request.reported = true;
        let frame = request.frame;
        let packet = Packet::new(Channel::Control, bytes);
        self.queue_result(report.request, frame, packet);
        Ok(true)
    }

    /// Ends a request that was not begun or cannot be finished, and drops its queued tiles. Returns `false`
    /// if the request is no longer wanted. Sentences are made [`printable`] and truncated to
    /// [`SENTENCE_BYTES_MAX`] bytes.
    pub fn refuse(&mut self, request: RequestId, why: RefusalReason) -> bool {
        let wanted = self.requests.remove(&request).is_some();
        if wanted {
            self.drop_results(&[request]);
            self.send_refusal(request, why);
        }
        wanted
    }

    /// The next packet to send: control answers first, then tiles and reports in the order they were handed
    /// over, then those of frames that newer ones have overtaken. On a link that carries too little, strict
    /// order would make every frame late by as long as the client waits before it cancels, and none useful.
    pub fn poll_transmit(&mut self) -> Option<Packet> {
        if let Some(bytes) = self.control_queue.pop_front() {
            let channel = Channel::Control;
            return Some(Packet::new(channel, bytes));
        }
        let QueuedResult {
            request, packet, ..
        } = match self.results.pop_front() {
            Some(answer) => {
                self.results_bytes -= answer.packet.memory_bytes();
                answer
            }
            None => {
                let answer = self.stale.pop_front()?;
                self.stale_bytes -= answer.packet.memory_bytes();
                answer
            }
        };
        if packet.channel == Channel::Control {
            // Its report: with it the request is answered on the wire.
            if let Some(state) = self.requests.remove(&request) {
                self.answered.push_back((request, state));
            }
            if self.answered.len() > REQUESTS_REFUSED_KEPT {
                self.answered.pop_front();
            }
        }
        Some(packet)
    }

    /// Whether [`TILES_QUEUED_BYTES_MAX`] bytes of tiles wait for the network: tracing should pause until it
    /// has taken some.
    pub fn is_full(&self) -> bool {
        self.results_bytes + self.stale_bytes >= TILES_QUEUED_BYTES_MAX
    }

    /// The requests, answered or not, that were cancelled since the last call, at most the last
    /// [`REQUESTS_REFUSED_KEPT`]: lost packets of their tiles need not be retransmitted.
    pub fn take_unwanted(&mut self) -> Vec<RequestId> {
        std::mem::take(&mut self.unwanted)
    }

    /// Bytes of tiles and reports that wait for the network, without those of stale frames.
    pub fn waiting_bytes(&self) -> usize {
        self.results_bytes
    }

    /// Number of requests that are not yet answered on the wire.
    pub fn open_requests(&self) -> usize {
        self.requests.len()
    }

    fn try_handle(&mut self, packet: Packet) -> Result<Option<NodeEvent>, Error> {
        if self.state == SessionState::Closed {
            return Err(Error::out_of_order("packet", SESSION_CLOSED));
        }
        if packet.channel == Channel::Copy {
            return self.handle_duplicate_request(&packet.bytes);
        }
        if packet.channel != Channel::Control {
            let what = packet.channel.packet_name();
            return Err(Error::out_of_order(what, "clients send none"));
        }
        // Before the greeting no other message is parsed, and nothing is allocated for one.
        if self.state == SessionState::New && !codec::is_hello(&packet.bytes) {
            return Err(Error::out_of_order("message", HELLO_FIRST));
        }
        let message = codec::decode_to_node(&packet.bytes);
        if matches!(
            message,
            Ok(ToNode::Hello { .. }) | Err(Error::Version { .. })
        ) {
            self.welcome()?;
        }
        let message = message?;
        self.check_answers_are_read(codec::to_node_kind(&message))?;
        match message {
            ToNode::Hello { .. } => Ok(None),
            ToNode::Scene { .. }
            | ToNode::Manifest { .. }
            | ToNode::Chunk { .. }
            | ToNode::ChunksSent(_) => {
                let bytes = packet.bytes.len();
                let progress = self.assembler.handle_message(message, bytes)?;
                Ok(self.answer_scene(progress))
            }
            ToNode::Trace(request) => self.queue(request, &packet.bytes),
            ToNode::CancelBefore(frame) => Ok(self.cancel(|_, request| request.frame < frame)),
            ToNode::CancelRequest(cancelled) => Ok(self.cancel(|request, _| request == cancelled)),
            ToNode::Ping(number) => Ok(Some(NodeEvent::Ping(number))),
            ToNode::Leave => Ok(Some(NodeEvent::Left)),
        }
    }

    /// Answers a greeting, also one of another version, whose sender reads the version from the answer.
    fn welcome(&mut self) -> Result<(), Error> {
        if self.state != SessionState::New {
            return Err(Error::out_of_order("greeting", REPEATED));
        }
        self.state = SessionState::Open;
        self.send(&ToClient::Welcome {
            version: VERSION,
            node: self.info.clone(),
        });
        Ok(())
    }

    /// Refuses further packets of a client that lets its answers pile up unread.
    fn check_answers_are_read(&self, what: &'static str) -> Result<(), Error> {
        match self.control_queue.len() {
            0..CONTROL_QUEUED_MAX => Ok(()),
            _ => Err(Error::out_of_order(what, "the answers are not being read")),
        }
    }

    fn answer_scene(&mut self, progress: SceneProgress) -> Option<NodeEvent> {
        let bytes = match progress {
            SceneProgress::Received(scene) => return self.keep(scene),
            SceneProgress::Wanted {
                hash,
                chunks,
                bytes,
                ..
            } => {
                self.send(&ToClient::ChunksWanted { hash, chunks });
                bytes
            }
            // An older report of progress still waits; the next one will include this chunk.
            SceneProgress::Coming { .. } if !self.control_queue.is_empty() => return None,
            SceneProgress::Coming { bytes } => bytes,
        };
        let bytes = bytes as u32;
        self.send(&ToClient::SceneComing { bytes });
        None
    }

    fn keep(&mut self, received: ReceivedScene) -> Option<NodeEvent> {
        let hash = received.hash;
        let scene = match received.scene {
            Ok(scene) => scene,
            Err(why) => {
                self.send(&ToClient::SceneRefused { hash, why });
                return None;
            }
        };
        let scene_kept = Arc::clone(&scene);
        self.scenes.insert(hash, received.bytes, scene_kept);
        self.send(&ToClient::SceneReady(hash));
        Some(NodeEvent::Scene { hash, scene })
    }

    fn queue(
        &mut self,
        mut request: Box<TraceRequest>,
        packet: &[u8],
    ) -> Result<Option<NodeEvent>, Error> {
        let id = request.id;
        if self.last_request.is_some_and(|last| id <= last) {
            return Err(Error::out_of_order("trace request", not_above(id)));
        }
        self.last_request = Some(id);
        let copy = self.begun.remove(&id);
        if copy
            .as_ref()
            .is_some_and(|copy| copy.digest != blake3::hash(packet))
        {
            return Err(Error::out_of_order(
                "trace request",
                "it differs from its copy",
            ));
        }
        self.decode_particles(&mut request)?;
        // Before the request can be refused: the client encodes its next particles against these in any case.
        self.particles.remember(id, &request.update.particles);
        // The scene is touched before the request can be refused, as at the client: the caches stay alike.
        let refusal = match self.scenes.touch(request.scene) {
            // A cancellation stopped the copy before this packet came, perhaps one sent before it. Busy makes
            // the client request the tiles anew, under another id, since some may already have been sent.
            _ if copy.as_ref().is_some_and(|copy| copy.stopped) => RefusalReason::Busy,
            // The copy came first and has begun the request.
            _ if copy.is_some() => return Ok(None),
            None => RefusalReason::UnknownScene,
            Some(_) if self.requests.len() >= REQUESTS_QUEUED_MAX => RefusalReason::Busy,
            Some(scene) => match check_fit(scene, &request.update) {
                Err(reason) => RefusalReason::Invalid(reason.to_string()),
                Ok(()) => {
                    self.requests.insert(id, AcceptedRequest::new(&request));
                    let scene = Arc::clone(scene);
                    return Ok(Some(NodeEvent::Trace { request, scene }));
                }
            },
        };
        self.send_refusal(id, refusal);
        Ok(None)
    }

    /// Begins a request whose control packet is still on its way. Faults are left for that packet to
    /// report: scenes are touched and answers given in the order of control packets.
    fn handle_duplicate_request(&mut self, bytes: &[u8]) -> Result<Option<NodeEvent>, Error> {
        if self.state == SessionState::New {
            return Ok(None);
        }
        let ToNode::Trace(mut request) = codec::decode_to_node(bytes)? else {
            let what = Channel::Copy.packet_name();
            return Err(Error::out_of_order(what, "only requests have copies"));
        };
        let id = request.id;
        // A copy is of no use once its control packet, or another copy, has arrived.
        let come = self.last_request.is_some_and(|last| id <= last) || self.begun.contains_key(&id);
        let full = self.requests.len().max(self.begun.len()) >= REQUESTS_QUEUED_MAX;
        let scene = self.scenes.peek(request.scene);
        let fits = |scene: &&Arc<Scene>| check_fit(scene, &request.update).is_ok();
        let Some(scene) = scene.filter(fits).filter(|_| !come && !full) else {
            return Ok(None);
        };
        let scene = Arc::clone(scene);
        // The particles of the request before, against which these are coded, may not have arrived yet.
        if self.decode_particles(&mut request).is_err() {
            return Ok(None);
        }
        let copy = CopiedRequest {
            digest: blake3::hash(bytes),
            stopped: false,
        };
        self.begun.insert(id, copy);
        self.requests.insert(id, AcceptedRequest::new(&request));
        Ok(Some(NodeEvent::Trace { request, scene }))
    }

    fn decode_particles(&self, request: &mut TraceRequest) -> Result<(), Error> {
        let malformed = |reason| Error::malformed("trace request", reason);
        let coded: CodedParticles = std::mem::take(&mut request.particles);
        let particles = self.particles.decode(&coded).map_err(malformed)?;
        request.update.particles = particles;
        let checked = request.update.validate_particles();
        checked.map_err(|fault| malformed(Reason::tracer(fault)))
    }

    /// Refuses the requests that `unwanted` selects and drops their queued results. Those that a copy has
    /// begun are stopped, and refused when their control packet comes: it may have been sent after this
    /// cancellation.
    fn cancel(
        &mut self,
        unwanted: impl Fn(RequestId, &AcceptedRequest) -> bool,
    ) -> Option<NodeEvent> {
        let cancelled: Vec<RequestId> = self
            .requests
            .extract_if(.., |request, state| unwanted(*request, state))
            .map(|(request, _)| request)
            .collect();
        self.unwanted.extend(&cancelled);
        self.answered.retain(|(request, state)| {
            // The control packet of a copied request, still to come, may have been sent after this
            // cancellation.
            let dropped = !self.begun.contains_key(request) && unwanted(*request, state);
            self.unwanted.extend(dropped.then_some(*request));
            !dropped
        });
        let excess = self.unwanted.len().saturating_sub(REQUESTS_REFUSED_KEPT);
        self.unwanted.drain(..excess);
        if cancelled.is_empty() {
            return None;
        }
        self.drop_results(&cancelled);
        for request in &cancelled {
            match self.begun.get_mut(request) {
                Some(copy) => copy.stopped = true,
                None => self.send_refusal(*request, RefusalReason::Cancelled),
            }
        }
        Some(NodeEvent::Cancelled(cancelled))
    }

    fn queue_result(&mut self, request: RequestId, frame: FrameId, packet: Packet) {
        if frame > self.newest && !frame.is_background() {
            self.newest = frame;
            self.demote_stale();
        }
        let answer = QueuedResult {
            request,
            frame,
            packet,
        };
        self.wait(answer);
    }

    /// Moves packets of stale frames behind all others. The packets of a request stay in order, since all
    /// are of one frame.
    fn demote_stale(&mut self) {
        let oldest = self.results.iter().map(|answer| answer.frame).min();
        if oldest.is_none_or(|oldest| !self.is_stale(oldest)) {
            return;
        }
        self.results_bytes = 0;
        for answer in std::mem::take(&mut self.results) {
            self.wait(answer);
        }
    }

    fn wait(&mut self, answer: QueuedResult) {
        let bytes = answer.packet.memory_bytes();
        if self.is_stale(answer.frame) {
            self.stale_bytes += bytes;
            self.stale.push_back(answer);
        } else {
            self.results_bytes += bytes;
            self.results.push_back(answer);
        }
    }

    const fn is_stale(&self, frame: FrameId) -> bool {
        frame.is_background() || frame.0.saturating_add(FRAMES_IN_ORDER) <= self.newest.0
    }

    fn drop_results(&mut self, unwanted: &[RequestId]) {
        let keep = |answers: &mut VecDeque<QueuedResult>| -> usize {
            answers.retain(|answer| !unwanted.contains(&answer.request));
            answers
                .iter()
                .map(|answer| answer.packet.memory_bytes())
                .sum()
        };
        self.results_bytes = keep(&mut self.results);
        self.stale_bytes = keep(&mut self.stale);
    }

    fn send_refusal(&mut self, request: RequestId, why: RefusalReason) {
        let sentence = |why: &str| printable(why, SENTENCE_BYTES_MAX);
        let why = match why {
            RefusalReason::Invalid(why) => RefusalReason::Invalid(sentence(&why)),
            RefusalReason::Device(why) => RefusalReason::Device(sentence(&why)),
            RefusalReason::Cancelled | RefusalReason::Busy | RefusalReason::UnknownScene => why,
        };
        self.send(&ToClient::RequestRefused(Refusal { request, why }));
    }

    fn send(&mut self, message: &ToClient) {
        let bytes = codec::encode_to_client(message).expect("names and sentences are cut");
        self.control_queue.push_back(bytes);
    }
}

const HELLO_FIRST: &str = "the first must be Hello";

/// Checks that each pose names a sphere, truncated cone or mesh of the scene.
fn check_fit(scene: &Scene, update: &SceneUpdate) -> Result<(), Reason> {
    for pose in &update.poses {
        let object = pose.object;
        match scene.objects.get(object as usize).map(|found| &found.shape) {
            Some(Shape::Sphere { .. } | Shape::TruncatedCone { .. } | Shape::Mesh(_)) => {}
            Some(_) => {
                return Err(format!(
                    "object {object} is posed, but it is neither a sphere nor a truncated cone nor a mesh"
                )
                .into());
            }
            None => {
                let objects = scene.objects.len();
                return Err(format!(
                    "object {object} is posed, but the scene has {objects} objects"
                )
                .into());
            }
        }
    }
    Ok(())
}
