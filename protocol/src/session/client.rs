//! Session of the client: the state machine at its end of a connection.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use carom_tracer::{Tile, TileRange};

use super::reference_tiles::ReferenceList;
use super::requests::{OpenRequest, RefusedRequests};
use super::scene_transfers::SceneTransfers;
use super::scenes::SceneCache;
use super::{Channel, Packet, SessionState, not_above};
use crate::codec;
use crate::encoded_scene::EncodedScene;
use crate::error::{Error, REPEATED, Reason, SESSION_CLOSED};
use crate::limits::{CONTROL_QUEUED_MAX, REQUESTS_QUEUED_MAX};
use crate::message::{
    FrameId, NodeInfo, NodeLoad, NodeTimes, PixelFormat, Refusal, RefusalReason, RequestId,
    RequestReport, SceneHash, TilesDone, ToClient, ToNode, TraceRequest, VERSION,
};
use crate::particle_codec::ParticleEncoder;
use crate::precision::PixelPrecision;
use crate::tile_codec::{Decoder, TilePixels};

/// An event of a client's session.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientEvent {
    /// The node has answered the greeting. Always the first event.
    Welcome(NodeInfo),
    /// Progress of a scene's transfer.
    SceneComing {
        /// The scene's hash.
        hash: SceneHash,
        /// Bytes that the node has, sent on this connection or an earlier one.
        bytes: u64,
        /// The length of the scene in bytes.
        of: u64,
    },
    /// The node holds the scene.
    SceneReady(SceneHash),
    /// The node cannot use the scene.
    SceneRefused {
        /// The scene's hash.
        hash: SceneHash,
        /// A sentence for the user.
        why: String,
    },
    /// Tiles of a request: each one once, and only tiles that were requested.
    Tiles {
        /// The frame.
        frame: FrameId,
        /// The request.
        request: RequestId,
        /// Their range in the frame's grid.
        tiles: TileRange,
        /// Their pixels.
        pixels: TilePixels,
        /// Microseconds of tracing and encoding, by the node's clock.
        busy_micros: u32,
        /// Stages of the time since the request's arrival, by the node's clock.
        times: NodeTimes,
        /// Samples that were not finite and count as black.
        dropped_samples: u32,
        /// Bytes that the pixels took on the wire.
        payload_bytes: usize,
        /// The precision that the node has chosen for them.
        precision: PixelPrecision,
    },
    /// Tiles of a cancelled request. Their pixels are not needed and have not been decoded, but the time
    /// that they took tells the node's speed.
    TilesStale {
        /// The frame.
        frame: FrameId,
        /// The request.
        request: RequestId,
        /// Their range in the frame's grid.
        tiles: TileRange,
        /// Microseconds of tracing and encoding, by the node's clock.
        busy_micros: u32,
        /// Bytes that the pixels took on the wire.
        payload_bytes: usize,
    },
    /// All tiles of a request have arrived, or its cancellation came too late. The last event of the request.
    RequestDone {
        /// The frame.
        frame: FrameId,
        /// Its durations at the node.
        report: RequestReport,
    },
    /// A request will not be finished. The last event of the request.
    RequestRefused {
        /// The frame.
        frame: FrameId,
        /// The request and the reason.
        refusal: Refusal,
    },
    /// The answer to [`ClientSession::ping`].
    Pong {
        /// The ping's number.
        number: u64,
        /// Load of the node by its other players.
        load: NodeLoad,
    },
    /// The node is about to end: send it no further request, and call [`ClientSession::leave`] when
    /// everything has arrived.
    Leaving,
}

/// Status of a scene at the node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneStatus {
    /// The node holds the scene.
    Ready,
    /// The scene is on its way; [`ClientEvent::SceneReady`] or [`ClientEvent::SceneRefused`]
    /// will follow. Requests may be sent after it at once.
    Pending,
    /// The node is told the chunks of the scene and sent those that it lacks; the same events will follow.
    /// Requests have to wait for them.
    Transferring,
}

/// Question to the node about a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SceneQuestion {
    /// Whether the node can use it.
    Usable,
    /// Which of its chunks the node lacks.
    Missing,
}

/// The client's end of a connection: see [`crate::session`].
///
/// A report can overtake the last tiles of its request, which travel on other streams. The session
/// therefore keeps an early report and hands it out after the last tile. A node that reports a request
/// and never sends its tiles gains nothing: the request stays open until it is cancelled, as with a node
/// that sends nothing at all.
///
/// Tiles of a cancelled request that still arrive are [`ClientEvent::TilesStale`]; those that arrive after
/// the node's last message about it are counted by [`ClientSession::stale_tiles`] and dropped. That last
/// message is [`ClientEvent::RequestRefused`], or [`ClientEvent::RequestDone`] if the cancellation came too
/// late, or it precedes the cancellation if the report overtook the tiles.
pub struct ClientSession {
    state: SessionState,
    scenes: SceneCache<SceneStatus>,
    /// Requests that are neither done nor refused, at most [`REQUESTS_QUEUED_MAX`].
    requests: BTreeMap<RequestId, OpenRequest>,
    refused: RefusedRequests,
    references: ReferenceList,
    last_request: Option<RequestId>,
    particles: ParticleEncoder,
    transfers: SceneTransfers,
    /// Unanswered questions about scenes, in the order of sending.
    scenes_asked: VecDeque<(SceneHash, SceneQuestion)>,
    /// Unanswered pings, in the order of sending.
    pings: VecDeque<u64>,
    decoder: Decoder,
    packets: VecDeque<Vec<u8>>,
    stale_tiles: u64,
}

impl ClientSession {
    /// A session over a new connection; the greeting is queued.
    pub fn new() -> Self {
        let mut session = Self {
            state: SessionState::New,
            scenes: SceneCache::new(),
            requests: BTreeMap::new(),
            refused: RefusedRequests::default(),
            references: ReferenceList::default(),
            last_request: None,
            particles: ParticleEncoder::default(),
            transfers: SceneTransfers::default(),
            scenes_asked: VecDeque::new(),
            pings: VecDeque::new(),
            decoder: Decoder::new(),
            packets: VecDeque::new(),
            stale_tiles: 0,
        };
        let hello = ToNode::Hello { version: VERSION };
        session.send(&hello).expect("a greeting is short");
        session
    }

    /// Ensures that the node will hold `scene` when the next request arrives: sends it unless it is there or
    /// on its way. A short scene is queued at once; of longer ones the chunks that the node lacks are sent
    /// while no other packet waits.
    ///
    /// # Errors
    /// [`Error::Unsendable`] if [`CONTROL_QUEUED_MAX`] scenes wait for an answer, or as many packets for the
    /// network.
    pub fn set_scene(&mut self, scene: &Arc<EncodedScene>) -> Result<SceneStatus, Error> {
        let hash = scene.hash();
        if let Some(status) = self.scenes.peek_mut(hash) {
            return Ok(*status);
        }
        if self.transfers.is_sending(hash) {
            return Ok(SceneStatus::Transferring);
        }
        if self.scenes_asked.len() + self.transfers.len() >= CONTROL_QUEUED_MAX {
            return Err(Error::unsendable("scene", NO_ANSWERS));
        }
        if !scene.chunks().is_empty() {
            self.transfers.push(Arc::clone(scene));
            return Ok(SceneStatus::Transferring);
        }
        self.check_room("scene")?;
        self.packets.push_back(scene.message());
        self.scenes
            .insert(hash, scene.bytes(), SceneStatus::Pending);
        self.scenes_asked.push_back((hash, SceneQuestion::Usable));
        Ok(SceneStatus::Pending)
    }

    /// Requests tiles. [`ClientEvent::Welcome`] must have come, since tiles could overtake it. The numbers of
    /// a session's requests must ascend; gaps are allowed.
    ///
    /// # Errors
    /// [`Error::Unsendable`] before the welcome, if the request is invalid, its scene is not [set], its
    /// number is not above the last one or [`REQUESTS_QUEUED_MAX`] requests are open, and as
    /// [`ClientSession::ping`].
    ///
    /// [set]: ClientSession::set_scene
    pub fn trace(&mut self, mut request: TraceRequest) -> Result<(), Error> {
        let unsendable = |reason: Reason| Err(Error::unsendable("trace request", reason));
        let id = request.id;
        if self.state != SessionState::Open {
            return unsendable("the node has not answered, or is at fault".into());
        }
        if self.last_request.is_some_and(|last| id <= last) {
            return unsendable(not_above(id));
        }
        if self.requests.len() >= REQUESTS_QUEUED_MAX {
            return unsendable(format!("{REQUESTS_QUEUED_MAX} requests are open").into());
        }
        if self.scenes.peek_mut(request.scene).is_none() {
            return unsendable(Reason::SCENE_NOT_HELD);
        }
        let references = self.references.fill_in(&mut request);
        let (hash, state) = (request.scene, OpenRequest::new(&request, references));
        let update = &request.update;
        let invalid = |fault| Error::unsendable("trace request", Reason::tracer(fault));
        update.validate_particles().map_err(invalid)?;
        let particles = std::mem::take(&mut request.update.particles);
        request.particles = self.particles.encode(&particles);
        self.send(&ToNode::Trace(Box::new(request)))?;
        // Only after sending: both ends must remember the particles of exactly the requests that travel.
        self.particles.remember(id, particles);
        self.scenes.touch(hash);
        self.last_request = Some(id);
        self.requests.insert(id, state);
        Ok(())
    }

    /// Cancels all requests of frames before `frame`.
    ///
    /// # Errors
    /// As [`ClientSession::ping`].
    pub fn cancel_before(&mut self, frame: FrameId) -> Result<(), Error> {
        let message = ToNode::CancelBefore(frame);
        self.cancel(&message, |_, request| request.frame < frame)
    }

    /// Cancels one request; does nothing if it is done, refused or already cancelled.
    ///
    /// # Errors
    /// As [`ClientSession::ping`].
    pub fn cancel_request(&mut self, request: RequestId) -> Result<(), Error> {
        let message = ToNode::CancelRequest(request);
        self.cancel(&message, |id, _| id == request)
    }

    /// Tells the node, after [`ClientEvent::Leaving`], that nothing more is expected of it.
    ///
    /// # Errors
    /// [`Error::Unsendable`] if [`CONTROL_QUEUED_MAX`] packets wait for the network.
    pub fn leave(&mut self) -> Result<(), Error> {
        self.send(&ToNode::Leave)
    }

    /// Sends a ping, answered by [`ClientEvent::Pong`] with the same number.
    ///
    /// # Errors
    /// [`Error::Unsendable`] if [`CONTROL_QUEUED_MAX`] packets wait for the network, or as many
    /// pings for an answer.
    pub fn ping(&mut self, number: u64) -> Result<(), Error> {
        if self.pings.len() >= CONTROL_QUEUED_MAX {
            return Err(Error::unsendable("ping", NO_ANSWERS));
        }
        self.send(&ToNode::Ping(number))?;
        self.pings.push_back(number);
        Ok(())
    }

    /// Handles a packet from the node. It yields two events if it holds the last tiles of a request whose
    /// report came before them.
    ///
    /// # Errors
    /// The rule that the node broke. The session then accepts no further packet, and the transport closes.
    pub fn handle(&mut self, packet: Packet) -> Result<Vec<ClientEvent>, Error> {
        let events = self.try_handle(packet);
        if events.is_err() {
            self.state = SessionState::Closed;
        }
        events
    }

    /// The next packet to send.
    pub fn poll_transmit(&mut self) -> Option<Packet> {
        let bytes = self.packets.pop_front();
        let bytes = bytes.or_else(|| self.next_of_transfer())?;
        let channel = Channel::Control;
        Some(Packet::new(channel, bytes))
    }

    /// The next packet of a scene that travels in chunks, only polled while no other packet waits: tracing
    /// requests are not delayed by more than one chunk.
    fn next_of_transfer(&mut self) -> Option<Vec<u8>> {
        if self.state != SessionState::Open {
            return None;
        }
        let (message, scene) = self.transfers.next()?;
        let hash = scene.hash();
        match message {
            ToNode::Manifest { .. } => self.scenes_asked.push_back((hash, SceneQuestion::Missing)),
            // The scene enters the cache with its last message, as it does at the node.
            ToNode::ChunksSent(_) => {
                self.scenes
                    .insert(hash, scene.bytes(), SceneStatus::Pending);
                self.scenes_asked.push_back((hash, SceneQuestion::Usable));
            }
            _ => {}
        }
        Some(codec::encode_to_node(&message).expect("chunks are within their limits"))
    }

    /// Number of requests that are neither done nor refused.
    pub fn open_requests(&self) -> usize {
        self.requests.len()
    }

    /// Number of tile messages that came for requests which the node had already refused, usually after a
    /// cancellation.
    pub fn stale_tiles(&self) -> u64 {
        self.stale_tiles
    }

    fn try_handle(&mut self, packet: Packet) -> Result<Vec<ClientEvent>, Error> {
        if self.state == SessionState::Closed {
            return Err(Error::out_of_order("packet", SESSION_CLOSED));
        }
        if self.state == SessionState::New && !codec::is_hello(&packet.bytes) {
            return Err(Error::out_of_order("message", "the first must be Welcome"));
        }
        let message = codec::decode_to_client(&packet.bytes)?;
        let what = codec::to_client_kind(&message);
        let channel = match message {
            ToClient::Tiles(_) => Channel::Tiles,
            _ => Channel::Control,
        };
        if packet.channel != channel {
            let channel = packet.channel.packet_name();
            return Err(Error::out_of_order(what, format!("it came as a {channel}")));
        }
        match message {
            ToClient::Welcome { .. } if self.state == SessionState::Open => {
                Err(Error::out_of_order(what, REPEATED))
            }
            ToClient::Welcome { node, .. } => {
                self.state = SessionState::Open;
                Ok(vec![ClientEvent::Welcome(node)])
            }
            ToClient::SceneReady(hash) => self.scene_ready(hash),
            ToClient::SceneRefused { hash, why } => self.scene_refused(hash, why),
            ToClient::Tiles(tiles) => self.receive_tiles(&tiles, packet.pixels),
            ToClient::RequestDone(report) => self.request_done(report),
            ToClient::RequestRefused(refusal) => self.run_refused(refusal),
            ToClient::Pong { number, load } => self.pong(number, load),
            ToClient::SceneComing { bytes } => self.scene_coming(bytes as usize),
            ToClient::Leaving => Ok(vec![ClientEvent::Leaving]),
            ToClient::ChunksWanted { hash, chunks } => self.chunks_wanted(hash, chunks),
        }
    }

    fn scene_ready(&mut self, hash: SceneHash) -> Result<Vec<ClientEvent>, Error> {
        self.expect_answer(hash, Some(SceneQuestion::Usable))?;
        self.transfers.end(hash);
        if let Some(status) = self.scenes.peek_mut(hash) {
            *status = SceneStatus::Ready;
        }
        Ok(vec![ClientEvent::SceneReady(hash)])
    }

    fn scene_coming(&mut self, bytes: usize) -> Result<Vec<ClientEvent>, Error> {
        match self.transfers.coming(bytes) {
            Some(scene) => Ok(vec![ClientEvent::SceneComing {
                hash: scene.hash(),
                bytes: bytes as u64,
                of: scene.bytes() as u64,
            }]),
            None => Err(Error::out_of_order(
                "progress of a scene",
                format!("no scene of {bytes} bytes was sent"),
            )),
        }
    }

    fn chunks_wanted(
        &mut self,
        hash: SceneHash,
        chunks: Vec<u32>,
    ) -> Result<Vec<ClientEvent>, Error> {
        self.expect_answer(hash, Some(SceneQuestion::Missing))?;
        self.transfers.want(hash, chunks)?;
        Ok(Vec::new())
    }

    fn scene_refused(&mut self, hash: SceneHash, why: String) -> Result<Vec<ClientEvent>, Error> {
        self.expect_answer(hash, None)?;
        self.transfers.end(hash);
        self.scenes.remove(hash);
        Ok(vec![ClientEvent::SceneRefused { hash, why }])
    }

    /// Checks an answer against the oldest question, since a node answers in order. `None` stands for a
    /// refusal, which answers either question.
    fn expect_answer(
        &mut self,
        hash: SceneHash,
        question: Option<SceneQuestion>,
    ) -> Result<(), Error> {
        match self.scenes_asked.front() {
            Some(&asked) if asked == (hash, question.unwrap_or(asked.1)) => {
                self.scenes_asked.pop_front();
                Ok(())
            }
            _ => Err(Error::out_of_order(
                "answer to a scene",
                "the scene was not sent",
            )),
        }
    }

    /// Receives tiles. Their pixels are `shared` by a node of the same process, or in the payload.
    fn receive_tiles(
        &mut self,
        done: &TilesDone,
        shared: Option<TilePixels>,
    ) -> Result<Vec<ClientEvent>, Error> {
        let Some(request) = self.requests.get_mut(&done.request) else {
            return self.receive_for_closed_request(done.request);
        };
        request.receive(done.tiles)?;
        let (frame, payload_bytes) = (request.frame, done.pixels.len());
        let tiles = if request.cancelled {
            ClientEvent::TilesStale {
                frame,
                request: done.request,
                tiles: done.tiles,
                busy_micros: done.busy_micros,
                payload_bytes,
            }
        } else {
            let count = request.grid.pixels(done.tiles);
            // Shared pixels that do not fit are ignored; the decoder then refuses the payload, which is
            // empty.
            let shared = shared.filter(|pixels| pixels.fits(request.format, count));
            let mut precision = PixelPrecision::Exact;
            let pixels = match (request.format, shared) {
                (_, Some(pixels)) => pixels,
                (PixelFormat::Srgb8 { .. }, None) => {
                    let with_references = request.with_references(done.tiles);
                    let decoded = self.decoder.decode_srgb(
                        request.precision,
                        &with_references,
                        &done.pixels,
                    )?;
                    self.references.insert(
                        request.grid,
                        done.request,
                        done.tiles,
                        decoded.references,
                    );
                    precision = decoded.precision;
                    TilePixels::Srgb8(decoded.pixels)
                }
                (format, None) => {
                    let sizes: Vec<Tile> = request.grid.tiles(done.tiles).collect();
                    self.decoder.decode(format, &sizes, &done.pixels)?
                }
            };
            ClientEvent::Tiles {
                frame,
                request: done.request,
                tiles: done.tiles,
                pixels,
                busy_micros: done.busy_micros,
                times: done.times,
                dropped_samples: done.dropped_samples,
                payload_bytes,
                precision,
            }
        };
        let Some(report) = request.report.filter(|_| request.missing == 0) else {
            return Ok(vec![tiles]);
        };
        self.requests.remove(&report.request);
        Ok(vec![tiles, ClientEvent::RequestDone { frame, report }])
    }

    fn receive_for_closed_request(
        &mut self,
        request: RequestId,
    ) -> Result<Vec<ClientEvent>, Error> {
        if !self.refused.may_hold(request) {
            return Err(not_open("tile message", request));
        }
        self.stale_tiles += 1;
        Ok(Vec::new())
    }

    fn request_done(&mut self, report: RequestReport) -> Result<Vec<ClientEvent>, Error> {
        const WHAT: &str = "report";
        let Some(request) = self.requests.get_mut(&report.request) else {
            // A cancelled request stays open until the node's last message about it, and a node may not
            // report twice: so this request was never sent, or is done.
            return Err(not_open(WHAT, report.request));
        };
        if request.report.is_some() {
            return Err(Error::out_of_order(WHAT, REPEATED));
        }
        let frame = request.frame;
        if request.missing > 0 && !request.cancelled {
            request.report = Some(report);
            return Ok(Vec::new());
        }
        if request.missing > 0 {
            // The cancellation came too late: tiles may still be on their way, on other streams.
            self.refused.insert(report.request);
        }
        self.requests.remove(&report.request);
        Ok(vec![ClientEvent::RequestDone { frame, report }])
    }

    fn run_refused(&mut self, refusal: Refusal) -> Result<Vec<ClientEvent>, Error> {
        const WHAT: &str = "refusal";
        let id = refusal.request;
        let Some(request) = self
            .requests
            .get(&id)
            .filter(|request| request.report.is_none())
        else {
            return Err(not_open(WHAT, id));
        };
        if refusal.why == RefusalReason::Cancelled && !request.cancelled {
            let rule = format!("request {} was not cancelled", id.0);
            return Err(Error::out_of_order(WHAT, rule));
        }
        let frame = request.frame;
        self.requests.remove(&id);
        self.refused.insert(id);
        Ok(vec![ClientEvent::RequestRefused { frame, refusal }])
    }

    fn pong(&mut self, number: u64, load: NodeLoad) -> Result<Vec<ClientEvent>, Error> {
        if self.pings.front() != Some(&number) {
            return Err(Error::out_of_order("pong", "it answers no ping"));
        }
        self.pings.pop_front();
        Ok(vec![ClientEvent::Pong { number, load }])
    }

    /// Sends `message` if it cancels anything.
    fn cancel(
        &mut self,
        message: &ToNode,
        unwanted: impl Fn(RequestId, &OpenRequest) -> bool,
    ) -> Result<(), Error> {
        let is_news = |request: &RequestId, state: &OpenRequest| {
            !state.cancelled && unwanted(*request, state)
        };
        if !self
            .requests
            .iter()
            .any(|(request, state)| is_news(request, state))
        {
            return Ok(());
        }
        self.send(message)?;
        // If the report has arrived, it was the node's last message about the request, which ends here.
        let reported = |request: &RequestId, state: &mut OpenRequest| {
            state.report.is_some() && is_news(request, state)
        };
        for (request, _) in self.requests.extract_if(.., reported) {
            self.refused.insert(request);
        }
        // The others stay open until the node's last message about them.
        for (request, state) in &mut self.requests {
            state.cancelled |= unwanted(*request, state);
        }
        Ok(())
    }

    fn send(&mut self, message: &ToNode) -> Result<(), Error> {
        self.check_room(codec::to_node_kind(message))?;
        self.packets.push_back(codec::encode_to_node(message)?);
        Ok(())
    }

    fn check_room(&self, what: &'static str) -> Result<(), Error> {
        match self.packets.len() {
            0..CONTROL_QUEUED_MAX => Ok(()),
            _ => Err(Error::unsendable(what, "the network takes no packet")),
        }
    }
}

fn not_open(what: &'static str, request: RequestId) -> Error {
    Error::out_of_order(what, format!("request {} is not open", request.0))
}

const NO_ANSWERS: &str = "the node answers none";

impl Default for ClientSession {
    fn default() -> Self {
        Self::new()
    }
}
