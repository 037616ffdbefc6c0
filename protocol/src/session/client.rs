//! The client's end of a connection.

use std::collections::{BTreeMap, VecDeque};

use carom_tracer::{Scene, Tile, TileRun};

use super::held::Held;
use super::runs::{RefusedRuns, Run};
use super::scenes::SceneCache;
use super::{Channel, Packet};
use crate::limits::{CONTROL_QUEUED_MAX, RUNS_QUEUED_MAX};
use crate::message::{
    FrameId, NodeInfo, NodeTimes, PixelFormat, Refusal, RefusalReason, RunId, RunReport, SceneHash,
    TilesDone, ToClient, ToNode, TraceRequest, VERSION,
};
use crate::tile_codec::{Decoder, TilePixels};
use crate::{Error, codec};

/// What a node tells its client.
#[derive(Clone, Debug, PartialEq)]
pub enum ClientEvent {
    /// The node answers. Always the first event.
    Welcome(NodeInfo),
    /// So much of a scene has come to the node.
    SceneComing {
        /// Which scene.
        hash: SceneHash,
        /// From 0 to 100.
        percent: u8,
    },
    /// The node holds the scene.
    SceneReady(SceneHash),
    /// The node cannot use the scene.
    SceneRefused {
        /// Which scene.
        hash: SceneHash,
        /// A sentence for the user.
        why: String,
    },
    /// Tiles of a run, each once and only tiles that were asked for.
    Tiles {
        /// The picture.
        frame: FrameId,
        /// The request.
        run: RunId,
        /// Which tiles of the picture's grid.
        tiles: TileRun,
        /// Their pixels.
        pixels: TilePixels,
        /// Microseconds of tracing and encoding, by the node's clock.
        busy_micros: u32,
        /// Where the time since the request came has gone, by the node's clock.
        times: NodeTimes,
        /// Samples that were not finite and count as black.
        dropped_samples: u32,
        /// Bytes that the pixels took on the wire.
        payload_bytes: usize,
    },
    /// Tiles of a run that has been cancelled: nobody wants the pixels, which were not decoded,
    /// but the time they took says how fast the node is.
    TilesLate {
        /// The picture.
        frame: FrameId,
        /// The request.
        run: RunId,
        /// Which tiles of the picture's grid.
        tiles: TileRun,
        /// Microseconds of tracing and encoding, by the node's clock.
        busy_micros: u32,
        /// Bytes that the pixels took on the wire.
        payload_bytes: usize,
    },
    /// All tiles of a run have come, or the run was cancelled too late. The last event of the run.
    RunDone {
        /// The picture.
        frame: FrameId,
        /// How it went.
        report: RunReport,
    },
    /// A run will not be finished. The last event of the run.
    RunRefused {
        /// The picture.
        frame: FrameId,
        /// The request, and why.
        refusal: Refusal,
    },
    /// The answer to [`ClientSession::ping`].
    Pong(u64),
}

/// What [`ClientSession::set_scene`] found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneStatus {
    /// The node holds the scene.
    Ready,
    /// The scene is on its way; [`ClientEvent::SceneReady`] or [`ClientEvent::SceneRefused`]
    /// will follow. Requests may be sent after it at once.
    Pending,
}

/// The client's end of a connection: see [`crate::session`].
///
/// A report can overtake the last tiles of its run, which travel on other streams. So the session
/// keeps a report that comes early and hands it out after the last tile. A node that reports a
/// run and never sends its tiles gains nothing: the run just stays open until it is cancelled,
/// as with a node that says nothing at all.
///
/// Tiles of a cancelled run that still come are [`ClientEvent::TilesLate`]; those that come after
/// the node's last word on it are counted by [`ClientSession::late_tiles`] and dropped. The last
/// word is [`ClientEvent::RunRefused`], or [`ClientEvent::RunDone`] if the cancellation came too
/// late, or has been heard already if the report had overtaken the tiles.
pub struct ClientSession {
    state: State,
    scenes: SceneCache<SceneStatus>,
    /// Runs asked for and neither done nor refused, at most [`RUNS_QUEUED_MAX`].
    runs: BTreeMap<RunId, Run>,
    refused: RefusedRuns,
    held: Held,
    last_run: Option<RunId>,
    /// Scenes without an answer, in order, with the bytes of their messages.
    scenes_asked: VecDeque<(SceneHash, usize)>,
    /// Pings without an answer, in order.
    pings: VecDeque<u64>,
    decoder: Decoder,
    packets: VecDeque<Vec<u8>>,
    late_tiles: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// No welcome yet.
    New,
    Open,
    /// The node broke a rule.
    Closed,
}

impl ClientSession {
    /// A session over a connection that has just been made; the greeting is queued.
    pub fn new() -> Self {
        let mut session = Self {
            state: State::New,
            scenes: SceneCache::new(),
            runs: BTreeMap::new(),
            refused: RefusedRuns::default(),
            held: Held::default(),
            last_run: None,
            scenes_asked: VecDeque::new(),
            pings: VecDeque::new(),
            decoder: Decoder::new(),
            packets: VecDeque::new(),
            late_tiles: 0,
        };
        let hello = ToNode::Hello { version: VERSION };
        session.send(&hello).expect("a greeting is short");
        session
    }

    /// Makes sure that the node will hold `scene` when the next request comes: sends it unless
    /// it is there or on its way. `hash` must be [`SceneHash::of`] it.
    ///
    /// # Errors
    /// [`Error::Unsendable`] if the scene cannot be drawn or is too large,
    /// [`CONTROL_QUEUED_MAX`] scenes wait for an answer, or as many packets for the network.
    pub fn set_scene(&mut self, hash: SceneHash, scene: &Scene) -> Result<SceneStatus, Error> {
        if let Some(status) = self.scenes.peek_mut(hash) {
            return Ok(*status);
        }
        if self.scenes_asked.len() >= CONTROL_QUEUED_MAX {
            return Err(Error::unsendable("scene", "the node answers none"));
        }
        let invalid = |error: carom_tracer::Error| Error::unsendable("scene", error.to_string());
        scene.validate().map_err(invalid)?;
        let scene = Box::new(scene.clone());
        self.send(&ToNode::Scene { hash, scene })?;
        let bytes = self.packets.back().map_or(0, Vec::len);
        self.scenes.insert(hash, SceneStatus::Pending);
        self.scenes_asked.push_back((hash, bytes));
        Ok(SceneStatus::Pending)
    }

    /// Asks for tiles, once there has been [`ClientEvent::Welcome`], which tiles could overtake.
    /// Runs of one session must have rising numbers; gaps are fine.
    ///
    /// # Errors
    /// [`Error::Unsendable`] before the welcome, if the request is invalid, its scene is not [set], its run is not
    /// above the last one or [`RUNS_QUEUED_MAX`] runs are open, and as [`ClientSession::ping`].
    ///
    /// [set]: ClientSession::set_scene
    pub fn trace(&mut self, mut request: TraceRequest) -> Result<(), Error> {
        let unsendable = |why: String| Err(Error::unsendable("trace request", why));
        let run = request.run;
        if self.state != State::Open {
            return unsendable("the node has not answered, or is at fault".into());
        }
        if self.last_run.is_some_and(|last| run <= last) {
            return unsendable(format!("{run:?} is not above the one before"));
        }
        if self.runs.len() >= RUNS_QUEUED_MAX {
            return unsendable(format!("{RUNS_QUEUED_MAX} runs are open"));
        }
        if self.scenes.peek_mut(request.scene).is_none() {
            return unsendable("the node does not hold its scene".into());
        }
        let references = self.held.name(&mut request);
        let (hash, state) = (request.scene, Run::new(&request, references));
        self.send(&ToNode::Trace(Box::new(request)))?;
        self.scenes.touch(hash);
        self.last_run = Some(run);
        self.runs.insert(run, state);
        Ok(())
    }

    /// Cancels all runs of frames before `frame`.
    ///
    /// # Errors
    /// As [`ClientSession::ping`].
    pub fn cancel_before(&mut self, frame: FrameId) -> Result<(), Error> {
        let message = ToNode::CancelBefore(frame);
        self.cancel(&message, |_, run| run.frame < frame)
    }

    /// Cancels one run; does nothing if it is done, refused or cancelled already.
    ///
    /// # Errors
    /// As [`ClientSession::ping`].
    pub fn cancel_run(&mut self, run: RunId) -> Result<(), Error> {
        let message = ToNode::CancelRun(run);
        self.cancel(&message, |id, _| id == run)
    }

    /// Asks for a [`ClientEvent::Pong`] with the same number.
    ///
    /// # Errors
    /// [`Error::Unsendable`] if [`CONTROL_QUEUED_MAX`] packets wait for the network, or as many
    /// pings for an answer.
    pub fn ping(&mut self, number: u64) -> Result<(), Error> {
        if self.pings.len() >= CONTROL_QUEUED_MAX {
            return Err(Error::unsendable("ping", "the node answers none"));
        }
        self.send(&ToNode::Ping(number))?;
        self.pings.push_back(number);
        Ok(())
    }

    /// Takes a packet from the node. There are two events when the last tiles of a run come
    /// after its report.
    ///
    /// # Errors
    /// What rule the node broke. The session takes no further packet then, and the transport
    /// closes.
    pub fn handle(&mut self, packet: Packet) -> Result<Vec<ClientEvent>, Error> {
        let events = self.try_handle(packet);
        if events.is_err() {
            self.state = State::Closed;
        }
        events
    }

    /// The next packet to send.
    pub fn poll_transmit(&mut self) -> Option<Packet> {
        let bytes = self.packets.pop_front()?;
        let channel = Channel::Control;
        Some(Packet { channel, bytes })
    }

    /// Runs asked for and neither done nor refused.
    pub fn open_runs(&self) -> usize {
        self.runs.len()
    }

    /// Tiles that came for runs which the node had refused, after a cancellation as a rule.
    pub fn late_tiles(&self) -> u64 {
        self.late_tiles
    }

    fn try_handle(&mut self, packet: Packet) -> Result<Vec<ClientEvent>, Error> {
        if self.state == State::Closed {
            return Err(Error::out_of_order("packet", "the session is closed"));
        }
        if self.state == State::New && !codec::is_greeting(&packet.bytes) {
            return Err(Error::out_of_order("message", "the first must be Welcome"));
        }
        let message = codec::decode_to_client(&packet.bytes)?;
        let what = codec::to_client_kind(&message);
        let channel = match message {
            ToClient::Tiles(_) => Channel::Tiles,
            _ => Channel::Control,
        };
        if packet.channel != channel {
            let why = format!("it came as a {}", packet.channel.packet_name());
            return Err(Error::out_of_order(what, why));
        }
        match message {
            ToClient::Welcome { .. } if self.state == State::Open => {
                Err(Error::out_of_order(what, "there has been one"))
            }
            ToClient::Welcome { node, .. } => {
                self.state = State::Open;
                Ok(vec![ClientEvent::Welcome(node)])
            }
            ToClient::SceneReady(hash) => self.scene_ready(hash),
            ToClient::SceneRefused { hash, why } => self.scene_refused(hash, why),
            ToClient::Tiles(tiles) => self.take_tiles(&tiles),
            ToClient::RunDone(report) => self.run_done(report),
            ToClient::RunRefused(refusal) => self.run_refused(refusal),
            ToClient::Pong(number) => self.pong(number),
            ToClient::SceneComing { bytes } => self.scene_coming(bytes as usize),
        }
    }

    fn scene_ready(&mut self, hash: SceneHash) -> Result<Vec<ClientEvent>, Error> {
        self.expect_answer(hash)?;
        if let Some(status) = self.scenes.peek_mut(hash) {
            *status = SceneStatus::Ready;
        }
        Ok(vec![ClientEvent::SceneReady(hash)])
    }

    fn scene_coming(&mut self, bytes: usize) -> Result<Vec<ClientEvent>, Error> {
        match self.scenes_asked.front() {
            Some((hash, all)) if bytes <= *all => {
                let (hash, percent) = (*hash, (100 * bytes / all) as u8);
                Ok(vec![ClientEvent::SceneComing { hash, percent }])
            }
            _ => Err(Error::out_of_order(
                "progress of a scene",
                format!("no scene of {bytes} bytes was sent"),
            )),
        }
    }

    fn scene_refused(&mut self, hash: SceneHash, why: String) -> Result<Vec<ClientEvent>, Error> {
        self.expect_answer(hash)?;
        self.scenes.remove(hash);
        Ok(vec![ClientEvent::SceneRefused { hash, why }])
    }

    /// A node answers scenes in the order in which it gets them.
    fn expect_answer(&mut self, hash: SceneHash) -> Result<(), Error> {
        match self.scenes_asked.front() {
            Some((asked, _)) if *asked == hash => {
                self.scenes_asked.pop_front();
                Ok(())
            }
            _ => Err(Error::out_of_order(
                "answer to a scene",
                "the scene was not sent",
            )),
        }
    }

    fn take_tiles(&mut self, done: &TilesDone) -> Result<Vec<ClientEvent>, Error> {
        let Some(run) = self.runs.get_mut(&done.run) else {
            return self.take_tiles_of_no_run(done.run);
        };
        run.receive(done.tiles)?;
        let (frame, payload_bytes) = (run.frame, done.pixels.len());
        let tiles = if run.cancelled {
            ClientEvent::TilesLate {
                frame,
                run: done.run,
                tiles: done.tiles,
                busy_micros: done.busy_micros,
                payload_bytes,
            }
        } else {
            let pixels = match run.format {
                PixelFormat::Srgb8 { .. } => {
                    let told = run.with_references(done.tiles);
                    let decoded = self
                        .decoder
                        .decode_srgb(run.precision, &told, &done.pixels)?;
                    self.held
                        .insert(run.grid, done.run, done.tiles, decoded.kept);
                    TilePixels::Srgb8(decoded.pixels)
                }
                format => {
                    let sizes: Vec<Tile> = run.grid.tiles(done.tiles).collect();
                    self.decoder.decode(format, &sizes, &done.pixels)?
                }
            };
            ClientEvent::Tiles {
                frame,
                run: done.run,
                tiles: done.tiles,
                pixels,
                busy_micros: done.busy_micros,
                times: done.times,
                dropped_samples: done.dropped_samples,
                payload_bytes,
            }
        };
        let Some(report) = run.report.filter(|_| run.missing == 0) else {
            return Ok(vec![tiles]);
        };
        self.runs.remove(&report.run);
        Ok(vec![tiles, ClientEvent::RunDone { frame, report }])
    }

    fn take_tiles_of_no_run(&mut self, run: RunId) -> Result<Vec<ClientEvent>, Error> {
        if !self.refused.may_hold(run) {
            let why = format!("{run:?} is not open");
            return Err(Error::out_of_order("tile message", why));
        }
        self.late_tiles += 1;
        Ok(Vec::new())
    }

    fn run_done(&mut self, report: RunReport) -> Result<Vec<ClientEvent>, Error> {
        const WHAT: &str = "report";
        let Some(run) = self.runs.get_mut(&report.run) else {
            // The client cancelled a run whose report was still on its way, and a node may not
            // say two last words: so the run was never asked for, or is done.
            return Err(Error::out_of_order(
                WHAT,
                format!("{:?} is not open", report.run),
            ));
        };
        if run.report.is_some() {
            return Err(Error::out_of_order(WHAT, "there has been one"));
        }
        let frame = run.frame;
        if run.missing > 0 && !run.cancelled {
            run.report = Some(report);
            return Ok(Vec::new());
        }
        if run.missing > 0 {
            self.refused.insert(report.run);
        }
        self.runs.remove(&report.run);
        Ok(vec![ClientEvent::RunDone { frame, report }])
    }

    fn run_refused(&mut self, refusal: Refusal) -> Result<Vec<ClientEvent>, Error> {
        const WHAT: &str = "refusal";
        let id = refusal.run;
        let Some(run) = self.runs.get(&id).filter(|run| run.report.is_none()) else {
            return Err(Error::out_of_order(WHAT, format!("{id:?} is not open")));
        };
        if refusal.why == RefusalReason::Cancelled && !run.cancelled {
            return Err(Error::out_of_order(
                WHAT,
                format!("{id:?} was not cancelled"),
            ));
        }
        let frame = run.frame;
        self.runs.remove(&id);
        self.refused.insert(id);
        Ok(vec![ClientEvent::RunRefused { frame, refusal }])
    }

    fn pong(&mut self, number: u64) -> Result<Vec<ClientEvent>, Error> {
        if self.pings.front() != Some(&number) {
            return Err(Error::out_of_order("pong", "it answers no ping"));
        }
        self.pings.pop_front();
        Ok(vec![ClientEvent::Pong(number)])
    }

    /// Sends `message` if it cancels anything.
    fn cancel(
        &mut self,
        message: &ToNode,
        unwanted: impl Fn(RunId, &Run) -> bool,
    ) -> Result<(), Error> {
        let is_news = |run: &RunId, state: &Run| !state.cancelled && unwanted(*run, state);
        if !self.runs.iter().any(|(run, state)| is_news(run, state)) {
            return Ok(());
        }
        self.send(message)?;
        // The node's last word has come already where the report has: the run ends here.
        let reported = |run: &RunId, state: &mut Run| state.report.is_some() && is_news(run, state);
        for (run, _) in self.runs.extract_if(.., reported) {
            self.refused.insert(run);
        }
        for (run, state) in &mut self.runs {
            state.cancelled |= unwanted(*run, state);
        }
        Ok(())
    }

    fn send(&mut self, message: &ToNode) -> Result<(), Error> {
        if self.packets.len() >= CONTROL_QUEUED_MAX {
            let what = codec::to_node_kind(message);
            return Err(Error::unsendable(what, "the network takes no packet"));
        }
        self.packets.push_back(codec::encode_to_node(message)?);
        Ok(())
    }
}

impl Default for ClientSession {
    fn default() -> Self {
        Self::new()
    }
}
